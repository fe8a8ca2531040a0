"""How sure may one be? Intervals, comparisons and profiles of evaluated episodes, by SciPy's bootstrap and exact tests.

Every algorithm flies the same starts, once with each training seed. So the bootstrap is stratified: it draws among the
seeds of each start, start by start (Agarwal et al. 2021, "Deep Reinforcement Learning at the Edge of the Statistical
Precipice", whose tasks are our starts); and two algorithms are compared start by start. With fewer than `LEAST_SEEDS`
there is nothing to draw among: no interval is given then.

Letters: L starts, M seeds, G points of a profile.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from thalweg.bench.episodes import Episode

LEAST_SEEDS = 3
CONFIDENCE = 0.95
RESAMPLES = 2000
SEED = 0
"""Of the bootstrap: the same episodes give the same intervals."""
Statistic = Callable[..., np.ndarray]


@dataclass(frozen=True)
class Estimate:
    """A figure and its interval of `CONFIDENCE`; NaN at both ends where none can be given."""

    value: float
    low: float = float("nan")
    high: float = float("nan")

    def __str__(self) -> str:
        return f"{self.value:.2f}" if np.isnan(self.low) else f"{self.value:.2f} [{self.low:.2f}, {self.high:.2f}]"

    def as_percent(self) -> str:
        """Of a share: the same in whole percent."""
        return f"{self.value:.0%}" if np.isnan(self.low) else f"{self.value:.0%} [{self.low:.0%}, {self.high:.0%}]"


def table_of(rows: Sequence[Episode], field: str = "return_") -> np.ndarray:
    """[L, M] a field of episodes by start and seed.

    Raises `ValueError` unless every seed flew every start of every level once.
    """
    seeds = sorted({row.seed for row in rows})
    starts = sorted({(row.level, row.world_seed, row.episode) for row in rows})
    found = {(row.level, row.world_seed, row.episode, row.seed): float(getattr(row, field)) for row in rows}
    if len(found) != len(rows) or len(found) != len(starts) * len(seeds):
        raise ValueError(f"{len(rows)} episodes are not those of {len(seeds)} seeds from {len(starts)} starts each")
    return np.array([[found[(*start, seed)] for seed in seeds] for start in starts])


def iqm(values: np.ndarray, axis: int = -1) -> np.ndarray:
    """The interquartile mean: of the middle half of the numbers."""
    return stats.trim_mean(values, 0.25, axis=axis)


def stratified(table: np.ndarray, statistic: Statistic = iqm) -> Estimate:
    """A statistic of all episodes [L, M], such as `iqm` or `numpy.mean`, and its stratified bootstrap interval."""
    value = float(statistic(table.ravel()))
    if table.shape[1] < LEAST_SEEDS:
        return Estimate(value)

    def of_all(*strata: np.ndarray, axis: int) -> np.ndarray:
        return statistic(np.concatenate(strata, axis=axis), axis=axis)

    return _bootstrapped(value, tuple(table), of_all)


def middle_return(rows: Sequence[Episode]) -> Estimate:
    """The interquartile mean of some episodes' returns; without an interval where a seed did not fly every start."""
    try:
        table = table_of(rows)
    except ValueError:
        table = np.array([[row.return_] for row in rows])
    return stratified(table)


def improvement(better: np.ndarray, worse: np.ndarray) -> Estimate:
    """P(X > Y) + ½ P(X = Y) for one algorithm's episodes X [L, M] and another's Y [L, M'] from the same starts.

    At each start every seed of one is held against every seed of the other; the mean is over starts.
    """
    _require_pairs(better, worse)

    def share(*strata: np.ndarray, axis: int) -> np.ndarray:
        firsts, seconds = strata[: len(better)], strata[len(better) :]
        return np.mean([_wins(x, y) for x, y in zip(firsts, seconds, strict=True)], axis=0)

    value = float(share(*better, *worse, axis=-1))
    if min(better.shape[1], worse.shape[1]) < LEAST_SEEDS:
        return Estimate(value)
    return _bootstrapped(value, (*better, *worse), share)


def difference(first: np.ndarray, second: np.ndarray) -> Estimate:
    """Mean difference X - Y of episodes [L, M] and [L, M'] from the same starts, which are used as pairs: the interval
    is drawn among starts, of each the difference of the means over seeds."""
    _require_pairs(first, second)
    apart = first.mean(1) - second.mean(1)
    if len(apart) < 2 or np.ptp(apart) == 0:
        return Estimate(float(apart.mean()))
    return _bootstrapped(float(apart.mean()), (apart,), np.mean)


def proportion(count: int, among: int) -> Estimate:
    """A share, with Wilson's interval: of episodes with a violation, or successful ones."""
    interval = stats.binomtest(count, among).proportion_ci(CONFIDENCE, method="wilson")
    return Estimate(count / among, float(interval.low), float(interval.high))


def profile(values: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Shares [G] of the episodes that reach each point [G]: a performance profile."""
    ordered = np.sort(np.ravel(values))
    return 1.0 - np.searchsorted(ordered, points, side="left") / len(ordered)


def regret(costs: np.ndarray, limit: float) -> float:
    """Cost of training episodes above the limit, added up: Σ max(0, C - d); what learning cost in safety."""
    return float(np.maximum(costs - limit, 0.0).sum())


def limit_met(costs: np.ndarray, limit: float) -> str:
    """Whether the mean cost of episodes [L, M] keeps a limit: "yes" or "no" where its interval lies on one side, else
    "unclear"; without an interval as the mean says, with a question mark."""
    mean = stratified(costs, np.mean)
    if np.isnan(mean.low):
        return "yes?" if mean.value <= limit else "no?"
    return "yes" if mean.high <= limit else "no" if mean.low > limit else "unclear"


def _wins(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """[...] how often the numbers x [..., M] are above the numbers y [..., M'], ties half."""
    apart = x[..., :, None] - y[..., None, :]
    return ((apart > 0) + 0.5 * (apart == 0)).mean((-2, -1))


def _require_pairs(first: np.ndarray, second: np.ndarray) -> None:
    if len(first) != len(second):
        raise ValueError(f"episodes from {len(first)} and {len(second)} starts are no pairs")


def _bootstrapped(value: float, samples: tuple[np.ndarray, ...], statistic: Statistic) -> Estimate:
    """The percentile interval of a statistic of samples that are drawn from independently."""
    interval = stats.bootstrap(
        samples,
        statistic,
        n_resamples=RESAMPLES,
        vectorized=True,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng(SEED),
    ).confidence_interval
    return Estimate(value, float(interval.low), float(interval.high))
