"""A made-up front of the oracle, and results of a task whose figures can be worked by hand."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from thalweg.bench.evaluate.conditions import Condition
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.fronts.fronts import FrontPoint
from thalweg.bench.results.results import Results, RunRow
from thalweg.bench.results.statistics import TrainingLog
from thalweg.bench.suite.arms import Arm
from thalweg.bench.suite.config import Suite

SAFE = FrontPoint("Nests", "Medium", "fixed", 10.0, 50, 6.0, 5.9, 6.1, 0.0, 0.0, 0.0, 1)
FAST = replace(SAFE, price=0.0, return_=10.0, cost=40.0)
FRONT = [SAFE, FAST, replace(SAFE, rivers="unseen"), replace(FAST, rivers="unseen")]
"""The oracle returns 6 at no cost and a point more for a cost of 10, up to 10: an area of 40 * 8."""
LIMITS = {"FOCOPS-8.2": 8.2, "FOCOPS-23": 23.0, "FOCOPS-49": 49.0, "P3O-23": 23.0, "P3O-cnn-23": 23.0}


def suite_of(limits: Mapping[str, float], *conditions: Condition) -> Suite:
    """A suite of Nests with PPO and the policies that are named, such as FOCOPS-23, at their limits."""
    named = [Arm(name.split("-")[0], settings={"cost_limit": limit}, name=name) for name, limit in limits.items()]
    return Suite(
        "nests", (Arm("PPO"), *named), test_levels=("Medium",), baselines=(), packaged=False, task="Nests",
        conditions=conditions,
    )  # fmt: skip


SUITE = suite_of(LIMITS)


def log(algorithm: str, seed: int, costs: list[float], episodes: list[int] | None = None) -> TrainingLog:
    """A run of 1,000 steps whose blocks of episodes have these mean costs."""
    values, zeros = np.array(costs), np.zeros(len(costs))
    steps = np.linspace(1000 / len(costs), 1000, len(costs)).astype(np.int64)
    counts = np.array(episodes or [50] * len(costs))
    return TrainingLog(
        algorithm, seed, steps, zeros, zeros, zeros, 1000, values, counts, np.zeros((len(costs), 3), np.int64)
    )


def study(
    episodes: Sequence[Episode], training: Sequence[TrainingLog] = (), failed: Sequence[tuple[str, int]] = ()
) -> Any:
    """What was run of Nests, by the module `task_outcomes` that is loaded; `failed` has runs that did not end."""
    names = {(each.algorithm, each.seed) for each in (*episodes, *training)}
    runs = [
        RunRow(f"{name}-{seed}", "train", name, seed, 1000, "failed" if (name, seed) in failed else "finished")
        for name, seed in sorted(names)
    ]
    results = Results(Path(), SUITE.as_data(), runs, [*episodes], [*training], [])
    return sys.modules["task_outcomes"].study_of(SUITE, results)


def rows(table: str) -> dict[str, list[str]]:
    """Cells of a table by the first of each line."""
    lines = ([cell.strip() for cell in line.strip("| ").split(" | ")] for line in table.splitlines()[2:])
    return {line[0]: line[1:] for line in lines}
