"""Which of two algorithms is better, and how sure may one be? Flights are compared from the same starts only.

Every algorithm flies the same list of starts, so that what a start is worth cancels out: the probability of
improvement (Agarwal et al. 2021) is taken start by start, and differences are those of the same starts. As in
`inference` it is seeds that count: an algorithm has M of them, and of every pair of a seed of the one and a seed of the
other one number is made; how these vary with either gives the interval.

Letters: L starts, M and K seeds.
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy import stats

from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.results.inference import (
    CONFIDENCE,
    LEAST_SEEDS,
    SAME,
    Estimate,
    clipped,
    no_narrower,
    no_surer,
    of_flights,
    span,
    student,
    table_of,
)
from thalweg.env.task.reward_cost import WHOLE_COURSE

SHARES = np.linspace(0.0, WHOLE_COURSE, 101)
"""Returns at which profiles are drawn."""


def improvement(ours: np.ndarray, theirs: np.ndarray) -> Estimate:
    """P(X > Y) + ½ P(X = Y): how often a flight of ours [L, M] returns more than theirs [L, K] from the same start."""
    pairs = _by_pair(ours, theirs, lambda x, y: (x - y > SAME) + 0.5 * (abs(x - y) <= SAME))
    return no_surer(_between_pairs(pairs), len(ours) * min(pairs.shape))


def difference(ours: np.ndarray, theirs: np.ndarray, field: str) -> Estimate:
    """Mean of a field of ours [L, M] less theirs [L, K] from the same starts."""
    found = _between_pairs(_by_pair(ours, theirs, np.subtract))
    return _no_surer_than_starts(found, ours, theirs, field)


def change(after: np.ndarray, before: np.ndarray, field: str) -> Estimate:
    """Mean of a field of the same M policies' flights [L, M] under one condition less those under another: pairs of
    starts and of policies.

    Raises `ValueError` for tables of different shapes.
    """
    if after.shape != before.shape:
        raise ValueError(f"flights {after.shape} and {before.shape} are not those of the same starts and policies")
    each = (after - before).mean(0)
    return _no_surer_than_starts(student(float(each.mean()), each), after, before, field)


def _no_surer_than_starts(found: Estimate, ours: np.ndarray, theirs: np.ndarray, field: str) -> Estimate:
    """The estimate of a difference with an interval no narrower than that over the starts, since seeds that agree are
    no certainty; where starts agree too, or are too few, no narrower than what the flights of both by themselves tell
    (MOVER: Zou and Donner 2008, "Construction of confidence limits about effect measures")."""
    starts = ours.mean(1) - theirs.mean(1)
    least = student(found.value, starts)
    if np.isnan(least.low) or np.ptp(starts) <= SAME:
        one, other = of_flights(ours, field), of_flights(theirs, field)
        below = np.hypot(one.value - one.low, other.high - other.value)
        above = np.hypot(one.high - one.value, other.value - other.low)
        least = Estimate(found.value, found.value - float(below), found.value + float(above))
    return clipped(no_narrower(found, least), -span(field), span(field))


def shared_tables(ours: Sequence[Episode], theirs: Sequence[Episode], field: str) -> tuple[np.ndarray, np.ndarray]:
    """[L, M] and [L, K] a field of both by start and seed.

    Raises `ValueError` unless every seed of either flew the same starts, each once.
    """
    starts = [
        {(row.level, row.world_seed, row.episode, row.x, row.y, row.z) for row in rows} for rows in (ours, theirs)
    ]
    if starts[0] != starts[1]:
        raise ValueError(f"{len(starts[0] ^ starts[1])} starts were flown by one of them only")
    return table_of(ours, field), table_of(theirs, field)


def profile(table: np.ndarray, thresholds: np.ndarray = SHARES) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The performance profile of flights [L, M]: the share whose return is at least each threshold [G], and the ends of
    its interval, pointwise and no narrower than Wilson's; NaN where there are too few seeds."""
    each = (table[:, :, None] >= thresholds - SAME).mean(0)
    found = [no_surer(student(float(share.mean()), share), table.size) for share in each.T]
    low, high = (np.array([getattr(one, end) for one in found]) for end in ("low", "high"))
    return np.array([one.value for one in found]), low, high


def _by_pair(
    ours: np.ndarray, theirs: np.ndarray, compared: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> np.ndarray:
    """[M, K] the mean over starts for each pair of seeds."""
    return compared(ours[:, :, None], theirs[:, None, :]).mean(0)


def _between_pairs(pairs: np.ndarray) -> Estimate:
    """The mean over pairs of seeds [M, K] with Welch's interval: of two samples of seeds, what each seed contributes is
    its mean over those of the other (for a difference of means this is Welch's test itself)."""
    value, sizes = float(pairs.mean()), np.array(pairs.shape)
    if sizes.min() < LEAST_SEEDS:
        return Estimate(value)
    errors = np.array([pairs.mean(1).var(ddof=1), pairs.mean(0).var(ddof=1)]) / sizes
    if errors.sum() == 0.0:
        return Estimate(value, value, value)
    freedom = errors.sum() ** 2 / (errors**2 / (sizes - 1)).sum()
    half = float(stats.t.ppf(0.5 + CONFIDENCE / 2, freedom) * np.sqrt(errors.sum()))
    return Estimate(value, value - half, value + half)
