"""Training costs on the page of findings on tasks, worked by hand."""

import importlib
import io
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest
from PIL import Image

from tests.bench.report.small_results import flights
from tests.benchmarks.made_up_tasks import FRONT, SUITE, log, rows, study
from thalweg.bench.fronts import fronts

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    for name in ("task_training", "task_risk", "task_findings_picture", "task_outcomes", "findings"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setattr(fronts, "read_fronts", lambda: FRONT)
    return importlib.import_module("task_training")


def test_training_costs_are_those_of_all_steps_and_of_the_last_quarter(script: ModuleType):
    training = [
        *(log("FOCOPS-23", seed, [40.0 + seed, 10.0, 20.0, 23.0], [50, 100, 50, 50]) for seed in range(3)),
        *(log("P3O-23", seed, [46.0] * 4, [5] * 4) for seed in range(2)),
        log("FOCOPS-8.2", 0, [900.0] * 4),
        log("PPO", 0, [700.0, 500.0, 400.0, 300.0], [1, 1, 1, 3]),
    ]
    nests = study(flights("FOCOPS-23", 3, 4.0, 8.0), training)
    # FOCOPS: 50 * 40 + 100 * 10 + 50 * 20 + 50 * 23 = 5,150 in 1,000 steps, and 50 more with each seed: 5,200 ± 4.30 *
    # 50 / sqrt(3) = 124. P3O: 20 episodes of 46. PPO: 700 + 500 + 400 + 900.
    assert rows(script.training_section({"Nests": nests})) == {
        "PPO, without a limit": ["2500; 300"], "FOCOPS": ["5200 ± 124; 23.0 ± 0.00"], "P3O": ["920; 46.0"],
    }  # fmt: skip
    assert script.training_fact({"Nests": nests}) == (
        "**What learning costs.** On the rivers of training at the middle limits, episodes of the last quarter of the"
        " steps cost 1.0 (FOCOPS, Nests) to 2.0 (P3O, Nests; the median is 1.5) times the limit in the mean, and in 1"
        " of 2 cases no more than it. All of training costs 0.4 (P3O, Nests) to 2.1 (FOCOPS, Nests; the median is 1.2)"
        " times as much as that of PPO, which knows no limit: whoever fails early begins more flights."
    )


def test_trainings_that_failed_are_left_out(script: ModuleType):
    training = [log("FOCOPS-23", 0, [10.0] * 4), log("FOCOPS-23", 1, [900.0] * 4)]
    nests = study(flights("FOCOPS-23", 2, 4.0, 8.0), training, failed=[("FOCOPS-23", 1)])
    assert rows(script.training_section({"Nests": nests})) == {"FOCOPS": ["2000; 10.0"]}
    failed = study(flights("FOCOPS-23", 2, 4.0, 8.0), training, failed=[("FOCOPS-23", 0), ("FOCOPS-23", 1)])
    assert script.training_section({"Nests": failed}) == "Nothing has been run yet.\n"


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


def test_without_runs_the_page_says_so(script: ModuleType):
    nothing = {"Nests": sys.modules["task_outcomes"].study_of(SUITE, None)}
    assert script.training_section(nothing) == "Nothing has been run yet.\n"
    assert script.training_fact(nothing) == "**What learning costs** is not known yet."
