"""Checks of algorithms through frames: trained with the packaged encoder on one river of Medium, and flown there.

    python benchmarks/through_frames.py --jobs 2                # trains and flies all that has no row yet
    python benchmarks/through_frames.py --only 'PPOLag-*'       # checks by their labels, see --list
    python benchmarks/through_frames.py --write                 # the table of docs/algorithms/README.md

A row of through_frames.csv is appended as a check is flown. One that has a row is skipped, and training resumes in the
folder `--runs`. A row names the versions, settings and encoder that it depends on: with others, its check is made
again. Settings are compared on a river and with seeds of their own, which the reported checks do not share.
"""

import argparse
import fnmatch
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from ladder import COLUMNS, Task, missing_cells, status_of
from ladder_arms import CELL_KEY, FIXED, Arm
from page_sections import replace_section
from river_flights import mean_return
from tables import rows_of

from thalweg.bench.report.policies import CRITICS_SEE
from thalweg.bench.report.table import frame, markdown
from thalweg.core import versions
from thalweg.core.atomic_io import write_atomic
from thalweg.train.observations import SEEN_BY_CRITICS
from thalweg.world import level_named

HERE = Path(__file__).resolve().parent
TABLE = HERE / "through_frames.csv"
PAGE, SECTION = HERE.parent / "docs" / "algorithms" / "README.md", "through frames"
LEVEL = "Medium"
STEPS, EPISODES = 200_000, 300
FLIGHTS = ("seen",)
"""Flights are on the river of training only."""
REPORTED, CHOOSING = level_named(LEVEL).default_seed, 4000
"""Seeds of the river of reported checks, the fixed one of the level, and of that where settings are compared."""
SEEDS = {REPORTED: (0, 1, 2), CHOOSING: (10, 11, 12)}
"""Seeds of the runs on each river."""


DEADLINES = re.compile(r" deadlines=\d+")
"""The version of deadlines among those of a row."""
BEFORE = f"before deadlines {versions.DEADLINES}"
"""Mark of runs whose critics of costs estimated what would come after the last step that counts."""


@dataclass(frozen=True)
class Check:
    """An algorithm that is trained on a river with some seeds."""

    algorithm: str
    river: int
    """`REPORTED` or `CHOOSING`."""
    runs: int = 3
    change: str = ""
    """Name of its `settings`; empty for the defaults."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings that differ from the defaults."""

    @property
    def name(self) -> str:
        """Name of its arms."""
        return f"{self.algorithm}-{self.change}" if self.change else self.algorithm

    @property
    def shown(self) -> str:
        """Name in the table."""
        changes = [f"`{name}={value}`" for name, value in self.settings.items()]
        return " ".join([f"{self.algorithm},", *changes]) if changes else self.algorithm

    def arms(self) -> list[Arm]:
        """Return its runs."""
        seeds = SEEDS[self.river][: self.runs]
        made_with = {"settings": self.settings, "first_river": self.river}
        return [Arm(self.name, self.algorithm, 1, FIXED, seed, STEPS, (LEVEL,), **made_with) for seed in seeds]


CHECKED = (
    Check("PPO", REPORTED),
    Check("PPOLag", REPORTED),
    Check("OnCRPO", REPORTED, runs=1),
    Check("TD3Lag", REPORTED, runs=1),
    Check("PPO", CHOOSING),
    Check("PPO", CHOOSING, change="symmetric", settings={"asymmetric_critics": False}),
    *(
        Check(name, CHOOSING, change=change, settings=settings)
        for name in ("PPOLag", "FOCOPS", "P3O", "OnCRPO", "CPO", "CUP", "TD3Lag")
        for change, settings in (("", {}), ("asymmetric", {"asymmetric_critics": True}))
    ),
)


def checks() -> list[Arm]:
    """Return the runs that are compared."""
    return [arm for check in CHECKED for arm in check.arms()]


def current_rows(rows: Iterable[Mapping[str, str]]) -> list[Mapping[str, str]]:
    """Return the rows of today's checks, versions and settings, in the order of the checks.

    A row from before the version of deadlines stands in for one of today's, until there is that.
    """
    found = {tuple(row[name] for name in CELL_KEY): row for row in rows}
    keys = [cell.key for arm in checks() for cell in arm.cells(EPISODES, FLIGHTS)]
    kept = (found.get(key) or found.get(tuple(DEADLINES.sub("", value) for value in key)) for key in keys)
    return [row for row in kept if row is not None]


def table(rows: Iterable[Mapping[str, str]]) -> str:
    """Return the table of the page: a line for all runs of a check."""
    told = {arm.name: arm.resolved.get("asymmetric_critics", False) for arm in checks()}
    needs_deadlines = {arm.name for arm in checks() if arm.tells_cost_critics}
    shown = {check.name: check.shown for check in CHECKED}
    groups: dict[tuple[str, str], list[Mapping[str, str]]] = {}
    for row in rows:
        groups.setdefault((row["arm"], row["first_river"]), []).append(row)
    lines = []
    for (name, river), runs in groups.items():
        each = ", ".join(f"{float(row['return']):.2f}" for row in runs)
        cost = f"{np.mean([float(row['cost']) for row in runs]):.3f}"
        critics = SEEN_BY_CRITICS[told[name]]
        older = name in needs_deadlines and not all(DEADLINES.search(row["versions"]) for row in runs)
        lines.append(
            [
                f"{shown[name]} ({BEFORE})" if older else shown[name],
                critics,
                river,
                str(len(runs)),
                str(mean_return(runs)),
                each,
                cost,
            ]
        )
    header = ["algorithm", CRITICS_SEE, f"river of {LEVEL}", "seeds", "return", "return by seed", "cost"]
    return markdown(frame(header, lines))


def written_page(page: str, rows: Iterable[Mapping[str, str]]) -> str:
    """Return the page with the section of the checks as the rows have it."""
    shown = current_rows(rows)
    return replace_section(page, SECTION, table(shown) if shown else "Nothing was measured with today's versions.\n")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=["*"], metavar="PATTERN", help="checks by their labels")
    parser.add_argument("--jobs", type=int, default=1, help="checks at a time")
    parser.add_argument("--threads", type=int, help="threads for learning of each check")
    parser.add_argument("--runs", type=Path, default=HERE.parent / "runs" / "through_frames", help="folder of the runs")
    parser.add_argument("--out", type=Path, default=TABLE, help="the table")
    parser.add_argument("--list", action="store_true", help="train and fly nothing, but list the checks")
    parser.add_argument("--write", action="store_true", help="train and fly nothing, but write the page")
    given = parser.parse_args(arguments)
    if given.jobs < 1:
        parser.error(f"--jobs must be at least 1, not {given.jobs}")
    if given.write and given.out != TABLE:
        parser.error("--write is for the table of this folder; leave --out out")
    chosen = [arm for arm in checks() if any(fnmatch.fnmatchcase(label(arm), pattern) for pattern in given.only)]
    if not chosen:
        parser.error(f"--only {' '.join(given.only)} matches no check; --list shows their labels")
    rows = rows_of(given.out, COLUMNS)
    if given.write:
        write_atomic(PAGE, written_page(PAGE.read_text(encoding="utf-8"), rows))
        return 0
    tasks = []
    for arm in chosen:
        missing = missing_cells(arm, rows, EPISODES, FLIGHTS)
        print(f"{label(arm)}: {'to be flown' if missing else 'has a row'}", flush=True)
        if missing:
            tasks.append(Task(arm, given.runs / arm.folder, given.threads, cells=tuple(missing)))
    if given.list:
        return 0
    return status_of(tasks, given.jobs, given.out)


def label(arm: Arm) -> str:
    """Return the name by which a run is selected."""
    return f"{arm.name}-{arm.first_river}-{arm.seed}"


if __name__ == "__main__":
    sys.exit(main())
