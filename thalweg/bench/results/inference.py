"""Confidence intervals of statistics of evaluated episodes.

The quantity of interest is how an algorithm does with any training seed. All episodes of a seed come from one trained
policy, so the independent samples are seeds and not episodes: intervals are Student's t over the statistics of the
seeds, and there is none for fewer than `MIN_SEEDS`. A bootstrap that resamples the seeds of each start separately, or
treats all episodes as independent, is far too narrow: with 3 seeds that differ as much as episodes do, such a 95 %
interval contains the true value in fewer than half of the cases. `bootstrap_iqm_return` computes it nevertheless, for
comparison with studies that report it.

Letters: L starts, M seeds.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from thalweg.bench.evaluate.episodes import Episode
from thalweg.env.task.reward_cost import FULL_COURSE_REWARD

MIN_SEEDS = 3
"""Fewest seeds for which an interval is given."""
CONFIDENCE = 0.95
"""Confidence level of every interval."""
RESAMPLES = 2000
"""Resamples of a bootstrap."""
FIELD_RANGES = {"return_": (0.0, FULL_COURSE_REWARD), "cost": (0.0, 1.0)}
"""Least and greatest return and cost of an episode of the paper's task; intervals of means are clipped to these ranges.
Those of other tasks may differ, see `thalweg.bench.suite.record.bounds_of`."""
Bounds = tuple[float | None, float | None]
"""Least and greatest value of a field of episodes; None for that of the paper's task."""
PAPERS: Bounds = (None, None)
TOLERANCE = 1e-9
"""Returns that differ by no more are equal: a return is a sum, and its last digits depend on the order of rewards."""
Statistic = Callable[..., np.ndarray]
"""A function of an array and an `axis`."""


@dataclass(frozen=True)
class Estimate:
    """A value and its confidence interval; both ends are NaN where there is none."""

    value: float
    low: float = float("nan")
    high: float = float("nan")

    def __str__(self) -> str:
        return f"{self.value:.2f}" if np.isnan(self.low) else f"{self.value:.2f} [{self.low:.2f}, {self.high:.2f}]"


class Proportion(Estimate):
    """A share between 0 and 1, displayed in whole percent."""

    def __str__(self) -> str:
        if np.isnan(self.low):
            return f"{self.value:.0%}"
        return f"{self.value:.0%} [{100 * self.low:.0f}, {100 * self.high:.0f}]"


def score_matrix(rows: Sequence[Episode], field: str = "return_") -> np.ndarray:
    """Return a field of episodes as a matrix [L, M] of starts and seeds.

    Raises `ValueError` unless every seed flew every start of every level exactly once.
    """
    seeds = sorted({row.seed for row in rows})
    starts = sorted({(row.level, row.world_seed, row.episode) for row in rows})
    scores = {(row.level, row.world_seed, row.episode, row.seed): float(getattr(row, field)) for row in rows}
    if len(scores) != len(rows) or len(scores) != len(starts) * len(seeds):
        raise ValueError(f"{len(rows)} episodes are not those of {len(seeds)} seeds from {len(starts)} starts each")
    return np.array([[scores[(*start, seed)] for seed in seeds] for start in starts])


def iqm(values: np.ndarray, axis: int = -1) -> np.ndarray:
    """Return the interquartile mean along an axis, the mean of the middle half of the values (Agarwal et al. 2021,
    "Deep Reinforcement Learning at the Edge of the Statistical Precipice")."""
    return stats.trim_mean(values, 0.25, axis=axis)


def seed_estimate(scores: np.ndarray, statistic: Statistic = iqm) -> Estimate:
    """Return a statistic of all scores [L, M], such as `iqm` or `numpy.mean`, with an interval over the statistics of
    the seeds."""
    return t_interval(float(statistic(scores.ravel(), axis=-1)), statistic(scores, axis=0))


def t_interval(value: float, per_seed: np.ndarray) -> Estimate:
    """Return a value with Student's t interval around the mean of the seeds' values [M]; the interval is widened to
    contain the value, which may differ from that mean."""
    if len(per_seed) < MIN_SEEDS:
        return Estimate(value)
    mean = float(np.mean(per_seed))
    half_width = float(stats.t.ppf(0.5 + CONFIDENCE / 2, len(per_seed) - 1) * stats.sem(per_seed))
    return Estimate(value, min(mean - half_width, value), max(mean + half_width, value))


def wilson_interval(value: float, count: int) -> tuple[float, float]:
    """Return the ends of Wilson's score interval of a proportion observed in `count` independent trials."""
    z = float(stats.norm.ppf(0.5 + CONFIDENCE / 2))
    center, weight = value + z**2 / (2 * count), 1 + z**2 / count
    half_width = z * float(np.sqrt(value * (1 - value) / count + z**2 / (4 * count**2)))
    return (center - half_width) / weight, (center + half_width) / weight


def iqm_return(rows: Sequence[Episode], bounds: Bounds = PAPERS) -> Estimate:
    """Return the interquartile mean of the episodes' returns; `bounds`: see `field_bounds`.

    It has no interval where a seed did not fly every start, nor where it is equal for all seeds: equal values are no
    evidence of certainty.
    """
    try:
        scores = score_matrix(rows)
    except ValueError:
        scores = np.array([[row.return_] for row in rows])
    estimate = clip(seed_estimate(scores), *field_bounds("return_", scores, bounds=bounds))
    return Estimate(estimate.value) if np.ptp(iqm(scores, axis=0)) <= TOLERANCE else estimate


def bootstrap_iqm_return(rows: Sequence[Episode], bounds: Bounds = PAPERS) -> Estimate:
    """Return the interquartile mean with the stratified bootstrap interval of Agarwal et al. (2021).

    Starts are the strata; in each, seeds are drawn with replacement, `RESAMPLES` times. The interval is that of the
    percentiles. `bounds` are those of `iqm_return`, which has the interval where a seed did not fly every start.
    """
    try:
        scores = score_matrix(rows)
    except ValueError:
        return iqm_return(rows, bounds)
    value = float(iqm(scores.ravel()))
    if scores.shape[1] < MIN_SEEDS:
        return Estimate(value)
    interval = stats.bootstrap(
        tuple(scores),
        lambda *strata, axis: iqm(np.concatenate(strata, axis), axis),
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        vectorized=True,
        rng=np.random.default_rng(0),
    ).confidence_interval
    return Estimate(value, float(interval.low), float(interval.high))


def mean_estimate(rows: Sequence[Episode], field: str, bounds: Bounds = PAPERS) -> Estimate:
    """Return the mean of a field over episodes; without an interval where a seed did not fly every start.

    `bounds`: see `field_bounds`.
    The interval is at least as wide as `independent_mean`'s, since equal means of seeds are no evidence of certainty.
    """
    try:
        scores = score_matrix(rows, field)
    except ValueError:
        return Estimate(float(np.mean([getattr(row, field) for row in rows])))
    ends = field_bounds(field, scores, bounds=bounds)
    return clip(widen(seed_estimate(scores, np.mean), _independent_mean(scores, *ends)), *ends)


def independent_mean(scores: np.ndarray, field: str, bounds: Bounds = PAPERS) -> Estimate:
    """Return the mean of scores [L, M] with the interval that they have if all are independent: Student's t, or
    Wilson's where all scores are equal and have a least and a greatest value. `bounds`: see `field_bounds`."""
    return _independent_mean(scores, *field_bounds(field, scores, bounds=bounds))


def _independent_mean(scores: np.ndarray, least: float, most: float) -> Estimate:
    estimate = t_interval(float(scores.mean()), scores.ravel())
    if not np.isfinite(most - least) or np.ptp(scores) > TOLERANCE:
        return estimate
    ends = wilson_interval(float(np.clip((estimate.value - least) / (most - least), 0.0, 1.0)), scores.size)
    return Estimate(estimate.value, *(least + (most - least) * end for end in ends))


def widen(estimate: Estimate, other: Estimate) -> Estimate:
    """Return the estimate with its interval, if both have one, widened to contain the other's."""
    if np.isnan(estimate.low) or np.isnan(other.low):
        return estimate
    return Estimate(estimate.value, min(estimate.low, other.low), max(estimate.high, other.high))


def widen_to_wilson(estimate: Estimate, count: int) -> Proportion:
    """Return a proportion with its interval, if it has one, widened to contain Wilson's of `count` trials and clipped
    to 0..1."""
    wilson = Estimate(estimate.value, *wilson_interval(estimate.value, count))
    widened = clip(widen(estimate, wilson), 0.0, 1.0)
    return Proportion(widened.value, widened.low, widened.high)


def clip(estimate: Estimate, least: float, most: float) -> Estimate:
    """Return the estimate with its interval clipped to bounds."""
    return Estimate(estimate.value, *(float(np.clip(end, least, most)) for end in (estimate.low, estimate.high)))


def field_bounds(field: str, *scores: np.ndarray, bounds: Bounds = PAPERS) -> tuple[float, float]:
    """Return the least and the greatest value of a field of episodes with these scores; infinite where none is known.

    `bounds`: least and greatest, infinite where there is none; None for that of the paper's task, unless an episode
    lies beyond it.
    """
    least, most = bounds
    usual_least, usual_most = FIELD_RANGES.get(field, (-np.inf, np.inf))
    if least is None:
        below = any(each.size and each.min() < usual_least - TOLERANCE for each in scores)
        least = -np.inf if below else usual_least
    if most is None:
        above = any(each.size and each.max() > usual_most + TOLERANCE for each in scores)
        most = np.inf if above else usual_most
    return least, most


def field_range(field: str, *scores: np.ndarray, bounds: Bounds = PAPERS) -> float:
    """Return the greatest possible difference of two means of a field of episodes with these scores; `bounds`: see
    `field_bounds`."""
    least, most = field_bounds(field, *scores, bounds=bounds)
    return most - least


def proportion(rows: Sequence[Episode], predicate: Callable[[Episode], bool]) -> Proportion:
    """Return the share of episodes for which a predicate holds, such as a violation.

    The interval is over seeds and at least as wide as Wilson's, since equal shares of three seeds are no evidence of
    certainty.
    """
    holds = np.array([predicate(row) for row in rows])
    seeds = np.array([row.seed for row in rows])
    per_seed = np.array([holds[seeds == seed].mean() for seed in np.unique(seeds)])
    return widen_to_wilson(t_interval(float(holds.mean()), per_seed), len(holds))
