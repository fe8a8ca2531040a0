"""Intervals and comparisons: on numbers worked by hand, and by how often they hold the truth."""

from dataclasses import replace

import numpy as np
import pytest

from thalweg.bench.episodes import Episode
from thalweg.bench.inference import (
    difference,
    improvement,
    iqm,
    limit_met,
    profile,
    proportion,
    regret,
    stratified,
    table_of,
)

ROW = Episode("PPO", 0, "Easy", 1, 0, 0.0, 0.0, 2.0, 0.0, 1.0, 0.0, 0.0, 0.0, 10, "Idle", False, 0.1)


def rows(table: list[list[float]], level: str = "Easy") -> list[Episode]:
    """Episodes with the returns [L, M]."""
    return [
        replace(ROW, level=level, episode=start, seed=seed, return_=value)
        for start, values in enumerate(table)
        for seed, value in enumerate(values)
    ]


def test_a_table_has_a_row_for_each_start_and_a_column_for_each_seed():
    both = [*rows([[1.0, 2.0], [3.0, 4.0]], "Easy"), *rows([[5.0, 6.0]], "Hard")]
    assert table_of(both[::-1]).tolist() == [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]
    assert table_of(both, "length").tolist() == [[10.0, 10.0]] * 3
    with pytest.raises(ValueError, match="3 episodes are not those of 2 seeds from 2 starts each"):
        table_of(both[:3])
    with pytest.raises(ValueError, match="not those of"):
        table_of([*both, both[0]])


def test_the_interquartile_mean_is_that_of_the_middle_half():
    assert iqm(np.array([100.0, 3.0, 1.0, -50.0, 5.0, 4.0, 2.0, 6.0])) == pytest.approx((2 + 3 + 4 + 5) / 4)


def test_an_interval_needs_three_seeds_and_holds_the_figure():
    table = np.random.default_rng(0).normal(5.0, 1.0, (20, 3))
    found = stratified(table)
    assert found.low < found.value < found.high and found.value == pytest.approx(float(iqm(table.ravel())))
    assert str(stratified(table[:, :2])) == f"{float(iqm(table[:, :2].ravel())):.2f}"
    assert stratified(table) == found


def test_seeds_are_drawn_within_each_start():
    # Starts differ by far, seeds not at all: there is nothing to be unsure of.
    table = np.repeat(np.arange(20.0)[:, None], 3, 1)
    found = stratified(table, np.mean)
    assert (found.low, found.high) == pytest.approx((9.5, 9.5))


def test_intervals_of_nineteen_in_twenty_hold_the_truth():
    generator, held = np.random.default_rng(0), 0
    for _ in range(100):
        found = stratified(generator.normal(0.0, 1.0, (20, 5)), np.mean)
        held += found.low <= 0.0 <= found.high
    assert 84 <= held <= 99  # resampling five seeds is a little too sure: √(4/5) of the width, 92 %


def test_improvement_counts_wins_and_half_the_ties():
    better, worse = np.array([[2.0, 5.0], [1.0, 1.0]]), np.array([[1.0, 5.0], [1.0, 3.0]])
    first = (1 + 0 + 1 + 0.5) / 4
    second = (0.5 + 0 + 0.5 + 0) / 4
    assert improvement(better, worse).value == pytest.approx((first + second) / 2)
    assert improvement(worse, better).value == pytest.approx(1 - (first + second) / 2)


def test_improvement_of_three_seeds_has_an_interval():
    generator = np.random.default_rng(1)
    better, worse = generator.normal(1.0, 1.0, (20, 3)), generator.normal(0.0, 1.0, (20, 3))
    found = improvement(better, worse)
    assert 0.5 < found.low < found.value < found.high <= 1.0
    with pytest.raises(ValueError, match="20 and 19 starts are no pairs"):
        improvement(better, worse[:19])


def test_pairs_tell_apart_what_starts_hide():
    generator = np.random.default_rng(2)
    hard = generator.normal(0.0, 10.0, (20, 1))
    first = hard + 0.5 + generator.normal(0.0, 0.3, (20, 3))
    second = hard + generator.normal(0.0, 0.3, (20, 3))
    found = difference(first, second)
    assert 0.0 < found.low < 0.5 < found.high < 1.0
    assert difference(first, first).value == 0.0


def test_a_share_has_wilsons_interval():
    found = proportion(3, 20)  # z = 1.96: (p + z²/2n ± z √(p(1-p)/n + z²/4n²)) / (1 + z²/n)
    p, n, z = 0.15, 20, 1.959964
    middle, half = p + z**2 / (2 * n), z * (p * (1 - p) / n + z**2 / (4 * n**2)) ** 0.5
    assert (found.low, found.high) == pytest.approx(
        ((middle - half) / (1 + z**2 / n), (middle + half) / (1 + z**2 / n))
    )
    assert proportion(0, 20).low == pytest.approx(0.0, abs=1e-12) and proportion(0, 20).high > 0.1


def test_a_profile_falls_from_all_to_none():
    assert profile(np.array([[1.0, 2.0], [2.0, 4.0]]), np.array([0.0, 1.0, 2.0, 2.5, 5.0])).tolist() == [
        1.0,
        1.0,
        0.75,
        0.25,
        0.0,
    ]


def test_regret_adds_up_what_was_above_the_limit():
    assert regret(np.array([0.0, 1.0, 0.2, 0.05]), 0.1) == pytest.approx(0.9 + 0.1)


def test_a_limit_is_met_broken_or_not_yet_known():
    costs = np.zeros((20, 3))
    assert limit_met(costs, 0.1) == "yes" and limit_met(costs + 1.0, 0.1) == "no"
    some = costs.copy()
    some[0, 0] = some[1, 1] = some[2, 2] = some[3, 0] = some[4, 1] = some[5, 2] = 1.0
    assert limit_met(some, 0.1) == "unclear"
    assert limit_met(some[:, :1], 0.2) == "yes?" and limit_met(some[:, :1], 0.05) == "no?"
