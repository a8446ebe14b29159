#!/usr/bin/env python3
"""Runs idol on a recording and draws the trajectory, the map of lines and the speed.

plot_trajectory.py RECORDING [--rig RIG] [--to SECONDS] [--out PICTURE.png]
"""

import argparse

import matplotlib
import numpy as np

import idol


def parse_arguments():
    parser = argparse.ArgumentParser(description="Trajectory and lines of a recording, as a picture.")
    parser.add_argument("recording")
    parser.add_argument("--rig", help="calibration, or the name of a ready rig: " + ", ".join(idol.ready_rigs()))
    parser.add_argument("--to", type=float, help="seconds of the recording to use (default: all)")
    parser.add_argument("--out", help="file to write; without it a window opens")
    return parser.parse_args()


def seen_from_above(axes, result):
    """Lines of the map and the way of the camera, in the plane of the floor."""
    for a, b in zip(result.lines.a, result.lines.b):
        axes.plot([a[0], b[0]], [a[1], b[1]], color="0.75", linewidth=0.8)
    path = result.trajectory.position
    axes.plot(path[:, 0], path[:, 1], color="tab:blue")
    axes.plot(*path[0, :2], "o", color="tab:green", label="begin")
    axes.set(xlabel="x [m]", ylabel="y [m]", title="from above", aspect="equal")
    # The map reaches further than the way: show what is near.
    margin = 0.2 + np.ptp(path[:, :2], axis=0).max()
    axes.set_xlim(path[:, 0].min() - margin, path[:, 0].max() + margin)
    axes.set_ylim(path[:, 1].min() - margin, path[:, 1].max() + margin)
    axes.legend()


def over_time(axes, result):
    seconds = (result.states.t - result.states.t[0]) / 1e9
    for axis, name in enumerate("xyz"):
        axes.plot(seconds, result.states.velocity[:, axis], label=name)
    axes.set(xlabel="t [s]", ylabel="velocity [m/s]", title="velocity of the IMU")
    axes.legend()


def main():
    arguments = parse_arguments()
    if arguments.out:
        matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    result = idol.run(arguments.recording, rig=arguments.rig, to_s=arguments.to)
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 5), constrained_layout=True)
    seen_from_above(left, result)
    over_time(right, result)
    if arguments.out:
        figure.savefig(arguments.out)
    else:
        plt.show()
    print(f"{len(result.trajectory)} poses, {len(result.lines)} lines")


if __name__ == "__main__":
    main()
