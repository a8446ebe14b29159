"""idol.Odometry: arrays in without copies, any thread, a listener that may fail."""

import gc
import subprocess
import sys
import threading
import time
import tracemalloc
import weakref

import numpy as np
import pytest

import idol
from conftest import DEMO, equal


def feed(odometry, events, imu, chunk=20000):
    """Pushes like a live source: chunks of events, before each the IMU up to its end and 20 ms beyond."""
    done = 0
    for i in range(0, len(events), chunk):
        piece = events[i:i + chunk]
        until = np.searchsorted(imu["t"], piece["t"][-1] + 20_000_000)
        odometry.push_imu(imu[done:until])
        odometry.push_events(piece)
        done = max(done, until)
    odometry.push_imu(imu[done:])
    odometry.finish()
    return odometry


@pytest.fixture(scope="module")
def reference(demo):
    rig, events, imu = demo
    return feed(idol.Odometry(rig), events, imu).states


def test_every_way_of_pushing_gives_the_same_bits(demo, reference):
    rig, events, imu = demo
    assert len(reference) > 20
    assert equal(feed(idol.Odometry(rig, options={"pipeline.threads": 1}), events, imu, 3333).states, reference)
    # Columns of other types, with strides, and one sample of the IMU at a time.
    odometry = idol.Odometry(rig)
    for sample in imu:
        odometry.push_imu(int(sample["t"]), sample["accel"], sample["gyro"])
    pairs = np.empty((len(events), 2), np.int32)
    pairs[:, 0], pairs[:, 1] = events["x"], events["y"]
    sign = np.where(events["p"], 1, -1).astype(np.int8)
    odometry.push_events(events["t"], pairs[:, 0], pairs[:, 1], sign)
    odometry.finish()
    assert equal(odometry.states, reference)
    assert len(odometry.trajectory) == len(reference) and len(odometry.lines) > 0
    # Seconds, where a float64 holds every nanosecond.
    odometry = idol.Odometry(rig)
    odometry.push_imu(imu["t"] / 1e9, imu["accel"], imu["gyro"])
    odometry.push_events(events["t"] / 1e9, events["x"], events["y"], events["p"])
    odometry.finish()
    assert equal(odometry.states, reference)


def test_arrays_are_not_copied(demo):
    rig, events, imu = demo
    columns = [np.tile(events[name], 4) for name in ("x", "y", "p")]
    t = np.arange(4 * len(events), dtype=np.int64) * 400  # fast: most is thinned out
    odometry = idol.Odometry(rig)
    tracemalloc.start()
    odometry.push_events(t, *columns)
    _, peak = tracemalloc.get_traced_memory()  # numpy tells it of each array
    tracemalloc.stop()
    odometry.close()
    assert sum(array.nbytes for array in [t, *columns]) > 5e6
    assert peak < 20e3


def test_packets_are_the_library_s_memory():
    packet = next(idol.read(DEMO))
    assert not packet.events.flags.owndata and packet.events.dtype == idol.event_dtype
    assert packet.x.base is not None and np.shares_memory(packet.x, packet.events)
    events = packet.events
    kept = events.copy()
    del packet
    gc.collect()
    assert np.array_equal(events, kept)


MEMORY = """
import sys
import numpy as np
import idol
packets = list(idol.read(sys.argv[1]))
rig = idol.load_rig(sequence=sys.argv[1])
columns = [np.concatenate([getattr(packet, name) for packet in packets]) for name in 'txyp']
imu = np.concatenate([packet.imu for packet in packets])
del packets

def megabytes(name):
    with open('/proc/self/status') as status:
        return next(int(line.split()[1]) for line in status if line.startswith(name)) / 1024

def growth(n):
    part = [column[:n] for column in columns]
    with open('/proc/self/clear_refs', 'w') as peak:
        peak.write('5')  # begins VmHWM, the peak, anew
    before = megabytes('VmRSS')
    with idol.Odometry(rig) as odometry:
        odometry.push_imu(imu)
        odometry.push_events(*part)
        odometry.wait()
        return megabytes('VmHWM') - before

growth(1000)
print(growth(len(columns[0]) // 4), growth(len(columns[0])))
"""


def test_memory_does_not_grow_with_the_arrays():
    out = subprocess.run([sys.executable, "-c", MEMORY, DEMO], check=True, text=True, stdout=subprocess.PIPE).stdout
    quarter, whole = map(float, out.split())
    # Another million events are 16 MB as the library keeps them, and 13 MB as arrays: what grows is the
    # estimator's own memory.
    assert whole - quarter < 10, (quarter, whole)


def test_other_threads_go_on_while_events_are_pushed(demo):
    rig, events, imu = demo
    odometry = idol.Odometry(rig)
    odometry.push_imu(imu)
    pushing = threading.Thread(target=lambda: odometry.push_events(events))
    ticks = [time.monotonic()]
    pushing.start()
    while pushing.is_alive():
        time.sleep(0.002)
        ticks.append(time.monotonic())
    length = ticks[-1] - ticks[0]
    assert len(ticks) > 10 and max(np.diff(ticks)) < 0.5 * length
    odometry.finish()
    assert len(odometry.states) > 20


@pytest.mark.parametrize("threads", [1, 2])
def test_exceptions_of_the_listener_come_out_of_push(demo, threads):
    rig, events, imu = demo
    odometry = idol.Odometry(rig, options={"pipeline.threads": threads})
    calls = []

    @odometry.on_estimate
    def listen(estimate):
        calls.append(estimate.t)
        if len(calls) == 5:
            raise ZeroDivisionError("of the listener")

    with pytest.raises(ZeroDivisionError, match="of the listener"):
        feed(odometry, events, imu)
    assert len(calls) == 5
    with pytest.raises(RuntimeError, match="ended with an error"):
        odometry.push_events(events[-10:])
    assert len(odometry.states) == 6  # what there was is still there


def test_estimates_say_what_is_known(demo):
    rig, events, imu = demo
    odometry = idol.Odometry(rig)
    kept, covariances = [], []

    def listen(estimate):
        kept.append(estimate)
        covariances.append(estimate.covariance())
        assert len(estimate.lines()) >= 0

    odometry.on_estimate(listen)
    feed(odometry, events, imu)
    last = kept[-1]
    assert last.settled and last.events > 0 and last.stats["lines"] > 0 and set(last.seconds) == {
        "segment", "integrate", "solve"}
    assert last.position.shape == (3,) and last.state.velocity.shape == (3,)
    assert covariances[-1].shape == (17, 17) and (np.diag(covariances[-1])[:3] > 0).all()
    with pytest.raises(RuntimeError, match="while on_estimate's function runs"):
        last.lines()


def test_listener_cannot_wait_for_itself(demo):
    rig, events, imu = demo
    odometry = idol.Odometry(rig)
    odometry.on_estimate(lambda estimate: odometry.predict(estimate.t))
    with pytest.raises(RuntimeError, match="its own on_estimate"):
        feed(odometry, events, imu)


def test_listener_goes_with_the_odometry(demo):
    rig, events, imu = demo
    odometry = idol.Odometry(rig)

    class Log:
        def __init__(self, owner):
            self.owner = owner

        def __call__(self, estimate):
            pass

    log = Log(odometry)
    odometry.on_estimate(log)
    watch = weakref.ref(log)
    feed(odometry, events, imu)
    del log, odometry
    gc.collect()
    assert watch() is None


def test_dropped_and_closed_ones_do_not_hang(demo):
    rig, events, imu = demo
    odometry = idol.Odometry(rig)
    odometry.on_estimate(lambda estimate: time.sleep(0.01))
    odometry.push_imu(imu)
    odometry.push_events(events[:len(events) // 2])
    del odometry  # its second thread is at work, and waits for the GIL
    with idol.Odometry(rig) as odometry:
        odometry.push_imu(imu)
    with pytest.raises(RuntimeError, match="closed"):
        odometry.push_imu(imu)
    # Nor does an interpreter that goes while windows wait.
    script = ("import sys, time, numpy as np, idol\n"
              "o = idol.Odometry(idol.load_rig(sequence=sys.argv[1]))\n"
              "o.on_estimate(lambda e: time.sleep(0.05))\n"
              "for packet in idol.read(sys.argv[1], to_s=1.5):\n"
              "    o.push_imu(packet.imu); o.push_events(packet.events)\n")
    assert subprocess.run([sys.executable, "-c", script, DEMO], timeout=60).returncode == 0


def test_predict_reaches_as_far_as_the_imu(demo):
    rig, events, imu = demo
    odometry = idol.Odometry(rig)
    assert odometry.predict(int(imu["t"][-1])) is None
    odometry.push_imu(imu)
    odometry.push_events(events)
    odometry.wait()
    newest = odometry.states
    t = int(newest.t[-1])
    assert np.array_equal(odometry.predict(t).position, newest.position[-1])
    later = odometry.predict(min(t + 5_000_000, int(imu["t"][-1])))
    assert 0 < np.linalg.norm(later.position - newest.position[-1]) < 0.05
    assert odometry.predict((t + 5_000_000) / 1e9).t == t + 5_000_000
    assert odometry.predict(int(imu["t"][-1]) + 1) is None


@pytest.mark.parametrize("change, error, words", [
    (dict(x=np.array([0, 240])), idol.DataError, "x: 240 is outside"),
    (dict(y=np.array([-1, 0])), idol.DataError, "y: -1 is outside"),
    (dict(t=np.array([5, 4])), idol.DataError, "in order of time"),
    (dict(t=np.array([0, 10**15])), idol.DataError, "10 minutes"),
    (dict(t=np.array([0, np.nan])), idol.DataError, "no stamp"),
    (dict(t=np.array([0, 1], np.float32)), TypeError, "t: integers"),
    (dict(t=np.array([[0, 1]])), TypeError, "one axis"),
    (dict(x=np.array([0.0, 1.0])), TypeError, "whole numbers"),
    (dict(p=np.array([True])), idol.DataError, "p has 1"),
    (dict(t=np.array([0, 1], ">i8")), TypeError, "byte order"),
])
def test_bad_events_are_refused_before_any_goes_in(demo, change, error, words):
    odometry = idol.Odometry(demo[0])
    good = dict(t=np.array([0, 1]), x=np.array([0, 239]), y=np.array([0, 179]), p=np.array([False, True]))
    with pytest.raises(error, match=words):
        odometry.push_events(**{**good, **change})
    odometry.push_events(**good)
    with pytest.raises(idol.DataError, match="shape|three numbers"):
        odometry.push_imu(0, [0, 0], [0, 0, 0])
    with pytest.raises(TypeError):
        odometry.push_events(np.zeros(3))
