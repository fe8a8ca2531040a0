"""Rows of the benchmark on problems with a known optimum: what identifies a run, and its result beside the optimum."""

import hashlib
import json
import sys
from pathlib import Path

import numpy as np
from settings_hash import settings_hash
from tables import Rows, rows_of

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))  # the problems are part of the tests

from tests.known_answer.harness import Case, Result, cases, reference  # noqa: E402
from tests.known_answer.problems import PROBLEMS  # noqa: E402
from tests.known_answer.scores import Score  # noqa: E402
from thalweg.algos import ALGORITHMS  # noqa: E402
from thalweg.core import versions  # noqa: E402
from thalweg.core.config import to_plain  # noqa: E402

SEEDS = 5
KEY = ("algorithm", "place", "problem", "tables", "seed", "steps", "settings", "config")
"""Columns that identify a run; a row that no planned run matches is dropped."""
COLUMNS = (
    *KEY,
    "algorithm_version",
    "training_version",
    "reward",
    "reward_error",
    "costs",
    "cost_error",
    "error",
)
Table = dict[tuple[str, ...], dict[str, str]]
"""Rows by their key."""


def key(case: Case, seed: int) -> tuple[str, ...]:
    """Return the values of `KEY` for a run, with the changed settings and a hash of all settings."""
    config = json.dumps(case.config, sort_keys=True)
    tables = PROBLEMS[case.problem].digest
    settings = settings_hash(to_plain(ALGORITHMS[case.algorithm].configure(case.config)))
    return (
        case.algorithm,
        case.action_setup,
        case.problem,
        tables,
        str(seed),
        str(case.requirement.steps),
        settings,
        config,
    )


def row_versions(algorithm: str) -> dict[str, str]:
    """Return the versions that a run of the algorithm depends on, by their columns."""
    return {
        "algorithm_version": str(versions.ALGORITHMS[algorithm]),
        "training_version": str(versions.TRAINING),
    }


def folder_name(case: Case, seed: int) -> str:
    """Return the name of a run's folder, which no run of other settings, tables or versions has."""
    digest = hashlib.sha256(repr((row_versions(case.algorithm), key(case, seed))).encode()).hexdigest()[:16]
    return f"{case.algorithm}-{case.action_setup}-{case.problem}-{seed}-{digest}"


def finished(path: Path) -> Table:
    """Return the rows of the table that match a planned run, by their key."""
    return planned_rows(rows_of(path, COLUMNS))


def planned_rows(rows: Rows) -> Table:
    """Return those of the rows that match a planned run, by their key."""
    table = {tuple(row[name] for name in KEY): row for row in rows}
    planned = {key(case, seed) for case in cases() for seed in {int(row["seed"]) for row in rows}}
    return {name: row for name, row in table.items() if name in planned}


def result_of(case: Case, row: dict[str, str]) -> Result:
    """Return the result of a successful run's row, compared with the current optimum."""
    costs = np.array([float(cost) for cost in row["costs"].split()])
    score = Score(float(row["reward"]), costs, float(row["reward_error"]), float(row["cost_error"]))
    return Result(case, score, reference(case))
