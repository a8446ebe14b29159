#!/usr/bin/env python3
"""Whether each code of a warning in the sources is explained in docs/troubleshooting.md."""
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent


def main():
    codes = {"refused_event", "refused_imu", "out_of_order_event", "out_of_order_imu"}  # put together in the sources
    for folder in ("src", "apps"):
        for path in (ROOT / folder).rglob("*.cpp"):
            codes.update(re.findall(r'(?:warn|replace)\(\s*"([a-z_]+)"', path.read_text(encoding="utf-8")))
    text = (ROOT / "docs/troubleshooting.md").read_text(encoding="utf-8")
    missing = sorted(code for code in codes if f"`{code}`" not in text)
    for code in missing:
        print(f"docs/troubleshooting.md: `{code}` is not explained")
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
