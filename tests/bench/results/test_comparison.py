"""Tests of comparisons: known values, an independent formula, and the coverage of intervals."""

import numpy as np
import pytest
from scipy import stats

from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.results.comparison import (
    difference_between_starts,
    matched_scores,
    mean_difference,
    paired_difference,
    performance_profile,
    probability_of_improvement,
)
from thalweg.bench.results.inference import wilson_interval

OURS = np.array([[3.0, 5.0], [1.0, 1.0]])
THEIRS = np.array([[4.0, 4.0], [0.0, 1.0]])


def episode(algorithm: str, seed: int, number: int, return_: float) -> Episode:
    return Episode(
        algorithm,
        seed,
        "Easy",
        7,
        number,
        float(number),
        0.0,
        5.0,
        0.0,
        return_,
        0.0,
        0.0,
        0.0,
        9,
        "Success",
        True,
        1.0,
    )


def test_the_probability_of_improvement_counts_pairs_of_the_same_start():
    # Start 0: 3 and 5 against 4 and 4: two of four; start 1: 1 and 1 against 0 and 1: two won, two even.
    assert probability_of_improvement(OURS, THEIRS).value == (2 / 4 + 3 / 4) / 2
    assert probability_of_improvement(THEIRS, OURS).value == 1 - (2 / 4 + 3 / 4) / 2


def test_a_mean_difference_has_welchs_interval():
    random = np.random.default_rng(0)
    ours = random.normal([1.0, 3.0, 5.0, 2.0, 4.0], 1.0, (20, 5))
    theirs = random.normal([0.5, 5.5, 9.5], 3.0, (20, 3))
    found = mean_difference(ours, theirs, "length")
    welch = stats.ttest_ind(ours.mean(0), theirs.mean(0), equal_var=False).confidence_interval(0.95)
    np.testing.assert_allclose([found.low, found.high], [welch.low, welch.high], rtol=1e-12)
    assert found.value == pytest.approx(ours.mean() - theirs.mean())


def test_a_difference_is_clipped_to_the_possible_ones():
    ours, theirs = np.array([[10.0, 10.0, 4.0]]), np.zeros((1, 3))  # 8 ± 2 * 4.30
    for compared in (mean_difference, paired_difference):
        assert (compared(ours, theirs, "return_").value, compared(ours, theirs, "return_").high) == (8.0, 10.0)
        assert compared(theirs, ours, "return_").low == -10.0
        assert compared(ours, theirs, "length").high > 16.0


def test_seeds_that_agree_have_at_least_the_interval_of_their_starts():
    theirs = np.zeros((4, 3))
    ours = theirs + np.array([[1.0], [3.0], [1.0], [3.0]])
    half = 3.1824463 * (4 / 3) ** 0.5 / 2  # t of 97.5 % and 3 degrees of freedom, deviation of four starts
    for compared in (mean_difference, paired_difference):
        found = compared(ours, theirs, "return_")
        assert (found.value, found.low, found.high) == pytest.approx((2.0, 2.0 - half, 2.0 + half))


def test_starts_that_agree_too_have_at_least_the_interval_of_independent_episodes():
    whole, steps, none = np.full((20, 3), 10.0), np.full((20, 3), sum([10.0 / 288] * 288)), np.zeros((20, 3))
    z, n = 1.959964, 60
    tenfold = 10 * z**2 / (n + z**2)  # Wilson's interval of none of sixty, and of sixty of sixty, is so wide
    for ours in (whole, steps):
        for compared in (mean_difference, paired_difference):
            found = compared(ours, none, "return_")
            assert (found.low, found.high) == pytest.approx((10.0 - tenfold * 2**0.5, 10.0))
            even = compared(ours, whole, "return_")
            assert (even.value, even.low, even.high) == pytest.approx((0.0, -tenfold, tenfold))


def test_a_paired_difference_needs_the_same_policies():
    with pytest.raises(ValueError, match=r"\(20, 3\) and \(20, 1\) are not of the same starts and policies"):
        paired_difference(np.ones((20, 3)), np.zeros((20, 1)), "return_")


def test_a_change_between_other_starts_has_at_least_welchs_interval_over_both_lists():
    """Seeds that agree: 5 on the one list (4 and 6 in turn), 9 on the other (8, 9 and 10)."""
    after, before = np.array([[4.0], [6.0]] * 5).repeat(3, 1), np.array([[8.0], [9.0], [10.0]]).repeat(3, 1)
    found = difference_between_starts(after, before, "length")
    welch = stats.ttest_ind(after[:, 0], before[:, 0], equal_var=False).confidence_interval(0.95)
    assert found.value == -4.0
    np.testing.assert_allclose([found.low, found.high], [welch.low, welch.high], rtol=1e-12)


def test_a_change_between_other_starts_is_paired_by_seed():
    after, before = np.array([[1.0, 3.0, 8.0]] * 20), np.array([[2.0, 4.5, 10.0]] * 9)
    found = difference_between_starts(after, before, "length")  # -1, -1.5 and -2: 4.303 * 0.5 / √3
    half = 4.3026527 * 0.5 / 3**0.5
    independent = np.hypot(*(stats.t.ppf(0.975, each.size - 1) * stats.sem(each.ravel()) for each in (after, before)))
    assert half < independent  # starts agree, so that the interval is that of independent episodes
    assert (found.value, found.low, found.high) == pytest.approx((-1.5, -1.5 - independent, -1.5 + independent))
    apart = before + np.array([[0.0, 0.0, 20.0]])  # -1, -1.5 and -22
    seeds = difference_between_starts(after, apart, "length")
    alone = stats.ttest_1samp((after.mean(0) - apart.mean(0)), 0.0).confidence_interval(0.95)
    assert seeds.low <= alone.low and seeds.high >= alone.high
    with pytest.raises(ValueError, match=r"\(20, 3\) and \(9, 2\) are not of the same policies"):
        difference_between_starts(after, before[:, :2], "return_")


def test_the_difficulty_of_a_start_cancels_out():
    starts = np.random.default_rng(1).normal(0.0, 100.0, (20, 1))
    ours, theirs = OURS[:1].repeat(20, 0), THEIRS[:1].repeat(20, 0)
    assert (
        probability_of_improvement(ours + starts, theirs + starts).value
        == probability_of_improvement(ours, theirs).value
    )
    found = paired_difference(ours + starts, ours + starts - [[1.0, 2.0]], "return_")
    assert found.value == pytest.approx(1.5)


def test_there_is_no_interval_of_two_seeds():
    for found in (
        probability_of_improvement(OURS, THEIRS),
        *(each(OURS, THEIRS, "return_") for each in (mean_difference, paired_difference)),
    ):
        assert np.isnan(found.low) and np.isnan(found.high)


def test_three_seeds_that_always_win_still_have_an_interval():
    found = probability_of_improvement(np.ones((20, 3)), np.zeros((20, 3)))
    assert (found.value, found.high) == (1.0, 1.0)
    assert found.low == pytest.approx(stats.binomtest(60, 60).proportion_ci(0.95, method="wilson").low)


@pytest.mark.parametrize(("held", "count"), [(0, 20), (7, 20), (60, 60)])
def test_wilsons_interval_is_that_of_scipy(held: int, count: int):
    there = stats.binomtest(held, count).proportion_ci(0.95, method="wilson")
    np.testing.assert_allclose(wilson_interval(held / count, count), (there.low, there.high), atol=1e-12)


def test_the_interval_of_an_improvement_covers_the_true_value_about_as_often_as_stated():
    """Seeds differ by N(0, 1), flights by N(0, 1): P(X > Y) = Φ(½ / 2) where the means are ½ apart."""
    random, truth, held, trials = np.random.default_rng(2), stats.norm.cdf(0.5 / 2.0), 0, 400
    for _ in range(trials):
        ours, theirs = (random.normal(mean, 1.0, (20, 5)) + random.normal(0, 1.0, (1, 5)) for mean in (0.5, 0.0))
        found = probability_of_improvement(ours, theirs)
        held += found.low <= truth <= found.high
    assert 0.90 <= held / trials <= 0.99


def test_a_profile_is_the_share_of_episodes_with_at_least_a_return():
    table = np.array([[1.0, 2.0, 3.0], [3.0, 4.0, 5.0]])
    share, low, high = performance_profile(table, np.array([0.0, 2.0, 3.5]))
    np.testing.assert_allclose(share, [1.0, 5 / 6, 2 / 6])
    assert (low <= share).all() and (share <= high).all() and high.max() <= 1.0
    assert np.isnan(performance_profile(table[:, :2])[1]).all()
    certain = performance_profile(np.full((20, 3), 10.0), np.array([10.0]))[1]  # sixty of sixty
    assert certain == pytest.approx(stats.binomtest(60, 60).proportion_ci(0.95, method="wilson").low)


def test_rounding_of_returns_does_not_decide_a_comparison():
    whole, steps = np.full((2, 3), 10.0), np.full((2, 3), sum([10.0 / 288] * 288))
    assert (whole != steps).all()
    assert probability_of_improvement(whole, steps).value == probability_of_improvement(steps, whole).value == 0.5
    assert performance_profile(steps, np.array([10.0]))[0] == performance_profile(whole, np.array([10.0]))[0] == 1.0


def test_matched_scores_have_the_same_starts_in_the_same_order():
    ours = [episode("A", seed, number, 10.0 * seed + number) for seed in (3, 1) for number in (1, 0)]
    theirs = [episode("B", 0, number, -float(number)) for number in (0, 1)]
    first, second = matched_scores(ours, theirs, "return_")
    np.testing.assert_array_equal(first, [[10.0, 30.0], [11.0, 31.0]])
    np.testing.assert_array_equal(second, [[0.0], [-1.0]])
    with pytest.raises(ValueError, match="1 starts were flown by one of them only"):
        matched_scores(ours, theirs[:1], "return_")
