"""What the tests share."""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

import idol

ROOT = Path(__file__).resolve().parents[2]
DEMO = ROOT / "data" / "shapes_demo"


def program(*arguments):
    """Runs the program `idol` of the same build; what it printed."""
    return subprocess.run([os.environ["IDOL_PROGRAM"], *map(str, arguments)], check=True, text=True,
                          stdout=subprocess.PIPE).stdout


@pytest.fixture(scope="session")
def demo():
    """Events and IMU of two seconds, the first of them at rest: (rig, events, imu)."""
    packets = list(idol.read(DEMO, to_s=2.0))
    return (idol.load_rig(sequence=DEMO), np.concatenate([packet.events for packet in packets]),
            np.concatenate([packet.imu for packet in packets]))


def equal(a, b):
    """Whether two results of dataclasses of arrays are the same bits."""
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in a.__dataclass_fields__)
