"""The streaming door: events and IMU samples in, states out."""

from __future__ import annotations

import atexit
import weakref
from typing import Any, Callable, Dict, Optional, Union

import numpy as np

from . import _core
from ._jobs import Options, load_rig, settings
from ._types import Lines, PathLike, States, Trajectory

def _lines_of(estimate: _core.Estimate) -> Lines:
    """The map as it is now. While on_estimate's function runs only."""
    return Lines(**estimate._lines())


_core.Estimate.lines = _lines_of

_open: "weakref.WeakSet[Odometry]" = weakref.WeakSet()


@atexit.register
def _close_all() -> None:
    # A second thread that called a listener while the interpreter goes would crash.
    for odometry in list(_open):
        odometry.close()


class Odometry:
    """Push events and IMU samples as they come, each stream in order of time, in any chunks.

    Results do not depend on the chunks. A window of events is estimated once the IMU has gone beyond its end, by
    default in a second thread. Any thread may call; a call waits for that of another one. The GIL is released while
    the library works.
    """

    def __init__(self, rig: Union[_core.Rig, PathLike], preset: str = "realtime", options: Optional[Options] = None):
        """rig: a Rig, a file or the name of a ready rig. options: as idol.run takes them."""
        self.rig = rig if isinstance(rig, _core.Rig) else load_rig(rig)
        self._session = _core.Session(self.rig, preset, settings(options))
        _open.add(self)

    def on_estimate(self, function: Optional[Callable[[_core.Estimate], Any]]) -> Any:
        """Calls function(estimate) after each window, one call at a time, mostly in the second thread.

        What it raises comes out of the next push_events, push_imu, wait or finish, after which nothing can be pushed
        any more. It cannot use this object itself. Works as a decorator.
        """
        self._session.on_estimate(function)
        return function

    def push_events(self, t: Any, x: Any = None, y: Any = None, p: Any = None) -> None:
        """Events: four arrays of one length, or one array with the fields t, x, y, p (idol.event_dtype, any other).

        t: integers [ns] or float64 [s], the camera's clock; x, y: integers; p: bool or integers, > 0 is brighter.
        Arrays are read where they lie, whatever their integer type and strides: no copy is made. All are checked before
        the first goes in: DataError for a pixel outside the sensor or stamps that go back; TypeError for other
        types.
        """
        if x is None and y is None and p is None:
            self._session.push_events(t)
        else:
            self._session.push_events(t, x, y, p)

    def push_imu(self, t: Any, accel: Any = None, gyro: Any = None) -> None:
        """IMU samples: t [ns or s], accel [m/s^2] and gyro [rad/s], of one sample (a number, 3 and 3) or n (n, n x 3,
        n x 3); or one array with these fields (idol.imu_dtype). They are copied."""
        if accel is None and gyro is None:
            self._session.push_imu(t["t"], t["accel"], t["gyro"])
        else:
            self._session.push_imu(t, accel, gyro)

    def end_imu(self) -> None:
        """Says that no IMU sample will come any more: events beyond it are dropped, not kept waiting."""
        self._session.end_imu()

    def wait(self) -> None:
        """Returns when all windows cut so far are estimated."""
        self._session.wait()

    def finish(self) -> None:
        """The last, partial window; then one more look at everything. Nothing can be pushed after it."""
        self._session.finish()

    def predict(self, t: Union[int, float]) -> Optional[_core.State]:
        """The newest estimate carried on to t [ns or s] by the IMU samples so far; None where they do not reach."""
        return self._session.predict(t)

    @property
    def states(self) -> States:
        """States of the IMU at the windows' ends. Waits for those being estimated; so do the next ones."""
        return States(**self._session.states())

    @property
    def trajectory(self) -> Trajectory:
        """Poses of the camera at the same times."""
        return Trajectory(*self._session.trajectory())

    @property
    def lines(self) -> Lines:
        """The map."""
        return Lines(**self._session.lines())

    @property
    def warnings(self) -> Dict[str, Any]:
        """{kind: (first message, count)} so far."""
        return self._session.warnings()

    def close(self) -> None:
        """Ends the second thread, dropping what waits for it. For those who stop early."""
        self._session.close()

    def __enter__(self) -> "Odometry":
        return self

    def __exit__(self, *exception: Any) -> None:
        self.close()
