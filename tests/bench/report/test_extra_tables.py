"""Tables and figures beyond the paper's: on results whose figures are known."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.env import handmade
from thalweg.bench.evaluate.conditions import Condition
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.report.extra_figures import condition_grid, profiles
from thalweg.bench.report.extra_tables import changed, conditions, kept, limits, pairs
from thalweg.bench.report.failure_maps import failure_maps
from thalweg.bench.results.inference import Estimate
from thalweg.bench.results.results import Results, RunRow
from thalweg.bench.results.statistics import TrainingLog
from thalweg.bench.suite.suites import Arm, Suite

SUITE = Suite(
    "it", (Arm("PPO"), Arm("FOCOPS"), Arm("P3O")), test_levels=("Medium",), baselines=("hover",), packaged=False,
    conditions=(Condition("mode", deterministic=True), Condition("real", rivers=("Cam",))),
)  # fmt: skip


def flights(name: str, seeds: int, return_: float, cost: float, level: str = "Medium") -> list[Episode]:
    """Two starts a seed; returns differ by 1 between seeds, and by 2 between starts; every second costs."""
    return [
        Episode(
            name, seed, level, 1, start, float(start), 0.0, 5.0, 0.0, return_ + seed + 2 * start, cost * start,
            cost * start, 0.0, 50, "Collision" if cost * start else "Success", not cost * start, 0.5,
            10.0 * start, 3.0, 5.0,
        )
        for seed in range(seeds)
        for start in range(2)
    ]  # fmt: skip


@pytest.fixture
def results() -> Results:
    episodes = [*flights("hover", 1, 0.0, 0.4), *flights("PPO", 3, 4.0, 1.0), *flights("FOCOPS", 3, 5.5, 0.0)]
    runs = [RunRow(f"{name}-{seed}", "train", name, seed, 1000, "finished", "", 120.0 + 60 * seed, 9.0 - seed)
            for name in ("PPO", "FOCOPS") for seed in range(3)]  # fmt: skip
    runs.insert(0, RunRow("hover-0", "baseline", "hover", 0, 0, "finished"))
    runs.append(RunRow("P3O-0", "train", "P3O", 0, 10, "failed", "no"))
    logs = [TrainingLog("PPO", 0, np.arange(10), np.zeros(10), np.full(10, 0.5), np.zeros(10), 1000)]
    beyond = {"mode": flights("PPO", 3, 4.5, 0.0), "real": flights("FOCOPS", 3, 1.0, 0.0, "Cam")}
    return Results(Path(), SUITE.as_data(), runs, episodes, logs, [], beyond=beyond)


def test_limits_are_judged_by_the_cost_of_flights_and_of_training(results: Results):
    header, rows = limits(results).grid
    by = {row[0]: dict(zip(header, row, strict=True)) for row in rows}
    assert list(by) == ["PPO", "FOCOPS", "P3O"]
    assert by["PPO"]["cost"] == "0.50 [0.00, 1.00]" and by["PPO"]["limit met"] == "unsure"
    assert by["FOCOPS"]["cost"] == "0.00 [0.00, 0.39]" and by["FOCOPS"]["limit met"] == "unsure"
    assert by["PPO"]["violations"].startswith("50% [")
    assert (by["PPO"]["regret in training"], by["FOCOPS"]["regret in training"]) == ("0.40", "unknown")
    assert (by["PPO"]["minutes"], by["PPO"]["steps a second"]) == ("3.00", "8.00")
    assert by["P3O"]["cost"] == "failed"


def test_sixty_flights_without_a_cost_keep_the_limit(results: Results):
    free = [replace(row, episode=20 * row.episode + more) for row in flights("PPO", 3, 4.0, 0.0) for more in range(10)]
    header, rows = limits(replace(results, episodes=free)).grid
    assert rows[0][header.index("limit met")] == "yes"


def test_whether_a_limit_is_met_needs_an_interval():
    assert [kept(Estimate(0.05, *ends)) for ends in ((0.0, 0.1), (0.0, 0.11))] == ["yes", "unsure"]
    assert [kept(Estimate(0.2, *ends)) for ends in ((0.1, 0.3), (0.11, 0.3))] == ["unsure", "no"]
    assert [kept(Estimate(value)) for value in (0.1, 0.2)] == ["below, unsure", "above, unsure"]


def test_pairs_are_compared_from_the_same_starts(results: Results):
    """Of the nine pairs of seeds FOCOPS, 1.5 ahead, is below PPO in one, and its returns differ by -1.5 in the mean."""
    header, rows = pairs(results).grid
    assert header[:3] == ["policy", "against", "seeds"] and [row[:3] for row in rows] == [["PPO", "FOCOPS", "3 and 3"]]
    assert rows[0][3].startswith("11% [") and rows[0][4].startswith("-1.50 [-3.77, 0.77]")
    # Costs of 0 and 1 thrice each, 0.5 ± 2.571 √(0.3 / 6), against six of 0, Wilson's 0 to 0.39.
    assert rows[0][5] == "0.50 [-0.19, 1.00]"
    other = replace(results, episodes=[row for row in results.episodes if (row.algorithm, row.episode) != ("PPO", 1)])
    assert pairs(other).grid[1] == [["PPO", "FOCOPS", *["not the same starts"] * 4]]


def test_conditions_say_what_changes_from_the_same_starts(results: Results):
    header, rows = conditions(results).grid
    assert [row[:4] for row in rows] == [["PPO", "mode", "Medium", "3"], ["FOCOPS", "real", "Cam", "3"]]
    assert [row[header.index("return, change")] for row in rows] == ["0.50 [-1.60, 2.60]", "other starts"]
    assert rows[0][header.index("return")] == "6.50 [4.02, 8.98]"  # t of 2 degrees of freedom: 4.303 / √3
    assert rows[0][header.index("success")].startswith("100% [")


def test_who_flew_under_a_condition_only_has_rows_too(results: Results):
    stray = replace(results, beyond={"mode": flights("Stray", 1, 4.5, 0.0)})
    assert stray.policies[-1] == "Stray"
    assert [row[:4] for row in conditions(stray).grid[1]] == [["Stray", "mode", "Medium", "1"]]


def test_a_change_is_that_of_the_seeds_that_flew_under_both(results: Results):
    before = [row for row in results.episodes if row.algorithm == "PPO"]
    after = [replace(row, return_=row.return_ + 0.5 + (row.seed == 2)) for row in before]
    for seeds, change in (({0, 1, 2}, 2.5 / 3), ({0, 1}, 0.5), ({2}, 1.5)):
        for flown in ((after, [row for row in before if row.seed in seeds]), (
            [row for row in after if row.seed in seeds], before
        )):  # fmt: skip
            found = changed(*flown)
            assert isinstance(found, Estimate) and found.value == pytest.approx(change)
            assert np.isnan(found.low) == (len(seeds) < 3)
    assert changed([replace(row, seed=7) for row in after], before) == "other seeds"
    assert changed(after, []) == changed([], []) == "other starts"


def test_seeds_that_are_lacking_are_said(results: Results):
    free = [row for row in results.episodes if (row.algorithm, row.seed) != ("PPO", 2)]
    beyond = {"mode": [row for row in results.beyond["mode"] if row.seed != 1]}
    fewer = replace(results, episodes=free, beyond=beyond)
    assert limits(fewer).grid[1][0][:2] == ["PPO", "2 of 3"]
    assert pairs(fewer).grid[1][0][2] == "2 of 3 and 3"
    assert conditions(fewer).grid[1][0][3] == "2 of 3"


def test_profiles_have_a_line_for_each_policy_that_was_trained(results: Results):
    figure = profiles(results)
    assert figure is not None
    (axis,) = figure.axes
    lines = {line.get_label(): line for line in axis.get_lines()}
    assert list(lines) == ["PPO", "FOCOPS"]
    x, y = (np.asarray(data, float) for data in lines["PPO"].get_data())
    np.testing.assert_allclose(np.interp([0.0, 4.5, 8.1], x, y), [1.0, 5 / 6, 0.0], atol=1e-9)
    assert profiles(replace(results, episodes=flights("hover", 1, 0.0, 0.4))) is None


def test_the_grid_has_a_number_for_each_policy_and_condition(results: Results):
    figure = condition_grid(results)
    assert figure is not None
    axis = figure.axes[0]
    assert [label.get_text() for label in axis.get_xticklabels()] == ["main", "mode", "real"]
    said = {(int(text.get_position()[0]), int(text.get_position()[1])): text.get_text() for text in axis.texts}
    assert said == {(0, 0): "1.0", (0, 1): "6.0", (1, 1): "6.5", (0, 2): "7.5", (2, 2): "3.0"}
    assert condition_grid(replace(results, beyond={})) is None


def test_a_map_marks_where_flights_failed(results: Results):
    figure = failure_maps(results, "Medium", handmade.ring())
    assert figure is not None
    shown = [axis for axis in figure.axes if axis.get_visible()]
    assert [axis.get_title() for axis in shown] == ["PPO: 3 of 6 failed", "FOCOPS: 0 of 6 failed"]
    water, *dots = shown[0].collections
    assert len(water.get_paths()) == len(handmade.ring().river.position_m)  # a closed river: a piece after each point
    marks = [np.asarray(found.get_offsets()) for found in dots]
    np.testing.assert_array_equal(np.concatenate(marks), [[10.0, 3.0]] * 3)
    old = [replace(row, end_x=float("nan")) for row in results.episodes]
    assert failure_maps(replace(results, episodes=old), "Medium", handmade.ring()) is None


def test_at_full_precision_an_estimate_has_three_columns(results: Results):
    header, first, second, third = csv.reader(limits(results).csv.splitlines())
    assert header == [
        "policy", "seeds", "cost", "cost, low", "cost, high", "limit met", "violations", "violations, low",
        "violations, high", "regret in training", "minutes", "steps a second",
    ]  # fmt: skip
    assert first[:6] == ["PPO", "3", "0.5", "0.0", "1.0", "unsure"] and float(first[-1]) == 8.0
    assert second[2:4] == ["0.0", "0.0"] and 0.39 < float(second[4]) < 0.4 and second[5] == "unsure"
    assert third[2:6] == ["failed", "", "", "failed"]
