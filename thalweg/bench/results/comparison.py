"""Statistical comparison of two algorithms on episodes from the same starts.

Every algorithm flies the same list of starts, so that the difficulty of a start cancels out: the probability of
improvement (Agarwal et al. 2021) is computed start by start, and differences are paired by start. As in `inference`,
the independent samples are seeds: each pair of one seed of either algorithm gives one number, and the variation of
these numbers with either seed gives the interval. `difference_between_starts` alone compares other starts, paired by
seed.

Letters: L starts, J other starts, M and K seeds of the two algorithms.
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy import stats

from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.results.inference import (
    CONFIDENCE,
    MIN_SEEDS,
    PAPERS,
    TOLERANCE,
    Bounds,
    Estimate,
    Proportion,
    clip,
    field_range,
    independent_mean,
    score_matrix,
    t_interval,
    widen,
    widen_to_wilson,
)
from thalweg.env.task.reward_cost import FULL_COURSE_REWARD

PROFILE_RETURNS = np.linspace(0.0, FULL_COURSE_REWARD, 101)
"""Returns at which performance profiles are drawn."""


def probability_of_improvement(first: np.ndarray, second: np.ndarray) -> Proportion:
    """Return P(X > Y) + ½ P(X = Y) of returns X in `first` [L, M] and Y in `second` [L, K] from the same start."""
    pairs = _compare_seeds(first, second, lambda x, y: (x - y > TOLERANCE) + 0.5 * (abs(x - y) <= TOLERANCE))
    return widen_to_wilson(_welch_interval(pairs), len(first) * min(pairs.shape))


def mean_difference(first: np.ndarray, second: np.ndarray, field: str, bounds: Bounds = PAPERS) -> Estimate:
    """Return the mean of a field in `first` [L, M] minus that in `second` [L, K], from the same starts.

    `bounds`: of the field, see `inference.field_bounds`.
    """
    estimate = _welch_interval(_compare_seeds(first, second, np.subtract))
    return _widen_to_starts(estimate, first, second, field, bounds)


def paired_difference(after: np.ndarray, before: np.ndarray, field: str, bounds: Bounds = PAPERS) -> Estimate:
    """Return the mean change of a field of the same M policies [L, M] between two conditions, paired by start and
    policy.

    `bounds`: of the field, see `inference.field_bounds`. Raises `ValueError` for matrices of different shapes.
    """
    if after.shape != before.shape:
        raise ValueError(f"episodes {after.shape} and {before.shape} are not of the same starts and policies")
    per_seed = (after - before).mean(0)
    return _widen_to_starts(t_interval(float(per_seed.mean()), per_seed), after, before, field, bounds)


def difference_between_starts(after: np.ndarray, before: np.ndarray, field: str) -> Estimate:
    """Return the mean change of a field of the same M policies between other starts, `after` [L, M] and `before`
    [J, M], paired by policy alone.

    Both lists of starts were drawn, so that the interval is at least as wide as Welch's over starts. Raises
    `ValueError` for other numbers of policies.
    """
    if after.shape[1] != before.shape[1]:
        raise ValueError(f"episodes {after.shape} and {before.shape} are not of the same policies")
    per_seed = after.mean(0) - before.mean(0)
    over_starts = _welch_interval(np.subtract.outer(after.mean(1), before.mean(1)))
    return _widen_to(over_starts, t_interval(float(per_seed.mean()), per_seed), after, before, field)


def _widen_to_starts(
    estimate: Estimate, first: np.ndarray, second: np.ndarray, field: str, bounds: Bounds = PAPERS
) -> Estimate:
    """Return the estimate of a difference with an interval at least as wide as that over the same starts."""
    per_start = first.mean(1) - second.mean(1)
    return _widen_to(t_interval(estimate.value, per_start), estimate, first, second, field, bounds)


def _widen_to(
    over_starts: Estimate,
    estimate: Estimate,
    first: np.ndarray,
    second: np.ndarray,
    field: str,
    bounds: Bounds = PAPERS,
) -> Estimate:
    """Return the estimate of a difference with an interval at least as wide as that `over_starts`, since seeds that
    agree are no evidence of certainty.

    Where the starts agree too, or are too few, the interval is at least as wide as the two independent means imply
    (MOVER: Zou and Donner 2008, "Construction of confidence limits about effect measures").
    """
    if np.isnan(over_starts.low) or over_starts.high - over_starts.low <= TOLERANCE:
        one, other = independent_mean(first, field, bounds), independent_mean(second, field, bounds)
        below = np.hypot(one.value - one.low, other.high - other.value)
        above = np.hypot(one.high - one.value, other.value - other.low)
        over_starts = Estimate(estimate.value, estimate.value - float(below), estimate.value + float(above))
    greatest = field_range(field, first, second, bounds=bounds)
    return clip(widen(estimate, over_starts), -greatest, greatest)


def matched_scores(first: Sequence[Episode], second: Sequence[Episode], field: str) -> tuple[np.ndarray, np.ndarray]:
    """Return a field of both as matrices [L, M] and [L, K] of starts and seeds.

    Raises `ValueError` unless every seed of either flew the same starts, each once.
    """
    starts = [
        {(row.level, row.world_seed, row.episode, row.x, row.y, row.z) for row in rows} for rows in (first, second)
    ]
    if starts[0] != starts[1]:
        raise ValueError(f"{len(starts[0] ^ starts[1])} starts were flown by one of them only")
    return score_matrix(first, field), score_matrix(second, field)


def performance_profile(
    scores: np.ndarray, thresholds: np.ndarray = PROFILE_RETURNS
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the performance profile of scores [L, M]: the share at or above each threshold [G], and the ends [G] of
    its pointwise interval, at least as wide as Wilson's; the ends are NaN for too few seeds."""
    per_seed = (scores[:, :, None] >= thresholds - TOLERANCE).mean(0)
    estimates = [widen_to_wilson(t_interval(float(share.mean()), share), scores.size) for share in per_seed.T]
    low, high = (np.array([getattr(estimate, end) for estimate in estimates]) for end in ("low", "high"))
    return np.array([estimate.value for estimate in estimates]), low, high


def _compare_seeds(
    first: np.ndarray, second: np.ndarray, compare: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> np.ndarray:
    """Return the mean over starts of a comparison for each pair of seeds [M, K]."""
    return compare(first[:, :, None], second[:, None, :]).mean(0)


def _welch_interval(pairs: np.ndarray) -> Estimate:
    """Return the mean over pairs of seeds [M, K] with Welch's interval of two samples of seeds.

    What a seed contributes is its mean over the seeds of the other algorithm; for a difference of means this is
    Welch's t test itself.
    """
    value, sizes = float(pairs.mean()), np.array(pairs.shape)
    if sizes.min() < MIN_SEEDS:
        return Estimate(value)
    errors = np.array([pairs.mean(1).var(ddof=1), pairs.mean(0).var(ddof=1)]) / sizes
    if errors.sum() == 0.0:
        return Estimate(value, value, value)
    freedom = errors.sum() ** 2 / (errors**2 / (sizes - 1)).sum()
    half_width = float(stats.t.ppf(0.5 + CONFIDENCE / 2, freedom) * np.sqrt(errors.sum()))
    return Estimate(value, value - half_width, value + half_width)
