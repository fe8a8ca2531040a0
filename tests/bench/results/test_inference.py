"""Intervals: on numbers worked by hand, and by how often they hold the truth."""

from dataclasses import replace

import numpy as np
import pytest

from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.results.inference import (
    Statistic,
    bootstrapped_return,
    iqm,
    mean_of,
    middle_return,
    over_seeds,
    share,
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


def test_the_interval_is_students_over_the_seeds():
    found = over_seeds(np.array([[1.0, 2.0, 6.0], [3.0, 4.0, 8.0]]), np.mean)  # seeds: 2, 3, 7
    deviation = (((2 - 4) ** 2 + (3 - 4) ** 2 + (7 - 4) ** 2) / 2) ** 0.5
    half = 4.302653 * deviation / 3**0.5  # t of 97.5 % and 2 degrees of freedom
    assert (found.value, found.low, found.high) == pytest.approx((4.0, 4.0 - half, 4.0 + half))


def test_an_interval_is_around_the_mean_of_the_seeds_and_holds_the_figure():
    """Seeds' interquartile means are 0, 0 and 10; of all twelve episodes the middle six are 0 but for one."""
    found, half = over_seeds(np.array([[0.0, 0.0, 10.0]] * 4)), 4.302653 * (100 / 3) ** 0.5 / 3**0.5
    assert (found.value, found.low, found.high) == pytest.approx((10 / 6, 10 / 3 - half, 10 / 3 + half))
    found = over_seeds(np.array([[0.0] * 3, [0.0] * 3, [9.0] * 3]))  # each seed's is 3, that of the middle five 9 / 5
    assert (found.value, found.low, found.high) == pytest.approx((1.8, 1.8, 3.0))


def test_fewer_than_three_seeds_have_no_interval():
    assert str(over_seeds(np.array([[1.0, 2.0], [3.0, 4.0]]), np.mean)) == "2.50"
    assert str(middle_return(rows([[2.0, 2.0, 2.0], [4.0, 4.0, 4.0]]))) == "3.00"  # no certainty either
    assert str(middle_return(rows([[2.0, 2.0, 2.0], [4.0, 4.0, 4.0]])[:-1])) == "2.67"  # a flight is missing


def test_the_bootstrap_draws_among_the_seeds_of_each_start():
    """Twice independently: by listing every draw of one start's three seeds, and by drawing by hand for ten starts."""
    one = bootstrapped_return(rows([[0.0, 3.0, 9.0]]))  # one of 27 draws is 0, 0, 0, one 9, 9, 9: 3.7 % each
    assert (one.value, one.low, one.high) == (4.0, 0.0, 9.0)
    table, generator = np.random.default_rng(1).uniform(0, 10, (10, 3)), np.random.default_rng(2)
    means = [iqm(np.concatenate([generator.choice(seeds, 3) for seeds in table])) for _ in range(4000)]
    found = bootstrapped_return(rows(table.tolist()))
    assert found.value == pytest.approx(iqm(table.ravel()))
    assert (found.low, found.high) == pytest.approx(tuple(np.percentile(means, [2.5, 97.5])), abs=0.15)
    assert str(bootstrapped_return(rows([[2.0, 4.0]]))) == "3.00"


def test_where_three_seeds_differ_as_much_as_episodes_the_bootstrap_holds_the_truth_in_fewer_than_half():
    generator, held = np.random.default_rng(0), 0
    for _ in range(60):
        table = generator.normal(0, 1, (1, 3)) + generator.normal(0, 1, (20, 3))
        found = bootstrapped_return(rows(table.tolist()))
        held += found.low <= 0.0 <= found.high
    assert 0.2 < held / 60 < 0.5


def test_an_interval_holds_nothing_that_no_mean_can_be():
    flown = rows([[2.0, 10.0, 10.0], [2.0, 10.0, 10.0]])  # 22 / 3 and 4.3 * 4.6 / sqrt(3) on both sides
    assert str(mean_of(flown, "return_")) == "7.33 [0.00, 10.00]"
    assert str(middle_return(flown)) == "8.00 [0.00, 10.00]"
    assert str(mean_of([replace(row, cost=row.return_ / 10) for row in flown], "cost")) == "0.73 [0.00, 1.00]"


def test_seeds_whose_means_agree_are_no_surer_than_their_episodes():
    # n = 6, mean 0.4, deviation sqrt(6 * 0.16 / 5); t of 97.5 % and 5 degrees of freedom
    half = 2.570582 * (6 * 0.16 / 5) ** 0.5 / 6**0.5
    found = mean_of([replace(row, cost=row.return_) for row in rows([[0.0, 0.0, 0.8], [0.8, 0.8, 0.0]])], "cost")
    assert (found.low, found.high) == pytest.approx((max(0.4 - half, 0.0), 0.4 + half))


def test_equal_episodes_are_no_certainty():
    z, n = 1.959964, 60
    flown = rows([[10.0] * 3] * 20)
    assert (mean_of(flown, "cost").low, mean_of(flown, "cost").high) == pytest.approx((0.0, z**2 / (n + z**2)))
    for whole in (10.0, sum([10.0 / 288] * 288)):  # the last digits of a sum decide nothing
        found = mean_of(rows([[10.0] * 3] * 10 + [[whole] * 3] * 10), "return_")
        assert (found.low, found.high) == pytest.approx((10 * n / (n + z**2), 10.0))


@pytest.mark.parametrize("statistic", [np.mean, iqm])
@pytest.mark.parametrize("seeds", [3, 5])
def test_where_seeds_differ_as_much_as_episodes_nineteen_in_twenty_hold_the_truth(seeds: int, statistic: Statistic):
    generator, held = np.random.default_rng(0), 0
    for _ in range(400):
        found = over_seeds(generator.normal(0, 1, (1, seeds)) + generator.normal(0, 1, (20, seeds)), statistic)
        held += found.low <= 0.0 <= found.high
    assert 0.92 <= held / 400 <= 0.98


def test_the_share_of_fewer_than_three_seeds_has_no_interval():
    for seeds in (1, 2):
        found = share(rows([[float(start < 3)] * seeds for start in range(20)]), lambda row: row.return_ > 0)
        assert found.as_percent() == "15%"


def test_the_share_of_several_seeds_is_no_surer_than_its_seeds_or_its_episodes():
    apart = share(rows([[0.0, 0.0, 1.0]] * 20), lambda row: row.return_ > 0)  # shares of 0, 0 and 1
    assert (apart.low, apart.high) == (0.0, 1.0)
    alike = share(rows([[0.0, 0.0, 0.0]] * 20), lambda row: row.return_ > 0)
    assert alike.low == pytest.approx(0.0, abs=1e-12) and 0.04 < alike.high < 0.08
    assert share(rows([[0.0, 1.0]] * 20), lambda row: row.return_ > 0).as_percent() == "50%"
