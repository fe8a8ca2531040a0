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

from thalweg.bench.episodes import Episode
from thalweg.bench.inference import CONFIDENCE, LEAST_SEEDS, Estimate, clipped, no_surer, student, table_of
from thalweg.env.payment import WHOLE_COURSE

SHARES = np.linspace(0.0, WHOLE_COURSE, 101)
"""Returns at which profiles are drawn."""
SAME = 1e-9
"""Returns that differ by no more are the same: a return is a sum, and its last digits depend on the steps that paid."""


def improvement(ours: np.ndarray, theirs: np.ndarray) -> Estimate:
    """P(X > Y) + ½ P(X = Y): how often a flight of ours [L, M] returns more than theirs [L, K] from the same start."""
    pairs = _by_pair(ours, theirs, lambda x, y: (x - y > SAME) + 0.5 * (abs(x - y) <= SAME))
    found = _between_pairs(pairs)
    return found if np.isnan(found.low) else no_surer(found, len(ours) * min(pairs.shape))


def difference(ours: np.ndarray, theirs: np.ndarray, most: float = np.inf) -> Estimate:
    """Mean of ours [L, M] less theirs [L, K] from the same starts, which can't differ by more than `most`."""
    return clipped(_between_pairs(_by_pair(ours, theirs, np.subtract)), -most, most)


def change(after: np.ndarray, before: np.ndarray, most: float = np.inf) -> Estimate:
    """Mean of the same M policies' flights [L, M] under one condition less those under another: pairs of starts and of
    policies, whose means can't differ by more than `most`."""
    each = (after - before).mean(0)
    return clipped(student(float(each.mean()), each), -most, most)


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
    its interval, pointwise; NaN where there are too few seeds."""
    each = (table[:, :, None] >= thresholds - SAME).mean(0)
    found = [student(float(share.mean()), share) for share in each.T]
    low, high = (np.clip([getattr(one, end) for one in found], 0.0, 1.0) for end in ("low", "high"))
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
