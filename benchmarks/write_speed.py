"""Writes the table of `benchmarks/speed.json` into the README, between its marks, so that no figure is typed."""

import json
import re
import sys
from pathlib import Path

from thalweg.bench.speed import COLUMNS, describe, table_rows
from thalweg.bench.tables import markdown

ROOT = Path(__file__).resolve().parent.parent
SPEED, README = ROOT / "benchmarks" / "speed.json", ROOT / "README.md"
MARKS = re.compile(r"(?<=<!-- speed -->\n).*?(?=<!-- /speed -->)", flags=re.DOTALL)


def section() -> str:
    """What the README says about speed."""
    if not SPEED.exists():
        return "Not measured yet.\n"
    found = json.loads(SPEED.read_text())
    return (
        f"{markdown(list(COLUMNS), table_rows(found))}\nMedian, slowest and fastest repetition on {describe(found)}.\n"
    )


def main() -> int:
    """Write the section; with `--check` only say by the exit status whether it is up to date."""
    old = README.read_text()
    new = MARKS.sub(lambda _: section(), old)
    if "--check" in sys.argv:
        return int(new != old)
    README.write_text(new)
    return 0


if __name__ == "__main__":
    sys.exit(main())
