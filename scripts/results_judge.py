"""Runs what a change of the method is judged by: real pieces with true lines, groups of simulated recordings, among them
journeys of minutes, and degraded copies of recordings, as a worse sensor would have sent them.

Two programs run at a time. With one group: a row for each recording. With all: a row for each group, and, with --against,
the same of an earlier folder. Mean of shares (recall, purity, ...): arithmetic; of errors: geometric. No
trajectory, or a worse one, counts as 10 m, 90 deg and 100 % there. Exit status: 0 all well, 1 something failed.
"""
import argparse
import json
import os
import sys

from results_judge_runs import GROUPS, LINES_KNOWN, add_ratios, run_all
from results_judge_table import section, summary
from results_recordings import ROOT
from results_table import load, processor, replace_section


def main():
    parser = argparse.ArgumentParser(prog="scripts/results", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--judge", action="store_true", help="all groups, a row for each (the default)")
    parser.add_argument("--group", action="append", choices=GROUPS,
                        help="this group alone, a row for each recording; may be repeated")
    parser.add_argument("--idol", default=os.path.join(ROOT, "build/release/idol"), help="program to use")
    parser.add_argument("--study", help="study_frontend to use (default: bench/study_frontend beside the program)")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE",
                        help="an option, for all programs; may be repeated")
    parser.add_argument("--only", action="append", default=[], metavar="NAME",
                        help="this recording or piece alone; may be repeated")
    parser.add_argument("--paper", action="store_true", help="real pieces by the preset `paper` besides")
    parser.add_argument("--out", default=os.path.join(ROOT, "build/results/judge"), help="where runs and figures (judge.json) go")
    parser.add_argument("--against", metavar="FOLDER", help="an earlier --out to compare with")
    parser.add_argument("--only-table", action="store_true", help="run nothing, show what is in --out")
    parser.add_argument("--section", help="put the table there in docs/results.md, or in --file, instead of printing it")
    parser.add_argument("--file", default=os.path.join(ROOT, "docs/results.md"))
    command = " ".join(["scripts/results"] + [word for word in sys.argv[1:] if word != "--only-table"])
    args = parser.parse_args()
    alone = args.group is not None and not args.against
    args.group = args.group or list(GROUPS)
    args.study = args.study or os.path.join(os.path.dirname(args.idol), "bench", "study_frontend")
    stored = os.path.join(args.out, "judge.json")
    before = {}
    if args.against:
        before = load(os.path.join(args.against, "judge.json"))
        if before is None:
            parser.error(f"--against: {args.against} has no judge.json")
    if args.only_table:
        results = {group: rows for group, rows in (load(stored) or {}).items() if group in args.group}
    else:
        for program in [args.idol] + [args.study] * any(group in LINES_KNOWN for group in args.group):
            if not os.access(program, os.X_OK):
                sys.exit(f"results: {program}: not there; build it (cmake --build --preset release) or give --idol and --study")
        os.makedirs(args.out, exist_ok=True)
        results = run_all(args)
        stored_now = load(stored) or {}  # other groups stay, and with --only other recordings
        for group, rows in results.items():
            stored_now[group] = {**(stored_now.get(group, {}) if args.only else {}), **rows}
        add_ratios(stored_now.get("degraded", {}))
        with open(stored, "w", encoding="utf-8") as file:
            json.dump(stored_now, file, indent=1)
    if not results:
        return
    if alone:
        lines = [line for group, rows in results.items() for line in section(group, rows) + [""]]
    else:
        lines = summary(results, before)
    if args.section:
        lines = [f"Made by `{command}` on {processor()}. Means: of errors geometric, of the rest arithmetic.", ""] + lines
        replace_section(args.file, args.section, "\n".join(lines).rstrip("\n") + "\n")
    else:
        print("\n".join(lines).rstrip("\n"))
    sys.exit(any(entry["failure"] for rows in results.values() for entry in rows.values()))


if __name__ == "__main__":
    main()
