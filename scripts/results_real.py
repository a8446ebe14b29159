"""Odometry on the two real pieces that have an IMU, against what else is known of them. Needs numpy.

rotDisk: the camera rolls by 92 deg before a wheel whose eight spokes are known in the image; gravity turns in its
readings. `roll_deg`: the run's turn about the optical axis from its first pose to its last, against the mean turn of the
spokes. `tilt_deg`: where the run's last pose sees "up", against gravity. `bias_deg_s`: the run's last gyro bias against
the one with which the accelerometer's readings, turned by the gyro, stay the same over the recording.
shapes_rotation: `turn_deg`: rotation of the last pose relative to the first, against motion capture, of which a line
through 0.1 s is taken; `all_deg`: RMS over all poses after alignment of the rotations.
"""
import math
import os

import numpy as np

AVERAGED = 8  # IMU samples made one: 3.4 ms
BINS = 30     # in which the turned readings of the accelerometer are to agree


def table(path, delimiter=None, skip=0):
    return np.loadtxt(path, delimiter=delimiter, skiprows=skip, ndmin=2)


def rotation(q):
    """Of one quaternion x y z w."""
    x, y, z, w = q / np.linalg.norm(q)
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def so3_exp(v):
    angle = np.linalg.norm(v)
    x, y, z = v / angle if angle > 1e-12 else v
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k


def so3_log(r):
    v = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / 2
    sine, cosine = np.linalg.norm(v), (np.trace(r) - 1) / 2
    return v if sine < 1e-9 else v * math.atan2(sine, cosine) / sine


def angle_deg(a, b):
    return math.degrees(math.atan2(np.linalg.norm(np.cross(a, b)), a @ b))


def turns(t, rates, bias):
    out = [np.eye(3)]
    for step, rate in zip(np.diff(t), (rates[1:] + rates[:-1]) / 2 - bias):
        out.append(out[-1] @ so3_exp(rate * step))
    return np.array(out)


def gravity_and_bias(imu):
    """Stamps, "up" in the IMU's frame at these, gyro bias: one force fixed in the world and one bias explain all readings."""
    n = len(imu) // AVERAGED * AVERAGED
    t, force, rates = np.split(imu[:n].reshape(-1, AVERAGED, 7).mean(1), [1, 4], axis=1)
    t = t[:, 0]
    bias = np.zeros(3)

    def turned(b):
        return np.einsum("nij,nj->ni", turns(t, rates, b), force)

    def spread(b):
        means = np.array([part.mean(0) for part in np.array_split(turned(b), BINS)])
        return (means - means.mean(0)).ravel()

    for _ in range(4):
        now, step = spread(bias), 1e-4
        slopes = np.stack([(spread(bias + step * axis) - now) / step for axis in np.eye(3)], axis=1)
        bias = bias - np.linalg.lstsq(slopes, now, rcond=None)[0]
    return t, np.einsum("nji,j->ni", turns(t, rates, bias), turned(bias).mean(0)), bias


def spokes(path):
    """Angles of all lines of a truth file in the image, over time: list of (stamps, unwrapped angles)."""
    lines = []
    with open(path, encoding="utf-8") as file:
        for words in map(str.split, file):
            if words[:1] == ["line"]:
                lines.append([])
            elif words[:1] == ["k"]:
                v = [float(word) for word in words[1:]]
                lines[-1].append((v[0], math.atan2(v[-1] - v[2], v[-2] - v[1])))
    return [(np.array(line)[:, 0], np.unwrap(np.array(line)[:, 1])) for line in lines]


def rot_disk(run, data, truth):
    poses, states = table(os.path.join(run, "trajectory_camera.txt")), table(os.path.join(run, "states.csv"), ",", 1)
    first, last = rotation(poses[0, 4:]), rotation(poses[-1, 4:])
    turned = first.T @ last
    roll = math.degrees(math.atan2(turned[1, 0] - turned[0, 1], turned[0, 0] + turned[1, 1]))
    # The camera's turn is the image's, backwards.
    true_roll = -math.degrees(np.mean([np.interp(poses[-1, 0], *s) - np.interp(poses[0, 0], *s) for s in spokes(truth)]))
    t, up, bias = gravity_and_bias(table(os.path.join(data, "imu.txt")))
    true_up = np.array([np.interp(poses[-1, 0], t, up[:, k]) for k in range(3)])  # camera and IMU have the same axes
    return {"roll_deg": abs((roll - true_roll + 180) % 360 - 180), "of_deg": abs(true_roll),
            "tilt_deg": angle_deg(last.T @ np.array([0.0, 0.0, 1.0]), true_up),
            "bias_deg_s": math.degrees(np.linalg.norm(states[-1, 11:14] - bias))}


def shapes_rotation(run, data, _truth):
    poses, capture = table(os.path.join(run, "trajectory_camera.txt")), table(os.path.join(data, "groundtruth.txt"))
    rotations = np.array([rotation(q) for q in capture[:, 4:]])
    inside = (poses[:, 0] > capture[0, 0]) & (poses[:, 0] < capture[-1, 0])
    poses = poses[inside]

    def captured(t):
        """Line through the rotations within 50 ms, at t."""
        near = np.abs(capture[:, 0] - t) < 0.05
        middle = rotations[np.argmin(np.abs(capture[:, 0] - t))]
        v = np.array([so3_log(middle.T @ r) for r in rotations[near]])
        return middle @ so3_exp(np.polyfit(capture[near, 0] - t, v, 1)[1])

    true, mine = [captured(t) for t in poses[:, 0]], [rotation(q) for q in poses[:, 4:]]
    u, _, vt = np.linalg.svd(sum(a @ b.T for a, b in zip(true, mine)))
    align = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    errors = [np.linalg.norm(so3_log(a.T @ align @ b)) for a, b in zip(true, mine)]
    turn = true[0].T @ true[-1]
    return {"turn_deg": math.degrees(np.linalg.norm(so3_log(turn.T @ mine[0].T @ mine[-1]))),
            "of_deg": math.degrees(np.linalg.norm(so3_log(turn))),
            "all_deg": math.degrees(math.sqrt(np.mean(np.square(errors))))}


ODOMETRY = {"rotDisk": rot_disk, "shapes_rotation": shapes_rotation}
