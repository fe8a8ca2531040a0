"""Tests of confidence intervals: on numbers computed by hand, and by their coverage of the true value."""

from dataclasses import replace

import numpy as np
import pytest

from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.results.inference import (
    Statistic,
    bootstrap_iqm_return,
    iqm,
    iqm_return,
    mean_estimate,
    proportion,
    score_matrix,
    seed_estimate,
)

ROW = Episode("PPO", 0, "Easy", 1, 0, 0.0, 0.0, 2.0, 0.0, 1.0, 0.0, 0.0, 0.0, 10, "Idle", False, 0.1)


def rows(table: list[list[float]], level: str = "Easy") -> list[Episode]:
    """Episodes with the returns [L, M]."""
    return [
        replace(ROW, level=level, episode=start, seed=seed, return_=value)
        for start, values in enumerate(table)
        for seed, value in enumerate(values)
    ]


def test_a_score_matrix_has_a_row_for_each_start_and_a_column_for_each_seed():
    both = [*rows([[1.0, 2.0], [3.0, 4.0]], "Easy"), *rows([[5.0, 6.0]], "Hard")]
    assert score_matrix(both[::-1]).tolist() == [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]
    assert score_matrix(both, "length").tolist() == [[10.0, 10.0]] * 3
    with pytest.raises(ValueError, match="3 episodes are not those of 2 seeds from 2 starts each"):
        score_matrix(both[:3])
    with pytest.raises(ValueError, match="not those of"):
        score_matrix([*both, both[0]])


def test_the_interquartile_mean_is_that_of_the_middle_half():
    assert iqm(np.array([100.0, 3.0, 1.0, -50.0, 5.0, 4.0, 2.0, 6.0])) == pytest.approx((2 + 3 + 4 + 5) / 4)


def test_the_interval_is_students_t_over_seeds():
    found = seed_estimate(np.array([[1.0, 2.0, 6.0], [3.0, 4.0, 8.0]]), np.mean)  # seeds: 2, 3, 7
    deviation = (((2 - 4) ** 2 + (3 - 4) ** 2 + (7 - 4) ** 2) / 2) ** 0.5
    half = 4.302653 * deviation / 3**0.5  # t of 97.5 % and 2 degrees of freedom
    assert (found.value, found.low, found.high) == pytest.approx((4.0, 4.0 - half, 4.0 + half))


def test_an_interval_is_centred_on_the_mean_of_the_seeds_and_contains_the_value():
    """The seeds' interquartile means are 0, 0 and 10; of the middle six of all twelve episodes, all but one are 0."""
    found, half = seed_estimate(np.array([[0.0, 0.0, 10.0]] * 4)), 4.302653 * (100 / 3) ** 0.5 / 3**0.5
    assert (found.value, found.low, found.high) == pytest.approx((10 / 6, 10 / 3 - half, 10 / 3 + half))
    found = seed_estimate(
        np.array([[0.0] * 3, [0.0] * 3, [9.0] * 3])
    )  # each seed's is 3, that of the middle five 9 / 5
    assert (found.value, found.low, found.high) == pytest.approx((1.8, 1.8, 3.0))


def test_fewer_than_three_seeds_have_no_interval():
    assert str(seed_estimate(np.array([[1.0, 2.0], [3.0, 4.0]]), np.mean)) == "2.50"
    assert str(iqm_return(rows([[2.0, 2.0, 2.0], [4.0, 4.0, 4.0]]))) == "3.00"  # equal seeds
    assert str(iqm_return(rows([[2.0, 2.0, 2.0], [4.0, 4.0, 4.0]])[:-1])) == "2.67"  # a flight is missing


def test_the_bootstrap_resamples_the_seeds_of_each_start():
    """Twice independently: by listing every draw of one start's three seeds, and by drawing by hand for ten starts."""
    one = bootstrap_iqm_return(rows([[0.0, 3.0, 9.0]]))  # one of 27 draws is 0, 0, 0, one 9, 9, 9: 3.7 % each
    assert (one.value, one.low, one.high) == (4.0, 0.0, 9.0)
    table, generator = np.random.default_rng(1).uniform(0, 10, (10, 3)), np.random.default_rng(2)
    means = [iqm(np.concatenate([generator.choice(seeds, 3) for seeds in table])) for _ in range(4000)]
    found = bootstrap_iqm_return(rows(table.tolist()))
    assert found.value == pytest.approx(iqm(table.ravel()))
    assert (found.low, found.high) == pytest.approx(tuple(np.percentile(means, [2.5, 97.5])), abs=0.15)
    assert str(bootstrap_iqm_return(rows([[2.0, 4.0]]))) == "3.00"


def test_with_three_seeds_that_differ_as_much_as_episodes_the_bootstrap_covers_less_than_half():
    generator, held = np.random.default_rng(0), 0
    for _ in range(60):
        table = generator.normal(0, 1, (1, 3)) + generator.normal(0, 1, (20, 3))
        found = bootstrap_iqm_return(rows(table.tolist()))
        held += found.low <= 0.0 <= found.high
    assert 0.2 < held / 60 < 0.5


def test_an_interval_is_clipped_to_the_possible_means():
    flown = rows([[2.0, 10.0, 10.0], [2.0, 10.0, 10.0]])  # 22 / 3 and 4.3 * 4.6 / sqrt(3) on both sides
    assert str(mean_estimate(flown, "return_")) == "7.33 [0.00, 10.00]"
    assert str(iqm_return(flown)) == "8.00 [0.00, 10.00]"
    assert str(mean_estimate([replace(row, cost=row.return_ / 10) for row in flown], "cost")) == "0.73 [0.00, 1.00]"


def test_returns_below_that_of_the_papers_task_have_no_least_value():
    found = mean_estimate(rows([[-0.1, -0.1, 0.0]] * 2), "return_")
    assert found.low < found.value < 0.0


def test_bounds_that_are_given_hold_for_returns_within_those_of_the_papers_task():
    flown = rows([[2.0, 10.0, 10.0], [2.0, 10.0, 10.0]])  # 22 / 3 and 4.3 * 4.6 / sqrt(3) on both sides
    assert str(mean_estimate(flown, "return_", (-10.0, None))) == "7.33 [-4.14, 10.00]"


def test_seeds_with_equal_means_have_at_least_the_interval_of_their_episodes():
    # n = 6, mean 0.4, deviation sqrt(6 * 0.16 / 5); t of 97.5 % and 5 degrees of freedom
    half = 2.570582 * (6 * 0.16 / 5) ** 0.5 / 6**0.5
    found = mean_estimate([replace(row, cost=row.return_) for row in rows([[0.0, 0.0, 0.8], [0.8, 0.8, 0.0]])], "cost")
    assert (found.low, found.high) == pytest.approx((max(0.4 - half, 0.0), 0.4 + half))


def test_equal_episodes_still_have_an_interval():
    z, n = 1.959964, 60
    flown = rows([[10.0] * 3] * 20)
    assert (mean_estimate(flown, "cost").low, mean_estimate(flown, "cost").high) == pytest.approx(
        (0.0, z**2 / (n + z**2))
    )
    for whole in (10.0, sum([10.0 / 288] * 288)):  # rounding in the last digits of a sum
        found = mean_estimate(rows([[10.0] * 3] * 10 + [[whole] * 3] * 10), "return_")
        assert (found.low, found.high) == pytest.approx((10 * n / (n + z**2), 10.0))


@pytest.mark.parametrize("statistic", [np.mean, iqm])
@pytest.mark.parametrize("seeds", [3, 5])
def test_intervals_over_seeds_cover_the_true_value_in_nineteen_of_twenty_cases(seeds: int, statistic: Statistic):
    generator, held = np.random.default_rng(0), 0
    for _ in range(400):
        found = seed_estimate(generator.normal(0, 1, (1, seeds)) + generator.normal(0, 1, (20, seeds)), statistic)
        held += found.low <= 0.0 <= found.high
    assert 0.92 <= held / 400 <= 0.98


def test_a_proportion_of_fewer_than_three_seeds_has_no_interval():
    for seeds in (1, 2):
        found = proportion(rows([[float(start < 3)] * seeds for start in range(20)]), lambda row: row.return_ > 0)
        assert str(found) == "15%"


def test_a_proportion_has_at_least_the_interval_of_its_seeds_and_of_its_episodes():
    apart = proportion(rows([[0.0, 0.0, 1.0]] * 20), lambda row: row.return_ > 0)  # shares of 0, 0 and 1
    assert (apart.low, apart.high) == (0.0, 1.0)
    alike = proportion(rows([[0.0, 0.0, 0.0]] * 20), lambda row: row.return_ > 0)
    assert alike.low == pytest.approx(0.0, abs=1e-12) and 0.04 < alike.high < 0.08
    assert str(proportion(rows([[0.0, 1.0]] * 20), lambda row: row.return_ > 0)) == "50%"
