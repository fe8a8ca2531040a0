"""Which figures sum up episodes? Those of the paper: means, standard deviations, counts, and curves of training.

Standard deviations are those of the sample itself (divided by n, as `numpy.std` does); the paper does not say which.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from thalweg.algos.interface import MEAN_EPISODES
from thalweg.bench.evaluate.episodes import REASONS, Episode


@dataclass(frozen=True)
class Summary:
    """One cell of a table: the episodes of one algorithm on one level."""

    episodes: int
    seeds: int
    return_mean: float
    return_std: float
    cost_mean: float
    cost_std: float
    success: float
    """Share of episodes, as the next two."""
    tight: float
    loose: float
    length_mean: float
    progress_mean: float
    reasons: dict[str, int]
    """How many episodes ended for each of `REASONS`."""


def summarise(rows: Sequence[Episode]) -> Summary:
    """The summary of some episodes, of which there must be at least one."""
    if not rows:
        raise ValueError("no episodes to sum up")
    returns = np.array([row.return_ for row in rows])
    costs = np.array([row.cost for row in rows])
    counts = Counter(row.reason for row in rows)
    return Summary(
        episodes=len(rows),
        seeds=len({row.seed for row in rows}),
        return_mean=float(returns.mean()),
        return_std=float(returns.std()),
        cost_mean=float(costs.mean()),
        cost_std=float(costs.std()),
        success=float(np.mean([row.success for row in rows])),
        tight=float(np.mean([row.tight > 0 for row in rows])),
        loose=float(np.mean([row.loose > 0 for row in rows])),
        length_mean=float(np.mean([row.length for row in rows])),
        progress_mean=float(np.mean([row.progress for row in rows])),
        reasons={reason: counts[reason] for reason in REASONS},
    )


def summaries(rows: Sequence[Episode]) -> dict[tuple[str, str], Summary]:
    """A summary for each algorithm and level, in the order in which they first appear."""
    return {key: summarise(group) for key, group in grouped(rows).items()}


def grouped(rows: Sequence[Episode]) -> dict[tuple[str, str], list[Episode]]:
    """The episodes of each algorithm and level, in the order in which they first appear."""
    groups: dict[tuple[str, str], list[Episode]] = {}
    for row in rows:
        groups.setdefault((row.algorithm, row.level), []).append(row)
    return groups


@dataclass(frozen=True)
class TrainingLog:
    """The finished episodes of one training run, in the order of their ends. K episodes."""

    algorithm: str
    seed: int
    step: np.ndarray
    """[K] int64, steps of the whole run (all environments) when the episode ended."""
    return_: np.ndarray
    """[K] float64."""
    tight: np.ndarray
    """[K] float64, as `loose` the sum of costs of that kind."""
    loose: np.ndarray
    last_step: int
    """Steps that the run took in all: of a failed run, those until it failed."""


@dataclass(frozen=True)
class Curve:
    """A training run at G grid points of steps; NaN beyond its last step."""

    steps: np.ndarray
    """[G]."""
    return_: np.ndarray
    """[G] mean return of the last `MEAN_EPISODES` episodes; NaN before the first episode has ended."""
    total_rate: np.ndarray
    """[G] violations so far / steps so far, as the two kinds below."""
    tight_rate: np.ndarray
    loose_rate: np.ndarray


def curve(log: TrainingLog, grid: np.ndarray) -> Curve:
    """The paper's training curves at the grid's steps [G] (positive): running return, and the rate of violations."""
    ended = np.searchsorted(log.step, grid, side="right")
    sums = np.concatenate([[0.0], np.cumsum(log.return_)])
    first = np.maximum(ended - MEAN_EPISODES, 0)
    flown = grid <= log.last_step * (1 + 1e-9)  # the grid's last point may lie a rounding error beyond
    with np.errstate(invalid="ignore"):
        mean = np.where(flown, (sums[ended] - sums[first]) / (ended - first), np.nan)

    def rate(violated: np.ndarray) -> np.ndarray:
        return np.where(flown, np.concatenate([[0], np.cumsum(violated)])[ended] / grid, np.nan)

    tight, loose = log.tight > 0, log.loose > 0
    return Curve(grid, mean, rate(tight | loose), rate(tight), rate(loose))


def band(values: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation over runs, each [G]; where a run has no value (NaN) it is left out."""
    stack = np.stack(values)
    known = ~np.isnan(stack)
    count = known.sum(axis=0)
    with np.errstate(invalid="ignore"):
        mean = np.where(known, stack, 0.0).sum(axis=0) / count
        std = np.sqrt(np.where(known, (stack - mean) ** 2, 0.0).sum(axis=0) / count)
    return mean, std


def regret(log: TrainingLog, limit: float) -> float:
    """The cost of training beyond a limit for each episode: what blocks of `MEAN_EPISODES` episodes cost more than the
    limit allows, over all episodes. A block that stays within it does not make up for another: whoever was hit is not
    helped by later care (Efroni, Mannor, Pirotta 2020, "strong" regret)."""
    costs = log.tight + log.loose
    if not len(costs):
        return float("nan")
    blocks = np.split(costs, np.arange(MEAN_EPISODES, len(costs), MEAN_EPISODES))
    return float(sum(max(block.sum() - limit * len(block), 0.0) for block in blocks) / len(costs))
