"""Makes the markdown table of scripts/results from the JSON of runs and evaluations. Standard library only."""
import argparse
import json
import math
import os
import re
import sys

COLUMNS = [
    ("recording", "l"), ("trajectory", "l"), ("covered %", "r"),
    ("full: MPE %", "r"), ("RMSE mm", "r"), ("RMSE deg", "r"),
    ("idol: RMSE mm", "r"), ("RMSE deg", "r"), ("idol*: RMSE mm", "r"), ("RMSE deg", "r"),
    ("uslam: MPE %", "r"), ("MYE deg/m", "r"), ("hku: MPE %", "r"),
    ("sim3: RMSE mm", "r"), ("MPE %", "r"), ("scale", "r"),
    ("30 % segments: median %", "r"), ("median deg", "r"),
    ("windows", "r"), ("lines", "r"), ("wall s", "r"), ("real-time factor", "r"),
]


def load(path):
    try:
        with open(path, encoding="utf-8") as file:
            return json.load(file)
    except (OSError, ValueError):
        return None


def figure(data, *path, scale=1.0, digits=2):
    """The number at `path` of nested dictionaries, or a dash."""
    for key in path:
        data = data.get(key) if isinstance(data, dict) else None
    return "–" if data is None else f"{scale * data:.{digits}f}"


def covered(evaluation, sequence, begin, to):
    """Share of the span that was to be run (not of the whole recording) that the estimate covers."""
    stamps = []
    with open(os.path.join(sequence, "groundtruth.txt"), encoding="utf-8") as file:
        for line in file:
            if line.strip() and not line.startswith("#"):
                stamps.append(float(re.split(r"[\s,]+", line.strip())[0]))
    whole = stamps[-1] - stamps[0]
    span = whole if to == "end" else min(whole, float(to))
    return f"{100 * evaluation['coverage'] * whole / (span - float(begin)):.1f}"


def accuracy(evaluation, sequence, begin, to):
    p = evaluation["protocols"]
    cells = [covered(evaluation, sequence, begin, to),
             figure(p, "full", "mpe_percent"),
             figure(p, "full", "translation_m", "rmse", scale=1000, digits=1),
             figure(p, "full", "rotation_deg", "rmse")]
    for entry in ([], ["yaw_from_rotations"]):
        cells += [figure(p, "idol", *entry, "translation_m", "rmse", scale=1000, digits=1),
                  figure(p, "idol", *entry, "rotation_deg", "rmse")]
    return cells + [
        figure(p, "uslam", "mpe_percent"), figure(p, "uslam", "mye_deg_per_m", digits=3),
        figure(p, "hku", "mpe_percent"),
        figure(p, "sim3", "translation_m", "rmse", scale=1000, digits=1), figure(p, "sim3", "mpe_percent"),
        figure(p, "sim3", "scale", digits=4),
        figure(p, "segments", "30", "translation_percent", "median"),
        figure(p, "segments", "30", "rotation_deg", "median")]


def rows_of(name, run, sequence, failure, begin, to):
    """One row for each of the two trajectories; the figures of the run stand in the first."""
    stats = load(os.path.join(run, "stats.json"))
    cost = [figure(stats, "windows", digits=0), figure(stats, "lines", digits=0),
            figure(stats, "wall_s", digits=1), figure(stats, "realtime_factor", digits=3)]
    rows = []
    for label, file in (("smoothed", "trajectory_camera"), ("causal", "trajectory_camera_causal")):
        evaluation = load(os.path.join(run, file + ".json"))
        cells = accuracy(evaluation, sequence, begin, to) if evaluation else ["–"] * (len(COLUMNS) - 2 - len(cost))
        rows.append([name if not rows else "", label] + cells + (cost if not rows else [""] * len(cost)))
    if failure:
        rows[0][0] += " (failed: " + failure.replace("|", "/") + ")"
    return rows


def processor():
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            model = re.search(r"^model name\s*:\s*(.*)$", file.read(), re.MULTILINE)
    except OSError:
        model = None
    return f"{os.cpu_count()} cores" + (f" of {model.group(1)}" if model else "")


def markdown(args):
    lines = [f"Made by `{args.command}` on {processor()}. idol* = protocol `idol` with the yaw from the rotations, "
             "where the first 50 poses span less than 5 cm. Protocols: [evaluation.md](evaluation.md).", "",
             "| " + " | ".join(title for title, _ in COLUMNS) + " |",
             "|" + "|".join("---" if side == "l" else "--:" for _, side in COLUMNS) + "|"]
    for entry in args.list.read().splitlines():
        for row in rows_of(*entry.split("\t"), args.begin, args.to):
            lines.append("| " + " | ".join(row) + " |")
    return "\n".join(lines) + "\n"


def ablation(args):
    """One row for each variant: causal RMSE of position and rotation by recording, and the geometric means."""
    variants = []
    for line in args.list.read().splitlines():
        title, path = line.split("\t")
        with open(path, encoding="utf-8") as file:
            variants.append((title, [entry.split("\t") for entry in file.read().splitlines()]))
    names = [entry[0] for entry in variants[0][1]]
    lines = [f"Made by `{args.command}` on {processor()}. Causal trajectory, protocol `full`: RMSE in mm / deg.", "",
             "| | " + " | ".join(names) + " | geometric mean |", "|---|" + "--:|" * (len(names) + 1)]
    for title, entries in variants:
        cells, logs = [], []
        for _, run, _, _ in entries:
            p = (load(os.path.join(run, "trajectory_camera_causal.json")) or {}).get("protocols")
            cells.append(figure(p, "full", "translation_m", "rmse", scale=1000, digits=1) + " / " +
                         figure(p, "full", "rotation_deg", "rmse"))
            if p:
                logs.append([math.log(1000 * p["full"]["translation_m"]["rmse"]), math.log(p["full"]["rotation_deg"]["rmse"])])
        mean = [math.exp(sum(column) / len(logs)) for column in zip(*logs)] if logs else []
        cells.append("{:.1f} / {:.2f}".format(*mean) if len(logs) == len(entries) else "–")
        lines.append("| " + " | ".join([title] + cells) + " |")
    return "\n".join(lines) + "\n"


def stress(args):
    """One short row for each recording."""
    titles = ["", "causal: RMSE mm", "deg", "MPE %", "smoothed: RMSE mm", "deg", "first good pose s", "restarts",
              "real-time factor"]
    lines = [f"Made by `{args.command}` on {processor()}. Protocol `full`.", "",
             "| " + " | ".join(titles) + " |", "|---|" + "--:|" * (len(titles) - 1)]
    for entry in args.list.read().splitlines():
        title, run, _, failure = entry.split("\t")
        cells = [title + (" (failed: " + failure.replace("|", "/") + ")" if failure else "")]
        for file in ("trajectory_camera_causal", "trajectory_camera"):
            p = (load(os.path.join(run, file + ".json")) or {}).get("protocols")
            cells += [figure(p, "full", "translation_m", "rmse", scale=1000, digits=1),
                      figure(p, "full", "rotation_deg", "rmse")]
            if file.endswith("causal"):
                cells.append(figure(p, "full", "mpe_percent"))
        stats = load(os.path.join(run, "stats.json"))
        cells += [figure(stats, "first_good_pose_s"), figure(stats, "restarts", digits=0),
                  figure(stats, "realtime_factor")]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def replace_section(path, name, table):
    begin, end = f"<!-- results:begin {name} -->", f"<!-- results:end {name} -->"
    text = ""
    if os.path.exists(path):
        with open(path, encoding="utf-8") as file:
            text = file.read()
    block = f"{begin}\n{table}{end}"
    if begin in text:
        if end not in text[text.index(begin):]:
            sys.exit(f"results: {path}: '{begin}' has no '{end}' behind it; add that line")
        at = text.index(begin)
        text = text[:at] + block + text[text.index(end, at) + len(end):]
    else:
        text = (text.rstrip("\n") + "\n\n" if text else "") + block + "\n"
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("list", type=argparse.FileType(encoding="utf-8"),
                        help="lines of: name, folder of the run, sequence, failure; parted by tabs. With --ablation: of "
                             "title and such a list")
    parser.add_argument("--ablation", action="store_true")
    parser.add_argument("--stress", action="store_true")
    parser.add_argument("--from", dest="begin", default="0")
    parser.add_argument("--to", default="end")
    parser.add_argument("--command", required=True)
    parser.add_argument("--section")
    parser.add_argument("--file")
    args = parser.parse_args()
    table = ablation(args) if args.ablation else stress(args) if args.stress else markdown(args)
    if args.section:
        replace_section(args.file, args.section, table)
    else:
        sys.stdout.write(table)


if __name__ == "__main__":
    main()
