"""Writes what has been fuzzed, flown and killed so far into the page of this folder, from its tables.

    python benchmarks/reliability/summary.py            # writes the tables
    python benchmarks/reliability/summary.py --check    # writes nothing; fails where the page is not up to date

Rows of pieces with failures count with these: a piece that was run again has one row, its last.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))  # the generated sections of pages are written as those of other benchmarks

from fuzz_kinds import KINDS  # noqa: E402
from kills import COMMANDS, MADE_BY, NO_KILL  # noqa: E402
from page_sections import replace_section, wrap  # noqa: E402
from soak import MADE_WITH, PIECE, versions_of  # noqa: E402
from tables import of_versions, rows_of  # noqa: E402

from thalweg.bench.report.table import frame, markdown  # noqa: E402
from thalweg.core.atomic_io import write_atomic  # noqa: E402

PAGE = HERE / "README.md"
NOTHING = "Nothing yet.\n"
FUZZED = ("kind", "piece", "files", "read", "refused", "failed", "commit")
SOAKED = {what: (*PIECE, *names, "faults") for what, names in MADE_WITH.items()}
KILLED = ("command", "trial", "kill", "finished", "faults", "made_with")
WANTED_STEPS, WANTED_FRAMES, WANTED_KILLS = 100_000_000, 1_000_000, 50
"""Steps, frames, and kills of each command that the whole has; of files, see `Kind.wanted`."""


def fuzzed(rows: Sequence[dict[str, str]]) -> str:
    """Return the files that were read so far, by the ending of their names."""
    endings: dict[str, list[str]] = {}
    for name, kind in KINDS.items():
        endings.setdefault(Path(kind.file).suffix or "no ending", []).append(name)
    lines = []
    for ending, names in sorted(endings.items()):
        own = [row for row in rows if row["kind"] in names]
        files, *sums = (sum(int(row[column]) for row in own) for column in ("files", "read", "refused", "failed"))
        so_far = f"{files:,} of {sum(KINDS[name].wanted for name in names):,}"
        lines.append([ending, str(len(names)), so_far, *(f"{each:,}" for each in sums)])
    if not rows:
        return NOTHING
    header = ["files", "kinds", "so far", "read", "refused", "failed"]
    dates = sorted({row["commit"].split()[0] for row in rows} - {"unknown"})
    span = " to ".join(dict.fromkeys((dates[0], dates[-1]))) if dates else "an unknown date"
    made = wrap(
        f"Read by the code of commits of {span}. A piece without failures is not read again when the code changes."
    )
    return f"{markdown(frame(header, lines))}\n{made}"


def soaked(steps: Sequence[dict[str, str]], frames: Sequence[dict[str, str]]) -> str:
    """Return the steps and frames so far, of today's versions alone."""
    lines = []
    for what, rows, wanted in (("steps", steps, WANTED_STEPS), ("frames", frames, WANTED_FRAMES)):
        pieces = {row["piece"]: row for row in of_versions(rows, versions_of(what))}
        amount, rivers, faults = (
            sum(int(row[name]) for row in pieces.values()) for name in ("amount", "rivers", "faults")
        )
        lines.append([what, f"{amount:,} of {wanted:,}", f"{rivers:,}", str(faults)])
    return markdown(frame(["", "so far", "rivers", "faults"], lines)) if steps or frames else NOTHING


def killed(rows: Sequence[dict[str, str]]) -> str:
    """Return the kills so far, by command and by the versions of what it trains; today's come first."""
    lines = []
    found = ((row["command"], row["made_with"]) for row in rows)
    for command, made_with in sorted({*MADE_BY.items(), *found}, key=lambda each: place_of(*each)):
        own = [row for row in rows if (row["command"], row["made_with"]) == (command, made_with)]
        kills = [row for row in own if row["kill"] != NO_KILL]
        trials = {row["trial"]: row for row in own}
        faulty = sum(row["faults"] != "0" for row in trials.values())
        after = sum(row["finished"] != "0" for row in kills)
        counts = f"{len(kills)} of {WANTED_KILLS}", str(after), str(len(trials)), str(faulty)
        lines.append([f"`{command}`", made_with, *counts])
    header = ["command", "trains", "kills", "after something was finished", "trials", "trials with faults"]
    return markdown(frame(header, lines)) if rows else NOTHING


def place_of(command: str, made_with: str) -> tuple[int, bool, str]:
    """Return the place of a line among the kills."""
    return list(COMMANDS).index(command), made_with != MADE_BY[command], made_with


def written_page(page: str, folder: Path = HERE) -> str:
    """Return the page with what the tables of a folder have today."""
    page = replace_section(page, "fuzzed", fuzzed(rows_of(folder / "fuzz.csv", FUZZED)))
    both = (rows_of(folder / f"soak_{what}.csv", columns) for what, columns in SOAKED.items())
    page = replace_section(page, "soaked", soaked(*both))
    return replace_section(page, "killed", killed(rows_of(folder / "kills.csv", KILLED)))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; fail where the page is not up to date")
    old = PAGE.read_text(encoding="utf-8")
    new = written_page(old)
    if parser.parse_args().check:
        return int(new != old)
    write_atomic(PAGE, new)
    return 0


if __name__ == "__main__":
    sys.exit(main())
