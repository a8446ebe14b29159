"""What comes out: arrays with names."""

from __future__ import annotations

import dataclasses
import os
from typing import Any, Dict, Optional, Union

import numpy as np

from . import _core

PathLike = Union[str, "os.PathLike[str]"]


@dataclasses.dataclass(frozen=True)
class Trajectory:
    """Poses of a body in the world, one a row."""

    t: np.ndarray  #: (n,) int64 [ns]
    position: np.ndarray  #: (n, 3) [m]
    orientation: np.ndarray  #: (n, 4) qx qy qz qw

    def __len__(self) -> int:
        return len(self.t)

    def array(self) -> np.ndarray:
        """(n, 8): t [s], x, y, z, qx, qy, qz, qw, as a file of a trajectory has them.

        A float64 holds seconds since 1970 to 0.2 us only.
        """
        return np.column_stack([self.t / 1e9, self.position, self.orientation])

    @staticmethod
    def from_array(rows: np.ndarray) -> "Trajectory":
        """Of an array such as array() gives."""
        rows = np.asarray(rows, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != 8:
            raise _core.DataError("a trajectory as one array has rows t x y z qx qy qz qw")
        return Trajectory(np.rint(rows[:, 0] * 1e9).astype(np.int64), rows[:, 1:4], rows[:, 4:8])

    def save(self, path: PathLike) -> None:
        """Writes 't tx ty tz qx qy qz qw' (TUM), nine decimals."""
        _core.write_trajectory(path, self.t, self.position, self.orientation)


@dataclasses.dataclass(frozen=True)
class States:
    """Motion of the IMU in the world, one state a row."""

    t: np.ndarray  #: (n,) int64 [ns]
    position: np.ndarray  #: (n, 3) [m]
    orientation: np.ndarray  #: (n, 4) qx qy qz qw
    velocity: np.ndarray  #: (n, 3) [m/s]
    gyro_bias: np.ndarray  #: (n, 3) [rad/s]
    accel_bias: np.ndarray  #: (n, 3) [m/s^2]
    time_shift_s: np.ndarray  #: (n,) of the camera's clock, beyond the rig's [s]
    event_lag_px: np.ndarray  #: (n,) how far events trail their edges [px]

    def __len__(self) -> int:
        return len(self.t)


@dataclasses.dataclass(frozen=True)
class Lines:
    """Segments of the map, one a row."""

    id: np.ndarray  #: (n,) int64
    a: np.ndarray  #: (n, 3) one end in the world [m]
    b: np.ndarray  #: (n, 3) the other
    first: np.ndarray  #: (n,) int64, first window that saw it [ns]
    last: np.ndarray  #: (n,) int64, last one [ns]
    windows: np.ndarray  #: (n,) int64, how many did
    events: np.ndarray  #: (n,) int64, events on it

    def __len__(self) -> int:
        return len(self.id)


@dataclasses.dataclass(frozen=True)
class Result:
    """What idol.run found."""

    trajectory: Trajectory  #: camera, best estimate at the end
    trajectory_imu: Trajectory
    trajectory_causal: Trajectory  #: camera, each pose as it was first published
    trajectory_imu_causal: Trajectory
    states: States
    lines: Lines
    stats: Dict[str, Any]  #: stats.json
    warnings: Dict[str, Any]  #: {kind: (first message, count)}
    rig: _core.Rig  #: as used
    out: Optional[str] = None  #: folder with the results, if one was asked for
