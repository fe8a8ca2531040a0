"""Tests of profiles, the grid of conditions and maps of failures, on results whose statistics are known."""

from dataclasses import replace

import numpy as np
import pytest

from tests.bench.report.small_results import SUITE, flights
from tests.env import handmade
from thalweg.bench.evaluate.conditions import Condition
from thalweg.bench.report.comparison_figures import condition_grid, return_profiles
from thalweg.bench.report.failure_maps import failure_maps
from thalweg.bench.results.results import Results
from thalweg.world.bridges import deck


def test_profiles_have_a_line_for_each_trained_policy(results: Results):
    figure = return_profiles(results)
    assert figure is not None
    (axis,) = figure.axes
    lines = {line.get_label(): line for line in axis.get_lines()}
    assert list(lines) == ["PPO", "FOCOPS"]
    x, y = (np.asarray(data, float) for data in lines["PPO"].get_data())
    np.testing.assert_allclose(np.interp([0.0, 4.5, 8.1], x, y), [1.0, 5 / 6, 0.0], atol=1e-9)
    assert return_profiles(replace(results, episodes=flights("hover", 1, 0.0, 0.4))) is None


def test_the_grid_has_a_number_for_each_policy_and_condition(results: Results):
    figure = condition_grid(results)
    assert figure is not None
    axis = figure.axes[0]
    assert [label.get_text() for label in axis.get_xticklabels()] == ["main", "mode", "real"]
    said = {(int(text.get_position()[0]), int(text.get_position()[1])): text.get_text() for text in axis.texts}
    assert said == {(0, 0): "1.0", (0, 1): "6.0", (1, 1): "6.5", (0, 2): "7.5", (2, 2): "3.0"}
    assert condition_grid(replace(results, condition_episodes={})) is None


@pytest.mark.parametrize(
    "condition", [Condition("own", rivers=("Wear", "Cam")), Condition("own", levels=("Hard", "Easy"))]
)
def test_a_condition_without_the_training_level_is_shown_on_its_first_river_or_level(
    condition: Condition, results: Results
):
    first, second = condition.rivers or condition.levels
    rows = [*flights("PPO", 1, 3.0, 0.0, second), *flights("PPO", 1, 5.0, 0.0, first)]  # as files are sorted
    suite = replace(SUITE, conditions=(condition,)).as_data()
    figure = condition_grid(replace(results, suite=suite, condition_episodes={"own": rows}))
    assert figure is not None
    assert [text.get_text() for text in figure.axes[0].texts if text.get_position()[0] == 1] == ["6.0"]


def test_a_map_marks_where_flights_failed(results: Results):
    figure = failure_maps(results, "Medium", handmade.ring())
    assert figure is not None
    shown = [axis for axis in figure.axes if axis.get_visible()]
    assert [axis.get_title() for axis in shown] == ["PPO: 3 of 6 failed", "FOCOPS: 0 of 6 failed"]
    water, islands, bridges, *dots = shown[0].collections
    assert not islands.get_paths() and not bridges.get_paths()
    assert len(water.get_paths()) == len(handmade.ring().river.position_m)  # a closed river: a piece after each point
    marks = [np.asarray(found.get_offsets()) for found in dots]
    np.testing.assert_array_equal(np.concatenate(marks), [[10.0, 3.0]] * 3)
    island, bridge = [10.0, 3.0, 4.0, 2.0, 0.3], [-5.0, 2.0, 0.0, 16.0, 5.0, 9.0, 0.2, 1.4, 2.2, 0.1, 0.5]
    world = replace(handmade.ring(), islands=np.array([island]), bridges=np.array([bridge]))
    figure = failure_maps(results, "Medium", world)
    assert figure is not None
    _, islands, bridges, *_ = figure.axes[0].collections
    np.testing.assert_allclose(np.asarray(islands.get_paths()[0].vertices)[:-1].mean(axis=0), [10.0, 3.0], atol=0.05)
    np.testing.assert_allclose(np.asarray(bridges.get_paths()[0].vertices)[:4], deck(world.bridges[0]))
    assert [text.get_text() for text in figure.legends[0].get_texts()][-2:] == ["bridge", "island"]
    old = [replace(row, end_x=float("nan")) for row in results.episodes]
    assert failure_maps(replace(results, episodes=old), "Medium", handmade.ring()) is None
