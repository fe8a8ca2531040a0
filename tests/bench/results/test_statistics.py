"""Tests of summaries and training curves on numbers computed by hand."""

from dataclasses import replace

import numpy as np
import pytest

from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.results.statistics import TrainingLog, mean_and_std, regret, summarise, training_curve


def episode(return_: float, cost: float, reason: str, *, seed: int = 0, length: int = 10) -> Episode:
    tight, loose = (cost, 0.0) if cost == 1 else (0.0, cost)
    return Episode(
        "PPO", seed, "Easy", 1, 0, 0, 0, 5, 0, return_, cost, tight, loose, length, reason, reason == "Success", 0.5
    )


def test_a_summary_has_mean_and_standard_deviation_of_its_episodes():
    rows = [episode(1, 1.0, "Collision"), episode(3, 0.2, "Idle", seed=1), episode(5, 0.0, "Success", length=40)]
    cell = summarise(rows)
    assert cell.return_mean == 3
    assert cell.return_std == pytest.approx(np.sqrt(8 / 3))
    assert cell.cost_mean == pytest.approx(0.4)
    assert cell.cost_std == pytest.approx(np.sqrt((0.36 + 0.04 + 0.16) / 3))
    assert (cell.success, cell.tight, cell.loose) == pytest.approx((1 / 3, 1 / 3, 1 / 3))
    assert (cell.episodes, cell.seeds, cell.length_mean) == (3, 2, 20)
    seen = {reason: count for reason, count in cell.reasons.items() if count}
    assert seen == {"Collision": 1, "Idle": 1, "Success": 1}


def test_no_episodes_have_no_summary():
    with pytest.raises(ValueError, match="no episodes"):
        summarise([])


def log(steps, returns, tight, loose, last_step: int = 1000) -> TrainingLog:
    return TrainingLog("PPO", 0, np.array(steps), *map(np.array, (returns, tight, loose)), last_step=last_step)


def test_the_cost_rate_is_violations_so_far_over_steps_so_far():
    found = training_curve(log([10, 20, 30], [1, 2, 3], [1, 0, 1], [0, 0.2, 0]), np.array([5, 10, 20, 40]))
    np.testing.assert_allclose(found.total_rate, [0, 1 / 10, 2 / 20, 3 / 40])
    np.testing.assert_allclose(found.tight_rate, [0, 1 / 10, 1 / 20, 2 / 40])
    np.testing.assert_allclose(found.loose_rate, [0, 0, 1 / 20, 1 / 40])


def test_the_running_return_is_the_mean_of_the_last_fifty_episodes_only():
    returns = np.arange(60.0)
    found = training_curve(log(np.arange(1, 61), returns, returns * 0, returns * 0), np.array([2, 50, 60]))
    np.testing.assert_allclose(found.return_, [0.5, 24.5, 34.5])


def test_there_is_no_return_before_the_first_episode_has_ended():
    assert np.isnan(training_curve(log([10], [1], [0], [0]), np.array([9])).return_[0])


def test_mean_and_std_leave_out_runs_without_a_value():
    mean, std = mean_and_std([np.array([np.nan, 1.0]), np.array([4.0, 3.0])])
    np.testing.assert_allclose(mean, [4, 2])
    np.testing.assert_allclose(std, [0, 1])


def test_a_curve_ends_at_the_last_step_of_its_run():
    found = training_curve(log([10, 20], [1, 3], [1, 0], [0, 0.2], last_step=25), np.array([20, 25, 26, 40]))
    np.testing.assert_allclose(found.return_, [2, 2, np.nan, np.nan])
    np.testing.assert_allclose(found.total_rate, [2 / 20, 2 / 25, np.nan, np.nan])
    np.testing.assert_allclose(found.tight_rate, [1 / 20, 1 / 25, np.nan, np.nan])
    np.testing.assert_allclose(found.loose_rate, [1 / 20, 1 / 25, np.nan, np.nan])


def test_a_band_continues_with_the_longer_runs():
    short, long = np.array([1.0, 2.0, np.nan, np.nan]), np.array([3.0, 4.0, 5.0, np.nan])
    mean, std = mean_and_std([short, long])
    np.testing.assert_allclose(mean, [2, 3, 5, np.nan])
    np.testing.assert_allclose(std, [1, 1, 0, np.nan])


def test_regret_is_what_blocks_of_episodes_cost_beyond_the_limit():
    """Of 120 episodes the first 50 cost 0.5 each, the next 50 nothing, the last 20 0.2: (50 x 0.4 + 20 x 0.1) / 120."""
    costs = np.repeat([0.5, 0.0, 0.2], [50, 50, 20])
    tight = np.where(costs > 0.3, costs, 0.0)
    log = TrainingLog("PPO", 0, np.arange(120), costs * 0, tight, costs - tight, 1000)
    assert regret(log, 0.1) == pytest.approx(22.0 / 120)
    assert regret(log, 1.0) == 0.0
    assert np.isnan(regret(TrainingLog("PPO", 0, *[np.zeros(0)] * 4, 1000), 0.1))  # pyright: ignore


def test_the_share_of_what_lay_ahead_is_a_mean_of_rows_that_all_have_it():
    row = Episode("PPO", 0, "Easy", 1, 0, 0, 0, 5, 0, 1.0, 0.0, 0.0, 0.0, 9, "Idle", False, 0.5, ahead=0.25)
    assert summarise([row, replace(row, ahead=0.75)]).ahead_mean == 0.5
    assert summarise([row, replace(row, ahead=None)]).ahead_mean is None
