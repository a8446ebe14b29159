"""idol: event-camera and IMU odometry with lines.

    import idol
    result = idol.run("my_recording", rig="davis240c")
    result.trajectory.position        # (n, 3), camera in the world [m]

Stamps are int64 nanoseconds in what comes out; what goes in may be float seconds instead. Positions are in m,
orientations quaternions (qx, qy, qz, qw), all in a world with z up. docs/python.md says the rest.
"""

from ._core import (DataError, Estimate, ImuNoise, Rig, State, UsageError, __version__, event_dtype, imu_dtype,
                    ready_rigs)
from ._jobs import config, convert, evaluate, load_rig, run
from ._odometry import Odometry
from ._recordings import Packet, Recording, read, read_groundtruth
from ._types import Lines, Result, States, Trajectory

__all__ = ["DataError", "Estimate", "ImuNoise", "Lines", "Odometry", "Packet", "Recording", "Result", "Rig", "State",
           "States", "Trajectory", "UsageError", "__version__", "config", "convert", "evaluate", "event_dtype",
           "imu_dtype", "load_rig", "read", "read_groundtruth", "ready_rigs", "run"]
