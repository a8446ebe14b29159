"""Recordings of any format, packet by packet."""

from __future__ import annotations

import dataclasses
from typing import Any, Dict, Iterator, Optional, Tuple

import numpy as np

from . import _core
from ._jobs import streams
from ._types import PathLike, Trajectory


@dataclasses.dataclass(frozen=True)
class Packet:
    """Some events and the IMU samples beside them, each in order of time. Arrays are the library's own memory."""

    events: np.ndarray  #: (n,) of event_dtype: t [ns], x, y, p
    imu: np.ndarray  #: (m,) of imu_dtype: t [ns], accel [m/s^2], gyro [rad/s]

    @property
    def t(self) -> np.ndarray:
        """Stamps of the events, int64 [ns], the camera's clock."""
        return self.events["t"]

    @property
    def x(self) -> np.ndarray:
        return self.events["x"]

    @property
    def y(self) -> np.ndarray:
        return self.events["y"]

    @property
    def p(self) -> np.ndarray:
        """True: brighter."""
        return self.events["p"]


class Recording:
    """An iterator over the packets of a recording, read as they are asked for, in bounded memory."""

    def __init__(self, reader: Any):
        self._reader = reader

    def __iter__(self) -> Iterator[Packet]:
        return self

    def __next__(self) -> Packet:
        return Packet(*self._reader.next())

    @property
    def first_stamp(self) -> int:
        """Earliest of all streams, before from_s was cut [ns]."""
        return self._reader.first_stamp()

    @property
    def progress(self) -> float:
        """Share read so far, in [0, 1]."""
        return self._reader.progress()

    @property
    def warnings(self) -> Dict[str, Any]:
        """{kind: (first message, count)} so far."""
        return self._reader.warnings()


def read(path: PathLike, from_s: float = 0.0, to_s: Optional[float] = None, *, size: Tuple[int, int] = (0, 0),
         packet_events: int = 16384, events_topic: str = "", imu_topic: str = "",
         imu: Optional[PathLike] = None) -> Recording:
    """Opens a recording, whatever its format: `for packet in idol.read(path): packet.events, packet.imu`.

    size: (width, height) of the sensor, to leave out events beyond it. Raises DataError; of a damaged
    recording, only after all packets before the damage.
    """
    if packet_events < 1:
        raise _core.UsageError("packet_events: at least 1")
    return Recording(_core.PacketReader(path, size, from_s, 1e30 if to_s is None else to_s, packet_events,
                                        streams(events_topic, imu_topic, "", imu)))


def read_groundtruth(path: PathLike, truth_topic: str = "") -> Optional[Trajectory]:
    """Ground truth of a recording, None if it has none. Raises DataError if that is damaged."""
    truth = _core.read_groundtruth(path, streams("", "", truth_topic, None))
    return None if truth is None else Trajectory(*truth)
