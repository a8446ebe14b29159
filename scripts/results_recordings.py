"""The recordings that scripts/results --judge runs on, by group, and how those that are missing are made."""
import filecmp
import os
import shutil
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
SHARED = os.path.join(ROOT, "..", "shared")
RECORDINGS = os.path.join(SHARED, "tools", "recordings")
DEGRADE = os.path.join(SHARED, "tools", "degrade", "degrade.cpp")
OLD = os.path.join(SHARED, "data", "sim")
# Of the group `degraded`: a recording, what was done to it, and the options of ../shared/tools/degrade that do it. The tool
# rounds the rig's files, which alone changes a run's error, so that copies are compared with an unchanged copy.
UNCHANGED = "unchanged"
COPIES = """
lap_a unchanged
lap_a imu_errors --acc-scale .01 --gyro-scale .01 --acc-misalign .5 --gyro-misalign .5 --g-sens 1.78e-4
lap_a jitter_1ms --imu-jitter .001
lap_a bursts_of_4 --imu-burst 4,0
lap_a bursts_of_10 --imu-burst 10,0
lap_a offset_50ms --offset .05
lap_a offset_100ms --offset .1
lap_a cut_0.3s --cut 20,20.3
lap_a imu_gap_1s --imu-gap 20,21
lap_a clock_500ppm --imu-clock 500
lap_a clock_2000ppm --imu-clock 2000
lap_a warm_up --drift 0.02,0.1,30
lap_a vibration --vibration 3,0.02
lap_a object_60x90 --object 60,90,80
lap_a object_180x180 --object 180,180,80
hand_shapes unchanged
hand_shapes gyro_500deg_s --gyro-sat 500
hand_shapes gyro_250deg_s --gyro-sat 250
hand_shapes acc_2g --acc-sat 2
shapes_6dof unchanged
shapes_6dof noise_20hz --noise 20
shapes_6dof noise_50hz --noise 50
shapes_6dof nth_10 --nth 10
shapes_6dof flicker_100hz --flicker 100,1,0.3
desk_6dof unchanged
desk_6dof noise_20hz --noise 20
desk_6dof noise_50hz --noise 50
desk_6dof nth_10 --nth 10
desk_6dof flicker_100hz --flicker 100,1,0.3
"""


def whole(folder):
    """A recording is; what was interrupted while it was made lacks the file that is written last."""
    return os.path.isfile(os.path.join(folder, "imu.yaml"))


def names(group):
    """Of the recordings in a group of ../shared/tools/recordings."""
    if not os.path.exists(RECORDINGS):
        return []
    lines = subprocess.run([RECORDINGS, "list"], stdout=subprocess.PIPE, text=True, check=True).stdout.splitlines()
    rows = [line.split() for line in lines if not line.startswith("#")]
    return [row[0] for row in rows if row[1] == group]


def simulated(wanted, log):
    """Folders of these recordings; those that are missing are made, which takes minutes."""
    if not wanted or not os.path.exists(RECORDINGS):
        return []
    with open(log, "w", encoding="utf-8") as file:  # its status says nothing of those that were made
        made = subprocess.run([RECORDINGS, "make"] + wanted, stdout=subprocess.PIPE, stderr=file, text=True, check=False)
    folders = made.stdout.split()
    for folder in folders:
        if not whole(folder):
            print(f"results: {os.path.basename(folder)} could not be made ({log}): left out", file=sys.stderr)
    return [folder for folder in folders if whole(folder)]


def recordings(group, only, log):
    """Folders of a group of simulated recordings as they are, or of those that are named in `only`."""
    if group != "old":
        return simulated([name for name in names(group) if name in only or not only], log)
    return [os.path.join(OLD, name) for name in sorted(os.listdir(OLD))] if os.path.isdir(OLD) else []


def degraded(log):
    """(name, folder, name of the unchanged copy, how it is made) of the copies of each original, made or not."""
    journey = simulated(["lap_a"], log)
    tool = degrade_tool(os.path.dirname(journey[0]), log) if journey else None
    if not tool:
        print(f"results: degraded copies cannot be made ({log}): left out", file=sys.stderr)
        return []
    parent, out, originals = os.path.join(os.path.dirname(journey[0]), "degraded"), [], {}
    for line in COPIES.split("\n")[1:-1]:
        name, what, *options = line.split()
        if name not in originals:
            originals[name] = original(name, parent, log)
            if not originals[name]:
                print(f"results: {name} is not there: its degraded copies are left out", file=sys.stderr)
        if originals[name]:
            folder = os.path.join(parent, f"{name}_{what}")
            out.append((os.path.basename(folder), folder, f"{name}_{UNCHANGED}", [tool, originals[name], folder] + options))
    return out


def original(name, parent, log):
    """Folder of a recording as the tool reads it, or None."""
    if os.path.isdir(os.path.join(OLD, name)):
        return plain(os.path.join(OLD, name), os.path.join(parent, name))
    return (simulated([name], log) + [None])[0]


def degrade_tool(cache, log):
    """The program, compiled unless it is there and newer than its source."""
    tool = os.path.join(cache, ".degrade")
    if not os.path.exists(DEGRADE):
        return None
    if not os.path.exists(tool) or os.path.getmtime(tool) < os.path.getmtime(DEGRADE):
        with open(log, "a", encoding="utf-8") as file:
            made = subprocess.run(["g++", "-std=c++20", "-O2", "-w", "-o", tool, DEGRADE], stderr=file, check=False)
        if made.returncode != 0:
            return None
    return tool


def plain(source, folder):
    """A recording whose events are compressed, as the tool reads it: events as plain text. None if there is none."""
    if not whole(source):
        return None
    if not whole(folder):
        part = f"{folder}.{os.getpid()}"
        os.makedirs(part, exist_ok=True)
        for name in os.listdir(source):
            if name != "events.txt.zst":
                shutil.copy(os.path.join(source, name), part)
        subprocess.run(["zstd", "-dqf", os.path.join(source, "events.txt.zst"), "-o", os.path.join(part, "events.txt")],
                       check=True)
        os.rename(part, folder)
    return folder


def make_copy(command):
    """Runs a command of `degraded`, once; what went wrong or None. An interrupted copy is not taken for a whole one, and one
    whose options change nothing, such as a range that the recording never reaches, is refused."""
    tool, source, folder, *options = command
    if whole(folder):
        return None
    part = f"{folder}.{os.getpid()}"
    made = subprocess.run([tool, source, part] + options, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)
    if made.returncode != 0:
        shutil.rmtree(part, ignore_errors=True)
        return made.stderr.strip() or f"degrade: status {made.returncode}"
    if options and same_data(source, part, tool):
        shutil.rmtree(part)
        return "its options change nothing of this recording"
    os.rename(part, folder)
    return None


def same_data(source, copy, tool):
    """Whether a copy is what the tool makes of a recording without options."""
    if not os.path.samefile(os.path.join(source, "events.txt"), os.path.join(copy, "events.txt")):
        return False  # events that no option touches are linked
    with tempfile.TemporaryDirectory(dir=os.path.dirname(copy)) as folder:
        plain_copy = os.path.join(folder, "unchanged")
        subprocess.run([tool, source, plain_copy], stdout=subprocess.DEVNULL, check=True)
        names = ["imu.txt", "camchain-imucam.yaml", "imu.yaml"]
        return not any(filecmp.cmpfiles(copy, plain_copy, names, shallow=False)[1:])
