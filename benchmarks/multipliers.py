"""Multipliers of off-policy algorithms in the tasks where a limit has a price: the defaults, and limits as units.

    python benchmarks/multipliers.py                              # all runs that have no row yet
    python benchmarks/multipliers.py --only 'Nests-TD3Lag-*'      # runs by their labels, see --list
    python benchmarks/multipliers.py --minutes 25                 # begins no run later than that
    python benchmarks/multipliers.py --write                      # the table of docs/task-findings.md

Each run learns by the ideal eye at the middle limit of its task, on rivers and with seeds that the suites of these
tasks do not have, and its policy is flown as theirs: sampled flights on the fixed river of Medium and on unseen ones.
`swing` is the standard deviation, over the reports of the last quarter of the training, of the mean cost that the
multiplier is updated by. A row of multipliers.csv is appended when a run has been flown; a run that has one of today's
versions and settings is skipped, and one that was interrupted resumes in the folder `--runs`.
"""

import argparse
import fnmatch
import hashlib
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from ideal_eye import CHOOSING_RIVERS, CHOOSING_SEEDS, NUM_ENVS, OFF_POLICY_STEPS, settings_text
from page_sections import replace_section
from reliability.pieces import Clock
from river_flights import fly
from settings_hash import settings_hash
from tables import append, last_of_each, rows_of

from thalweg.algos.registry import algorithm_named
from thalweg.bench.csv_files import read_csv
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.evaluation import Label
from thalweg.bench.report.table import frame, markdown
from thalweg.bench.suite.priced import LIMITS
from thalweg.core import versions
from thalweg.core.atomic_io import write_atomic
from thalweg.core.config import to_plain
from thalweg.env import EnvConfig
from thalweg.env.tasks import TaskName
from thalweg.train.river import RiverTraining

HERE = Path(__file__).resolve().parent
TABLE = HERE / "multipliers.csv"
PAGE, SECTION = HERE.parent / "docs" / "task-findings.md", "multipliers"
LEVEL, EPISODES = "Medium", 60
ALGORITHMS = ("DDPGLag", "TD3Lag", "SACLag")
CHANGES: Mapping[str, Mapping[str, Any]] = {"defaults": {}, "limit": {"cost_scale": "limit", "multiplier_max": 10.0}}
"""Settings of the multiplier that are compared, by a name."""
KINDS = ("fixed", "unseen")
"""Flights: on the fixed river of the level, and on one unseen river each."""
VERSIONS = ("algorithm_version", "training", "privileged", "deadlines", "tasks", "rules", "world", "evaluation")
"""Columns of the versions that a run depends on."""
KEY = ("task", "algorithm", "changes", "limit", "steps", "seed", "config", *VERSIONS)
"""Columns that identify a run; `config` is a hash of all settings, so that other defaults make another run."""
MEASURED = (*(f"{kind}_{what}" for kind in KINDS for what in ("return", "cost")), "training_cost", "swing")
"""Means over flights; the mean cost in the last quarter of the training, and how it swings."""
COLUMNS = (*KEY, *MEASURED)


@dataclass(frozen=True)
class Trial:
    """A run at the middle limit of a task."""

    task: TaskName
    algorithm: str
    change: str
    """A name in `CHANGES`."""
    seed: int

    @property
    def label(self) -> str:
        """Name by which it is selected."""
        return f"{self.task}-{self.algorithm}-{self.change}-{self.seed}"

    @property
    def limit(self) -> float:
        """Limit of the cost of an episode, which stays the same."""
        return LIMITS[self.task][1]

    @property
    def settings(self) -> dict[str, Any]:
        """Settings that differ from the defaults of the algorithm."""
        return {"cost_limit": self.limit, "cost_limit_schedule": [], **CHANGES[self.change]}

    @property
    def key(self) -> tuple[str, ...]:
        """Values of `KEY`."""
        resolved = to_plain(algorithm_named(self.algorithm).configure(self.settings, num_envs=NUM_ENVS))
        made_with = (
            *(versions.ALGORITHMS[self.algorithm], versions.TRAINING, versions.PRIVILEGED, versions.DEADLINES),
            *(versions.TASKS, versions.RULES, versions.WORLD, versions.EVALUATION),
        )
        changes = settings_text(CHANGES[self.change])
        trained = f"{self.limit:g}", str(OFF_POLICY_STEPS), str(self.seed), settings_hash(resolved)
        return (self.task, self.algorithm, changes, *trained, *map(str, made_with))


def trials() -> list[Trial]:
    """Return all runs: with both settings before the next task."""
    return [
        Trial(task, algorithm, change, seed)
        for task in LIMITS
        for algorithm in ALGORITHMS
        for change in CHANGES
        for seed in CHOOSING_SEEDS
    ]


def measure(trial: Trial, runs: Path) -> dict[str, str]:
    """Train, or resume, and fly; returns the row."""
    rules = EnvConfig(observation="none", task=trial.task)
    rivers = RiverTraining(LEVEL, NUM_ENVS, tuple(CHOOSING_RIVERS), rules)
    folder = runs / f"{trial.label}-{hashlib.sha256(repr(trial.key).encode()).hexdigest()[:10]}"
    made_with = {"steps": OFF_POLICY_STEPS, "seed": trial.seed, "settings": trial.settings}
    result = rivers.train(trial.algorithm, None, folder=folder, observation="privileged", **made_with)
    config = EvaluationConfig(episodes=EPISODES, env=rules)
    row = dict(zip(KEY, trial.key, strict=True)) | training_figures(read_csv(folder / "metrics.csv", ["cost_mean"]))
    for kind in KINDS:
        flown = fly(result.policy, courses_of(kind, config), Label(trial.label, trial.seed, LEVEL), config)
        row[f"{kind}_return"] = f"{np.mean([flight.return_ for flight in flown]):.3f}"
        row[f"{kind}_cost"] = f"{np.mean([flight.cost for flight in flown]):.3f}"
    return row


def courses_of(kind: str, config: EvaluationConfig) -> Iterator[Course]:
    """Yield the courses of the flights of a kind, without land."""
    if kind == "unseen":
        yield from Course.unseen(LEVEL, config, drawn=False)
    else:
        yield Course.of_level(LEVEL, config, drawn=False)


def training_figures(reports: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Return `training_cost` and `swing` of a run from its reports, those before a first episode left out."""
    costs = np.array([float(row["cost_mean"]) for row in reports[-(len(reports) // 4) :]])
    costs = costs[np.isfinite(costs)]
    return {"training_cost": f"{costs.mean():.3f}", "swing": f"{costs.std():.3f}"}


def current_rows(rows: Sequence[Mapping[str, str]]) -> list[Mapping[str, str]]:
    """Return the rows of today's runs, in the order of `trials`; of those of the same run, the last."""
    found = {tuple(row[name] for name in KEY): row for row in last_of_each(rows, KEY)}
    return [found[trial.key] for trial in trials() if trial.key in found]


def table(rows: Sequence[Mapping[str, str]]) -> str:
    """Return the table of the page: a line for the seeds of each task, algorithm and setting."""
    groups: dict[tuple[str, ...], list[Mapping[str, str]]] = {}
    for row in rows:
        groups.setdefault((row["task"], row["limit"], row["algorithm"], row["changes"]), []).append(row)
    lines = []
    for (task, limit, algorithm, changes), seeds in groups.items():
        settings = "the defaults" if changes == "none" else " ".join(f"`{change}`" for change in changes.split(" "))
        swing = np.mean([float(row["swing"]) for row in seeds]) / float(limit)
        held = sum(float(row["fixed_cost"]) <= float(limit) for row in seeds)
        flown = [f"{costs_text(seeds, kind)}; {mean_text(seeds, f'{kind}_return')}" for kind in KINDS]
        lines.append([task, limit, algorithm, settings, f"{swing:.2f}", *flown, f"{held} of {len(seeds)}"])
    header = ["task", "limit", "algorithm", "multiplier", "swing, in limits"]
    header += ["fixed river: costs of the seeds; return", "unseen rivers", "seeds within the limit"]
    return markdown(frame(header, lines))


def costs_text(rows: Sequence[Mapping[str, str]], kind: str) -> str:
    """Return the mean cost of each seed."""
    return ", ".join(f"{float(row[f'{kind}_cost']):.3g}" for row in rows)


def mean_text(rows: Sequence[Mapping[str, str]], column: str) -> str:
    """Return the mean of a column over seeds."""
    return f"{np.mean([float(row[column]) for row in rows]):.2f}"


def written_page(page: str, rows: Sequence[Mapping[str, str]]) -> str:
    """Return the page with the table."""
    return replace_section(page, SECTION, table(current_rows(rows)))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=["*"], metavar="PATTERN", help="labels of runs; default: all")
    parser.add_argument("--list", action="store_true", help="list the labels, and train nothing")
    parser.add_argument("--minutes", type=float, help="begin no run after so many minutes")
    parser.add_argument("--runs", type=Path, default=HERE.parent / "runs" / "multipliers", help="folder of the runs")
    parser.add_argument("--out", type=Path, default=TABLE, help="the table")
    parser.add_argument("--write", action="store_true", help="train nothing, but write the table of the page")
    chosen = parser.parse_args()
    found = [trial for trial in trials() if any(fnmatch.fnmatch(trial.label, each) for each in chosen.only)]
    if not found:
        parser.error(f"--only {' '.join(chosen.only)} selects no run; --list names them")
    if chosen.list:
        print(*(trial.label for trial in found), sep="\n")
        return 0
    if chosen.write:
        write_atomic(PAGE, written_page(PAGE.read_text(encoding="utf-8"), read_csv(chosen.out, COLUMNS)))
        return 0
    clock = Clock(chosen.minutes)
    for trial in found:
        if clock.is_over:
            print("the time is over; the same command resumes")
            break
        if trial.key not in {tuple(row[name] for name in KEY) for row in rows_of(chosen.out, COLUMNS)}:
            row = measure(trial, chosen.runs)
            append(chosen.out, COLUMNS, row)
            print(" ".join(f"{name} {row[name]}" for name in COLUMNS), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
