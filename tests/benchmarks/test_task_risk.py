"""What the page of findings on tasks tells beyond mean costs: areas, tails and training costs, worked by hand."""

import importlib
import io
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.bench.report.small_results import flights
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.fronts import fronts
from thalweg.bench.fronts.fronts import FrontPoint
from thalweg.bench.results.results import Results, RunRow
from thalweg.bench.results.statistics import TrainingLog
from thalweg.bench.suite.arms import Arm
from thalweg.bench.suite.config import Suite

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
SCRIPTS = ("task_risk", "task_findings_picture", "task_outcomes")
SAFE = FrontPoint("Nests", "Medium", "fixed", 10.0, 50, 6.0, 5.9, 6.1, 0.0, 0.0, 0.0, 1)
FAST = replace(SAFE, price=0.0, return_=10.0, cost=40.0)
FRONT = [SAFE, FAST, replace(SAFE, rivers="unseen"), replace(FAST, rivers="unseen")]
"""The oracle returns 6 at no cost and a point more for a cost of 10, up to 10: an area of 40 * 8."""
LIMITS = {"FOCOPS-8.2": 8.2, "FOCOPS-23": 23.0, "P3O-23": 23.0}
SUITE = Suite(
    "nests",
    (
        Arm("PPO"),
        *(Arm(name.split("-")[0], settings={"cost_limit": limit}, name=name) for name, limit in LIMITS.items()),
    ),
    test_levels=("Medium",),
    baselines=(),
    packaged=False,
    task="Nests",
)


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    for name in SCRIPTS:
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setattr(fronts, "read_fronts", lambda: FRONT)
    return importlib.import_module("task_risk")


def log(algorithm: str, seed: int, costs: list[float], episodes: list[int] | None = None) -> TrainingLog:
    """A run of 1,000 steps whose blocks of episodes have these mean costs."""
    values, zeros = np.array(costs), np.zeros(len(costs))
    steps = np.linspace(1000 / len(costs), 1000, len(costs)).astype(np.int64)
    counts = np.array(episodes or [50] * len(costs))
    return TrainingLog(
        algorithm, seed, steps, zeros, zeros, zeros, 1000, values, counts, np.zeros((len(costs), 3), np.int64)
    )


def study(episodes: list[Episode], training: list[TrainingLog] | None = None) -> Any:
    names = {(row.algorithm, row.seed) for row in episodes}
    runs = [RunRow(f"{name}-{seed}", "train", name, seed, 1000, "finished") for name, seed in sorted(names)]
    results = Results(Path(), SUITE.as_data(), runs, episodes, training or [], [])
    return sys.modules["task_outcomes"].study_of(SUITE, results)


def rows(table: str) -> dict[str, list[str]]:
    """Cells of a table by the first of each line."""
    lines = ([cell.strip() for cell in line.strip("| ").split(" | ")] for line in table.splitlines()[2:])
    return {line[0]: line[1:] for line in lines}


def test_the_area_is_that_below_the_policies_of_all_limits_in_shares_of_the_oracles(script: ModuleType):
    nests = study([*flights("FOCOPS-8.2", 2, 4.0, 16.0), *flights("FOCOPS-23", 3, 7.0, 56.0),
                   *flights("P3O-23", 3, 4.0, 80.0)])  # fmt: skip
    # Seed 0 returns 5 at a cost of 8 and 8 at 28: 20 * 6.5 + 12 * 8 = 226; a point more over 32 with seed 1: 258.
    # P3O has one limit, of which nothing can be said.
    assert rows(script.area_section({"Nests": nests})) == {"FOCOPS": [f"{(226 + 258) / 2 / 320:.2f}"]}


def test_areas_have_intervals_with_three_seeds_and_gaps_are_named(script: ModuleType):
    nests = study([*flights("FOCOPS-8.2", 3, 4.0, 16.0), *flights("FOCOPS-23", 3, 7.0, 56.0)])
    # Seeds differ by 32 / 320 = 0.1; Student's t for three is 4.30, and 4.30 * 0.1 / sqrt(3) = 0.25.
    found = rows(script.area_section({"Nests": nests, "Portage": replace(nests, task="Portage", results=None)}))
    assert found == {"FOCOPS": ["0.81 ± 0.25", "missing"]}


def test_the_worst_tenth_is_told_beside_the_middle_limit(script: ModuleType):
    rising = (replace(row, cost=row.cost * (1 + row.seed)) for row in flights("FOCOPS-23", 3, 4.0, 30.0))
    nests = study([*flights("PPO", 3, 5.0, 80.0), *flights("FOCOPS-8.2", 3, 4.0, 90.0), *rising])
    # Of six flights of FOCOPS the worst 0.6 cost 90; the worst ones of the seeds cost 30, 60 and 90, whose interval is
    # 60 ± 4.30 * 30 / sqrt(3) = 60 ± 74.5; no cost is below 0.
    table = script.tail_section({"Nests": nests})
    assert "Nests, limit 23" in table.splitlines()[0]
    assert rows(table) == {
        "PPO, without a limit": ["80.0 [80.0, 80.0]"], "FOCOPS": ["90.0 [0.00, 135]"],
    }  # fmt: skip


def test_the_fact_on_the_worst_tenth_counts_those_that_hold_the_middle_limit(script: ModuleType):
    nests = study([*flights("PPO", 3, 5.0, 4.0), *flights("FOCOPS-23", 3, 4.0, 46.0), *flights("P3O-23", 3, 4.0, 23.0)])
    assert script.tail_fact({"Nests": nests}) == (
        "**The worst tenth.** Where the middle limit is held in the mean (2 times), the worst tenth of flights costs"
        " 1.0 (P3O, Nests) to 2.0 times the limit (FOCOPS, Nests), with a median of 1.5."
    )
    above = study(flights("FOCOPS-23", 3, 4.0, 48.0))
    assert script.tail_fact({"Nests": above}) == "**The worst tenth.** Nobody holds a middle limit."


def test_training_costs_are_means_over_all_episodes_at_the_middle_limit(script: ModuleType):
    training = [
        *(log("FOCOPS-23", seed, [40.0 + seed, 10.0], [50, 100]) for seed in range(3)),
        *(log("P3O-23", seed, [46.0]) for seed in range(2)),
        log("FOCOPS-8.2", 0, [900.0]),
        log("PPO", 0, [700.0, 500.0]),
    ]
    nests = study(flights("FOCOPS-23", 3, 4.0, 8.0), training)
    # (40 + 2 * 10) / 3 = 20 and a third more with each seed: 20.33 ± 4.30 * 0.333 / sqrt(3).
    assert rows(script.training_section({"Nests": nests})) == {
        "PPO, without a limit": ["600"], "FOCOPS": ["20.3 ± 0.83"], "P3O": ["46.0"],
    }  # fmt: skip
    assert script.training_fact({"Nests": nests}) == (
        "**What learning costs.** Episodes of training at the middle limits cost, in the mean from the first step to"
        " the last, 0.9 (FOCOPS, Nests) to 2.0 times the limit (P3O, Nests), and in 1 of 2 cases no more than it."
    )


def test_the_picture_has_the_mean_over_seeds_of_each_algorithm_at_the_middle_limit(script: ModuleType):
    training = [log("FOCOPS-23", seed, [10.0, 20.0 + 2 * seed]) for seed in range(3)]
    training += [log("FOCOPS-8.2", 0, [900.0]), log("PPO", 0, [500.0])]
    nests = study(flights("FOCOPS-23", 3, 4.0, 8.0), training)
    nothing = sys.modules["task_outcomes"].study_of(SUITE, None)
    figure = script.training_figure({"A": nests, "B": nests, "C": nests, "D": replace(nothing, task="Portage")})
    assert [axis.get_title() for axis in figure.axes][2:] == ["Nests, limit 23", "Portage, not run yet"]
    first = figure.axes[0]
    ends = sorted(line.get_ydata()[-1] for line in first.get_lines())
    assert ends == [22.0, 23.0, 500.0]  # FOCOPS, the limit and PPO
    assert first.get_ylim()[1] > 500.0 and 23.0 in first.get_yticks()
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "PPO, without a limit", "FOCOPS", "middle limit",
    ]  # fmt: skip
    assert Image.open(io.BytesIO(script.drawn_training(dict.fromkeys("ABCD", nests)))).width > 1000


def test_without_runs_everything_says_so(script: ModuleType):
    nothing = {"Nests": sys.modules["task_outcomes"].study_of(SUITE, None)}
    sections = [write(nothing) for write in (script.area_section, script.tail_section, script.training_section)]
    assert sections == ["Nothing has been run yet.\n"] * 3
    assert script.training_fact(nothing) == "**What learning costs** is not known yet."
