"""Whole jobs, each in one call."""

from __future__ import annotations

import json
import os
from typing import Any, Callable, Dict, Mapping, Optional, Sequence, Union

import numpy as np

from . import _core
from ._types import Lines, PathLike, Result, States, Trajectory

Options = Mapping[str, Any]

# What came before the damage, for errors of idol.run.
_core.DataError.result = None


def settings(options: Optional[Options], prefix: str = "") -> Dict[str, str]:
    """Options as the library takes them: text by dotted name. Groups may be dicts in the dict."""
    out: Dict[str, str] = {}
    for name, value in (options or {}).items():
        if isinstance(value, Mapping):
            out.update(settings(value, f"{prefix}{name}."))
        elif isinstance(value, (bool, np.bool_)):
            out[prefix + name] = "true" if value else "false"
        else:
            out[prefix + name] = str(value)
    return out


def streams(events_topic: str, imu_topic: str, truth_topic: str, imu: Optional[PathLike],
            camera: str = "") -> _core.StreamChoice:
    return _core.StreamChoice(events_topic, imu_topic, truth_topic, imu or "", camera)


def load_rig(rig: Optional[PathLike] = None, *, sequence: Optional[PathLike] = None,
             imu_rig: Optional[PathLike] = None) -> _core.Rig:
    """A rig from its file, by the name of a ready one (idol.ready_rigs()), or from a recording's folder.

    What `rig` leaves open is looked for in the folder of `sequence`, as `idol run` does (docs/formats.md).
    Oddities are UserWarnings. Raises DataError.
    """
    return _core.load_rig(sequence or "", rig or "", imu_rig or "")


def run(path: PathLike, out: Optional[PathLike] = None, preset: str = "realtime",
        rig: Union[PathLike, _core.Rig, None] = None, imu_rig: Optional[PathLike] = None,
        options: Optional[Options] = None, from_s: float = 0.0, to_s: Optional[float] = None, *,
        rate_hz: float = 0.0, on_estimate: Optional[Callable[[_core.Estimate], Any]] = None, events_topic: str = "",
        imu_topic: str = "", truth_topic: str = "", imu: Optional[PathLike] = None, camera: str = "") -> Result:
    """Trajectory and lines of a recording: what `idol run` does, with the same bits.

    rig: a file, the name of a ready rig or a Rig; without one, what lies in the recording's folder.
    options: by dotted name or nested, as {"backend.lag_windows": 30} or {"backend": {"lag_windows": 30}}.
    camera: of a rig file with several, as cam1; else the one of the sensor's size is taken.
    from_s, to_s: seconds from the recording's first stamp. out: a folder for all that `idol run` writes.
    on_estimate: is called with an Estimate after each window, in another thread; what it raises ends the run and
    comes out of here.

    Raises DataError for bad data. If the recording is damaged, what came before the damage is estimated (and
    written) all the same: the error's attribute `result` has it.
    """
    given = isinstance(rig, _core.Rig)
    if given and imu_rig is not None:
        raise _core.UsageError("imu_rig: a Rig has its IMU's noise already")
    found, why = _core.run(path, out or "", preset, settings(options), rig if given else None,
                           "" if given else rig or "", imu_rig or "", from_s, 1e30 if to_s is None else to_s, rate_hz,
                           streams(events_topic, imu_topic, truth_topic, imu, camera), on_estimate)
    result = Result(**{name: Trajectory(*found[name]) for name in found if name.startswith("trajectory")},
                    states=States(**found["states"]), lines=Lines(**found["lines"]),
                    stats=json.loads(found["stats"]), warnings=found["warnings"], rig=found["rig"],
                    out=None if out is None else os.fspath(out))
    if why is None:
        return result
    error = _core.DataError(why)
    error.result = result
    raise error


def evaluate(estimate: Union[PathLike, Trajectory, Result, np.ndarray],
             groundtruth: Union[PathLike, Trajectory, np.ndarray],
             protocol: Union[str, Sequence[str], None] = None, *, interpolate: bool = False,
             until_s: Optional[float] = None) -> Dict[str, Any]:
    """Errors of a trajectory by one or several protocols (default: all), as `idol evaluate --json` gives them.

    Paths are of trajectory files, of a run's folder, of a recording with ground truth; arrays have rows
    t [s] x y z qx qy qz qw. Docs: docs/evaluation.md. Raises DataError if nothing matches.
    """
    of_imu = False
    if isinstance(groundtruth, (str, os.PathLike)):
        truth, of_imu = _core.load_groundtruth(groundtruth)
    else:
        truth = _arrays(groundtruth)
    if isinstance(estimate, Result):
        estimate = estimate.trajectory_imu if of_imu else estimate.trajectory
    if isinstance(estimate, (str, os.PathLike)):
        judged = _core.load_estimate(estimate, of_imu)
    else:
        judged = _arrays(estimate)
    protocols = [protocol] if isinstance(protocol, str) else list(protocol or [])
    return json.loads(_core.evaluate(judged, truth, protocols, interpolate, until_s))


def _arrays(trajectory: Union[Trajectory, np.ndarray]) -> tuple:
    if not isinstance(trajectory, Trajectory):
        trajectory = Trajectory.from_array(trajectory)
    return trajectory.t, trajectory.position, trajectory.orientation


def convert(path: PathLike, out: PathLike, format: str = "", compress: bool = False, *,
            rig: Optional[PathLike] = None, imu_rig: Optional[PathLike] = None, from_s: float = 0.0,
            to_s: Optional[float] = None, events_topic: str = "", imu_topic: str = "", truth_topic: str = "",
            imu: Optional[PathLike] = None, camera: str = "") -> Dict[str, Any]:
    """Writes a recording in another format: by the ending of `out` .bag, .h5, .aedat4, else a folder of text.

    Returns the numbers of events, imu samples and poses written, and the warnings. Raises DataError; of a
    damaged recording, what came before the damage is written.
    """
    return _core.convert(path, out, format, compress, rig or "", imu_rig or "", from_s,
                         1e30 if to_s is None else to_s, streams(events_topic, imu_topic, truth_topic, imu, camera))


def config(preset: str = "realtime", options: Optional[Options] = None) -> str:
    """Every option with its value and meaning, as the YAML that `idol config` prints."""
    return _core.config(preset, settings(options))
