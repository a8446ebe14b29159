"""idol.run: the same as the program, with the GIL released."""

import os
import signal
import threading
import time

import numpy as np
import pytest

import idol
from conftest import DEMO, equal, program

FILES = ["trajectory_camera.txt", "trajectory_imu.txt", "trajectory_camera_causal.txt", "trajectory_imu_causal.txt",
         "states.csv", "lines.csv", "windows.csv", "rig.yaml", "config.yaml", "evaluation.json"]


def test_gives_what_the_program_gives_to_the_bit(tmp_path):
    program("run", DEMO, "--out", tmp_path / "program", "--to", "3")
    result = idol.run(DEMO, tmp_path / "python", to_s=3.0)
    for name in FILES:
        if name == "windows.csv":  # has times of the wall
            continue
        assert (tmp_path / "program" / name).read_bytes() == (tmp_path / "python" / name).read_bytes(), name
    assert (tmp_path / "python" / "report.html").exists()
    for attribute, name in [("trajectory", FILES[0]), ("trajectory_imu", FILES[1]), ("trajectory_causal", FILES[2]),
                            ("trajectory_imu_causal", FILES[3])]:
        getattr(result, attribute).save(tmp_path / "saved.txt")
        assert (tmp_path / "saved.txt").read_bytes() == (tmp_path / "program" / name).read_bytes(), name
    # Without a folder nothing is written and nothing is different.
    again = idol.run(str(DEMO), to_s=3.0, rig=idol.load_rig(sequence=DEMO))
    assert again.out is None
    for attribute in ["trajectory", "trajectory_causal", "states", "lines"]:
        assert equal(getattr(again, attribute), getattr(result, attribute)), attribute


def test_tells_states_lines_stats_and_errors(tmp_path):
    result = idol.run(DEMO, to_s=3.0)
    n = len(result.states)
    assert n > 40 and result.states.position.shape == (n, 3) and result.states.orientation.shape == (n, 4)
    assert result.states.t.dtype == np.int64 and (np.diff(result.states.t) > 0).all()
    assert np.allclose(np.linalg.norm(result.trajectory.orientation, axis=1), 1)
    assert len(result.lines) > 5 and (result.lines.windows > 0).all()
    assert result.stats["windows"] == n - 1 and result.stats["status"] == "done"
    errors = idol.evaluate(result, DEMO, "full")
    assert errors["protocols"]["full"]["translation_m"]["rmse"] < 0.02


def test_options_reach_the_estimator():
    config = idol.config(options={"backend": {"lag_windows": 17}, "pipeline.threads": 1})
    assert "lag_windows: 17 " in config and "threads: 1 " in config
    with pytest.raises(idol.UsageError, match="backend.nonsense"):
        idol.run(DEMO, options={"backend.nonsense": 1})
    with pytest.raises(ValueError, match="preset"):
        idol.run(DEMO, preset="fast")
    one = idol.run(DEMO, to_s=1.6, options={"pipeline": {"threads": 1}})
    assert equal(one.states, idol.run(DEMO, to_s=1.6).states)


def test_bad_data_is_a_data_error(tmp_path):
    with pytest.raises(idol.DataError, match="nowhere") as caught:
        idol.run("nowhere")
    assert isinstance(caught.value, ValueError)
    with pytest.raises(idol.DataError, match="davis240c, davis346"):
        idol.run(DEMO, rig="davis999")


def test_of_a_damaged_recording_the_error_has_what_came_before(tmp_path):
    idol.convert(DEMO, tmp_path / "r.bag", to_s=2.0, rig=DEMO / "camchain-imucam.yaml")
    whole = (tmp_path / "r.bag").read_bytes()
    (tmp_path / "r.bag").write_bytes(whole[:int(0.8 * len(whole))])
    with pytest.raises(idol.DataError, match="r.bag") as caught:
        idol.run(tmp_path / "r.bag", tmp_path / "out", rig=DEMO / "camchain-imucam.yaml")
    assert len(caught.value.result.states) > 5
    assert (tmp_path / "out" / "trajectory_camera.txt").exists()


def test_other_threads_go_on_meanwhile():
    ticks = []
    over = threading.Event()

    def tick():
        while not over.is_set():
            ticks.append(time.monotonic())
            time.sleep(0.002)

    thread = threading.Thread(target=tick)
    thread.start()
    begin = time.monotonic()
    idol.run(DEMO, to_s=3.0)
    end = time.monotonic()
    over.set()
    thread.join()
    inside = [t for t in ticks if begin <= t <= end]
    # A run that held the GIL would leave a gap as long as itself.
    assert len(inside) > 10
    assert max(np.diff([begin, *inside, end])) < 0.5 * (end - begin)


def test_listener_is_called_and_its_exception_ends_the_run():
    seen = []
    result = idol.run(DEMO, to_s=2.5, on_estimate=lambda e: seen.append((e.t, e.state.position, len(e.lines()))))
    assert [t for t, _, _ in seen] == result.states.t[1:].tolist()
    assert seen[-1][2] > 0

    def fail(estimate):
        raise KeyError("not today")

    with pytest.raises(KeyError, match="not today"):
        idol.run(DEMO, to_s=1.6, on_estimate=fail)


def test_ctrl_c_ends_the_run_and_leaves_results(tmp_path):
    begun = threading.Event()

    def interrupt():
        begun.wait(60)
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        idol.run(DEMO, tmp_path, on_estimate=lambda e: begun.set())
    thread.join()
    assert "interrupted" in (tmp_path / "stats.json").read_text()
