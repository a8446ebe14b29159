"""What scripts/results --judge runs: programs on real pieces and simulated recordings, two at a time, and their figures."""
import concurrent.futures
import math
import os
import subprocess
import sys
import threading

from results_judge_table import FAILED
from results_recordings import SHARED, degraded, make_copy, recordings
from results_table import load

REAL_LINES = os.path.join(SHARED, "tools", "real_lines")
REAL = {"rotDisk": "davis240c_IMU_rotDisk", "shapes_rotation": "rpg_shapes_rotation_0-1.43s",
        "shapes_rotation_fast": "rpg_shapes_rotation", "slider_depth": "rpg_slider_depth",
        "shapes_6dof_start": "rpg_shapes_6dof_start"}
WITH_IMU = ("rotDisk", "shapes_rotation")
GROUPS = ("real", "sensor", "motion", "old", "journey", "degraded")
LINES_KNOWN = ("sensor", "motion", "old")  # groups whose segments are judged, by study_frontend
OF_COPIES = ("mm", "deg", "mpe", "poses", "restarts")
TIMEOUT_S = 900


def run(command, log):
    """What went wrong or None, and the CPU time it took [s], which other programs on the machine hardly change."""
    with open(log, "w", encoding="utf-8") as file:
        process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT)
    timer = threading.Timer(TIMEOUT_S, process.kill)
    timer.start()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if not timer.is_alive():
        return f"took more than {TIMEOUT_S} s", usage.ru_utime
    timer.cancel()
    if process.returncode == 0:
        return None, usage.ru_utime + usage.ru_stime
    with open(log, encoding="utf-8", errors="replace") as file:
        last = (file.read().strip().splitlines() or [""])[-1]
    return last or f"status {process.returncode}", usage.ru_utime


def fresh(folder):
    """The folder, without what an earlier run would pass off as this one's."""
    os.makedirs(folder, exist_ok=True)
    for name in os.listdir(folder):
        if name.endswith((".json", ".txt", ".csv")):
            os.remove(os.path.join(folder, name))
    return folder


def settings(args):
    return [word for entry in args.set for word in ("--set", entry)]


def odometry(args, folder, out):
    """Figures of `idol run` on a recording with exact truth, what failed, and the kinds of warnings."""
    fresh(out)
    failure, cpu_s = run([args.idol, "run", folder, "--out", out] + settings(args), os.path.join(out, "run.log"))
    figures = {}
    stats = load(os.path.join(out, "stats.json"))
    whole = stats is not None and stats["status"] == "done"  # the beginning alone would pass for a good run
    if stats:
        counts = stats["front_end"]
        figures.update(in_segments=100 * counts["in_segments"] / max(1, counts["events"]), restarts=stats["restarts"],
                       cpu=cpu_s / max(1e-3, stats["duration_s"]))
    causal, smoothed = (load(os.path.join(out, name + ".json")) for name in ("evaluation_causal", "evaluation"))
    figures["poses"] = 100 * causal["coverage"] if causal else 0
    figures.update(FAILED)
    if causal and whole:
        full = causal["protocols"]["full"]
        figures.update(mm=1000 * full["translation_m"]["rmse"], deg=full["rotation_deg"]["rmse"], mpe=full["mpe_percent"])
    if smoothed and whole:
        figures["smoothed_mm"] = 1000 * smoothed["protocols"]["full"]["translation_m"]["rmse"]
    return {"figures": figures, "failure": failure or (None if causal and smoothed else "no trajectory to judge"),
            "warnings": sorted(stats["warnings"]) if stats else []}


def odometry_and_lines(args, folder, out):
    """Besides, recall and purity of the segments."""
    entry = odometry(args, folder, out)
    log = os.path.join(out, "study.log")
    failure, _ = run([args.study] + args.set + [folder], log)
    if failure:
        entry["failure"] = entry["failure"] or "study: " + failure
    else:
        entry["figures"].update(study_figures(log))
    return entry


def odometry_of_copy(args, folder, unchanged, command, out):
    """On a degraded copy, which is made first."""
    failure = make_copy(command)
    if failure:
        return {"figures": {}, "failure": failure, "warnings": [], "unchanged": unchanged}
    entry = odometry(args, folder, out)
    figures = {name: value for name, value in entry["figures"].items() if name in OF_COPIES}
    return {**entry, "figures": figures, "unchanged": unchanged}


def add_ratios(rows):
    """Of the errors of degraded copies to that of the unchanged one, where that was run too."""
    for name, entry in rows.items():
        unchanged = rows.get(entry["unchanged"], {"figures": {}})["figures"]
        if name != entry["unchanged"] and "mm" in entry["figures"] and "mm" in unchanged:
            entry["figures"]["ratio"] = entry["figures"]["mm"] / unchanged["mm"]


def study_figures(path):
    """Recall, and purity of events within 3 px of a listed line in segments mostly there; a dash where nothing is labelled."""
    with open(path, encoding="utf-8") as file:
        cells = file.read().strip().splitlines()[-1].split("|")
    values = {"purity": float(cells[2].rstrip(" )").split(", ")[1]), "recall": float(cells[4])}
    return {name: value for name, value in values.items() if math.isfinite(value)}


def real(args, piece, preset, out):
    """The front-end on a real piece against its true lines."""
    fresh(out)
    labels, score = os.path.join(out, "segments.txt"), os.path.join(out, "score.json")
    failure, _ = run([args.idol, "segment", data_of(piece), "--out", labels, "--preset", preset] + settings(args),
                     os.path.join(out, "segment.log"))
    if not failure:
        scorer = [sys.executable, os.path.join(REAL_LINES, "score_real.py"), piece, labels, "--json", score]
        failure, _ = run(scorer, os.path.join(out, "score.log"))
    found = load(score) or {}
    names = {"recall": "recall20", "purity": "purity", "covered": "covered", "life": "life"}
    figures = {} if found else {"recall": 0.0, "covered": 0.0, "life": 0.0}
    figures.update({name: found[key] for name, key in names.items() if found.get(key) is not None})
    if "labelled_share" in found:
        figures["in_segments"] = 100 * found["labelled_share"]
    return {"figures": figures, "failure": failure}


def real_odometry(args, piece, out):
    import results_real  # needs numpy, which only the real pieces do
    fresh(out)
    failure, _ = run([args.idol, "run", data_of(piece), "--out", out] + settings(args), os.path.join(out, "run.log"))
    try:
        truth = os.path.join(REAL_LINES, "truth", piece + ".txt")
        return {"figures": results_real.ODOMETRY[piece](out, data_of(piece), truth), "failure": failure}
    except (OSError, ValueError, IndexError) as error:
        return {"figures": {}, "failure": failure or f"no trajectory to judge ({error})"}


def data_of(piece):
    return os.path.join(SHARED, "data", "real", REAL[piece])


def events_size(folder):
    return sum(os.path.getsize(os.path.join(folder, name)) for name in os.listdir(folder) if "events" in name)


def jobs_of(group, args):
    """(name in the results, size, function, arguments) of each thing to run."""
    jobs = []
    if group == "real" and os.path.isdir(REAL_LINES):
        for piece in REAL:
            for preset in ["realtime"] + ["paper"] * args.paper:
                jobs.append((f"{piece} {preset}", 1e6, real, (piece, preset, os.path.join(args.out, group, preset, piece))))
        for piece in WITH_IMU:
            jobs.append((f"{piece} odometry", 1e6, real_odometry, (piece, os.path.join(args.out, group, "run", piece))))
    elif group == "degraded":
        for name, folder, unchanged, command in degraded(os.path.join(args.out, group + ".log")):
            out = os.path.join(args.out, group, name)
            jobs.append((name, events_size(command[1]), odometry_of_copy, (folder, unchanged, command, out)))
    elif group != "real":
        for folder in recordings(group, args.only, os.path.join(args.out, group + ".log")):
            name = os.path.basename(folder)
            function = odometry_and_lines if group in LINES_KNOWN else odometry
            jobs.append((name, events_size(folder), function, (folder, os.path.join(args.out, group, name))))
    if args.only:
        jobs = [job for job in jobs if job[0].split()[0] in args.only]
    elif not jobs:
        print(f"results: no recordings for the group '{group}': left out", file=sys.stderr)
    return [(group,) + job for job in jobs]


def run_all(args):
    jobs = [job for group in args.group for job in jobs_of(group, args)]
    results = {group: {} for group in args.group if any(job[0] == group for job in jobs)}
    with concurrent.futures.ThreadPoolExecutor(2) as pool:  # the longest first
        running = {}
        for job in sorted(jobs, key=lambda job: -job[2]):
            running[job[:2]] = pool.submit(job[3], args, *job[4])
        for job in jobs:
            results[job[0]][job[1]] = running[job[:2]].result()
            failure = results[job[0]][job[1]]["failure"]
            print(f"results: {job[0]}: {job[1]}" + (f": {failure}" if failure else ""), file=sys.stderr)
    return results
