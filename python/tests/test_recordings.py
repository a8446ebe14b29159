"""Reading, converting, judging; rigs."""

import json

import numpy as np
import pytest

import idol
from conftest import DEMO, ROOT, program


def test_every_format_reads_the_same(tmp_path):
    def everything(path):
        packets = list(idol.read(path))
        return [np.concatenate([getattr(packet, name) for packet in packets]) for name in ("events", "imu")]

    done = idol.convert(DEMO, tmp_path / "r.h5", to_s=0.5)
    events, imu = everything(tmp_path / "r.h5")
    assert done["events"] == len(events) > 1000 and done["imu"] == len(imu) > 100 and done["poses"] > 10
    direct = list(idol.read(DEMO, to_s=0.5))
    assert np.array_equal(np.concatenate([packet.t for packet in direct]), events["t"])
    idol.convert(tmp_path / "r.h5", tmp_path / "other", format="bag")
    for a, b in zip(everything(tmp_path / "other"), (events, imu)):
        assert np.array_equal(a, b)
    assert len(idol.read_groundtruth(tmp_path / "other")) == done["poses"]
    with pytest.raises(idol.UsageError, match="aedat4"):
        idol.convert(DEMO, tmp_path / "x", format="rosbag")


def test_a_recording_is_told_while_it_is_read():
    recording = idol.read(DEMO, to_s=0.2, packet_events=500)
    packets = [(packet, recording.progress) for packet in recording]
    assert max(len(packet.events) for packet, _ in packets) <= 500
    assert packets[0][1] <= packets[-1][1] <= 1
    assert recording.first_stamp <= packets[0][0].imu["t"][0]
    assert np.abs(np.linalg.norm(packets[0][0].imu["accel"], axis=1).mean() - 9.81) < 0.3


def test_damage_comes_after_what_is_whole(tmp_path):
    idol.convert(DEMO, tmp_path / "r.aedat4", to_s=2.5)
    whole = (tmp_path / "r.aedat4").read_bytes()
    damaged = bytearray(whole)
    damaged[len(whole) // 2:len(whole) // 2 + 64] = bytes(64)
    (tmp_path / "r.aedat4").write_bytes(damaged)
    events = 0
    with pytest.raises(idol.DataError, match="r.aedat4"):
        for packet in idol.read(tmp_path / "r.aedat4"):
            events += len(packet.events)
    assert events > 0
    with pytest.raises(idol.DataError, match="missing"):
        idol.read(tmp_path / "missing")


def test_evaluation_is_that_of_the_program(tmp_path):
    truth = idol.read_groundtruth(DEMO)
    turned = idol.Trajectory(truth.t[::7], truth.position[::7] + [1, 2, 3] + 0.01 * np.sin(truth.t[::7, None] / 3e8),
                             truth.orientation[::7])
    turned.save(tmp_path / "estimate.txt")
    program("evaluate", tmp_path / "estimate.txt", DEMO, "--json", tmp_path / "errors.json")
    expected = json.loads((tmp_path / "errors.json").read_text())
    # To the last digits: sums may be taken in another order where the data lie otherwise in memory.
    rounded = lambda figures: json.loads(json.dumps(figures), parse_float=lambda x: round(float(x), 9))
    assert rounded(idol.evaluate(tmp_path / "estimate.txt", DEMO)) == rounded(expected)
    of_arrays = idol.evaluate(turned.array(), truth.array(), ["full", "segments"])
    rmse = of_arrays["protocols"]["full"]["translation_m"]["rmse"]
    assert rmse == pytest.approx(expected["protocols"]["full"]["translation_m"]["rmse"], rel=1e-3) and rmse > 1e-3
    with pytest.raises(idol.UsageError, match="nonsense"):
        idol.evaluate(turned, truth, "nonsense")
    with pytest.raises(idol.DataError, match="t x y z"):
        idol.evaluate(np.zeros((3, 7)), truth)


def test_ready_rigs_come_along():
    assert idol.ready_rigs() == ["davis240c", "davis346", "dvxplorer", "evk4"]
    rig = idol.load_rig("davis240c")
    assert (rig.width, rig.height) == (240, 180)
    assert rig.to_yaml() == idol.load_rig(ROOT / "configs" / "rig_davis240c.yaml").to_yaml()
    with pytest.warns(UserWarning, match="typical of this sensor"):
        idol.load_rig("evk4")
    with pytest.raises(idol.DataError, match="davis240c, davis346, dvxplorer, evk4"):
        idol.load_rig("davis")


def test_a_rig_of_numbers(tmp_path):
    T = np.array([[0, -1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, 1, 0.3], [0, 0, 0, 1.0]])
    rig = idol.Rig(346, 260, (250, 251, 170, 130), T, distortion="radtan", coeffs=[-0.3, 0.1, 0, 0],
                   time_offset_s=0.002, imu=idol.ImuNoise(rate_hz=200))
    assert np.allclose(rig.T_i_c, T) and rig.coeffs == (-0.3, 0.1, 0, 0, 0) and rig.imu.rate_hz == 200
    (tmp_path / "rig.yaml").write_text(rig.to_yaml())
    again = idol.load_rig(tmp_path / "rig.yaml")
    assert again.intrinsics == rig.intrinsics and np.allclose(again.T_i_c, T) and again.time_offset_s == 0.002
    with pytest.raises(idol.DataError, match="orthonormal"):
        idol.Rig(10, 10, (10, 10, 5, 5), 2 * np.eye(4))
    with pytest.raises(idol.DataError, match="distortion 'fisheye'"):
        idol.Rig(10, 10, (10, 10, 5, 5), np.eye(4), distortion="fisheye")
