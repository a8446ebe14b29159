"""Tables of scripts/results --judge: rows for recordings and groups, and what changed."""
import math

FAILED = {"mm": 1e4, "deg": 90.0, "mpe": 100.0, "smoothed_mm": 1e4}
# Figures: title, digits; geometric mean or arithmetic; the smaller the better (-1), the larger (1).
FIGURES = {
    "recall": ("recall", 3, "share", 1), "purity": ("purity", 3, "share", 1), "covered": ("covered", 3, "share", 1),
    "life": ("life", 3, "share", 1), "in_segments": ("in segments %", 1, "share", 0),
    "mm": ("causal: RMSE mm", 2, "error", -1), "deg": ("deg", 3, "error", -1), "mpe": ("MPE %", 3, "error", -1),
    "ratio": ("ratio to unchanged", 2, "error", -1),
    "smoothed_mm": ("smoothed: RMSE mm", 2, "error", -1), "poses": ("poses cover %", 1, "share", 0),
    "restarts": ("restarts", 1, "share", 0), "cpu": ("CPU s per s", 2, "error", 0)}
ODOMETRY = {"roll_deg": "roll off by {:.2f} deg of {of_deg:.1f}", "tilt_deg": "tilt at the end by {:.2f} deg",
            "bias_deg_s": "gyro bias by {:.2f} deg/s", "turn_deg": "turn off by {:.2f} deg of {of_deg:.1f}",
            "all_deg": "all poses by {:.2f} deg RMS"}


def mean(rows, name):
    values = [row["figures"][name] for row in rows if name in row["figures"]]
    if not values:
        return None
    if FIGURES[name][2] == "share":
        return sum(values) / len(values)
    most = FAILED.get(name, math.inf)
    return math.exp(sum(math.log(min(most, max(1e-6, value))) for value in values) / len(values))


def cell(name, value):
    return "–" if value is None else f"{value:.{FIGURES[name][1]}f}"


def header(titles):
    return ["| " + " | ".join(titles) + " |", "|---|" + "--:|" * (len(titles) - 1)]


def row(cells):
    return "| " + " | ".join(cells) + " |"


def judged(rows, kind):
    return {key: value for key, value in rows.items() if key.endswith(" " + kind)}


def columns_of(groups):
    used = {name for rows in groups for entry in rows.values() for name in entry["figures"]}
    return [name for name in FIGURES if name in used]


def lines_and_runs(group, rows):
    """A group's rows by kind: those that make means, and the odometry of real pieces."""
    if group != "real":
        return {group: rows}, {}
    kinds = {f"real, {preset}": judged(rows, preset) for preset in ("realtime", "paper")}
    return {kind: found for kind, found in kinds.items() if found}, judged(rows, "odometry")


def odometry_text(rows):
    parts = []
    for key, entry in rows.items():
        figures = entry["figures"]
        text = ", ".join(form.format(figures[name], **figures) for name, form in ODOMETRY.items() if name in figures)
        parts.append(f"{key.split()[0]}: {text or 'failed: ' + str(entry['failure'])}")
    return "; ".join(parts)


def section(group, rows):
    """A row for each recording, and their mean; of degraded copies also what the program warned of."""
    kinds, odometry = lines_and_runs(group, rows)
    names, warned = columns_of(kinds.values()), ["warnings"] * (group == "degraded")
    out = header(["recording"] + [FIGURES[name][0] for name in names] + warned)
    for kind, found in kinds.items():
        for key, entry in found.items():
            failure = f" (failed: {entry['failure'].replace('|', '/')})" if entry["failure"] else ""
            kinds_warned = [", ".join(entry[name]) for name in warned]
            out.append(row([key + failure] + [cell(name, entry["figures"].get(name)) for name in names] + kinds_warned))
        out.append(row([f"**mean, {kind}**"] + [cell(name, mean(found.values(), name)) for name in names] + [""] * len(warned)))
    return out + (["", "Odometry: " + odometry_text(odometry) + "."] if odometry else [])


def summary(results, before):
    """A row for each group, with the same of before and the change where there is a before."""
    groups = {kind: rows for group, found in results.items() for kind, rows in lines_and_runs(group, found)[0].items()}
    old = {kind: rows for group, found in before.items() for kind, rows in lines_and_runs(group, found)[0].items()}
    names = columns_of(groups.values())
    out = header(["group"] + [FIGURES[name][0] for name in names] + ["failed"])
    for kind, rows in groups.items():
        failed = sum(bool(entry["failure"]) for entry in rows.values())
        out.append(row([f"{kind} ({len(rows)})"] + [cell(name, mean(rows.values(), name)) for name in names] + [str(failed)]))
        both = [key for key in rows if key in old.get(kind, {})]
        if both:
            same = [old[kind][key] for key in both]
            failed = sum(bool(entry["failure"]) for entry in same)
            out.append(row([f"before ({len(both)})"] + [cell(name, mean(same, name)) for name in names] + [str(failed)]))
            out.append(row(["change"] + [change(name, same, [rows[key] for key in both]) for name in names] + [""]))
    for title, found in (("odometry on real pieces", results), ("before", before)):
        text = odometry_text(judged(found.get("real", {}), "odometry"))
        out += ["", f"{title}: {text}"] if text else []
    return out + largest_changes(groups, old)


def change(name, before, rows):
    """Of the mean of those that have the figure both times."""
    pairs = [(a, b) for a, b in zip(before, rows) if name in a["figures"] and name in b["figures"]]
    if not pairs:
        return ""
    then, now = (mean(part, name) for part in zip(*pairs))
    if FIGURES[name][2] == "share":
        return f"{now - then:+.{FIGURES[name][1]}f}"
    return f"{100 * (now / then - 1):+.0f} %"


def largest_changes(groups, old):
    """Recordings whose error changed most, and real pieces and others whose recall did."""
    out = []
    for name, amount in (("mm", math.log), ("recall", float)):
        found = []
        for kind, rows in groups.items():
            for key, entry in rows.items():
                then, now = (x.get("figures", {}).get(name) for x in (old.get(kind, {}).get(key, {}), entry))
                if then is not None and now is not None and (name != "mm" or min(then, now) > 0):
                    found.append((FIGURES[name][3] * (amount(now) - amount(then)), key, cell(name, then), cell(name, now)))
        found.sort()
        for title, part in (("worse", found[:5]), ("better", found[:-6:-1])):
            sign = -1 if title == "worse" else 1
            text = ", ".join(f"{key} {then} to {now}" for by, key, then, now in part if sign * by > 0.005)
            if text:
                out += ["", f"{FIGURES[name][0]}, {title}: {text}"]
    return out
