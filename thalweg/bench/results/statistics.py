"""Summary statistics of episodes as in the paper: means, standard deviations, counts, and training curves.

Standard deviations are those of the sample itself (divided by n, as `numpy.std` does); the paper does not say which.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from thalweg.algos.interface import MEAN_EPISODES
from thalweg.bench.evaluate.episodes import ALL_REASONS, Episode


@dataclass(frozen=True)
class Summary:
    """Statistics of the episodes of one algorithm on one level."""

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
    """Number of episodes that ended for each of `ALL_REASONS`."""
    ahead_mean: float | None = None
    """Mean share flown of what lay ahead of the starts on an open course; None on a loop."""


def summarise(rows: Sequence[Episode]) -> Summary:
    """Return the summary of some episodes; raises `ValueError` for none."""
    if not rows:
        raise ValueError("no episodes to summarise")
    returns = np.array([row.return_ for row in rows])
    costs = np.array([row.cost for row in rows])
    counts = Counter(row.reason for row in rows)
    ahead = [row.ahead for row in rows if row.ahead is not None]
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
        reasons={reason: counts[reason] for reason in ALL_REASONS},
        ahead_mean=float(np.mean(ahead)) if len(ahead) == len(rows) else None,
    )


def summaries(rows: Sequence[Episode]) -> dict[tuple[str, str], Summary]:
    """Return a summary for each algorithm and level, in the order in which they first appear."""
    return {key: summarise(group) for key, group in group_episodes(rows).items()}


def group_episodes(rows: Sequence[Episode]) -> dict[tuple[str, str], list[Episode]]:
    """Group episodes by algorithm and level, in the order in which they first appear."""
    groups: dict[tuple[str, str], list[Episode]] = {}
    for row in rows:
        groups.setdefault((row.algorithm, row.level), []).append(row)
    return groups


def mean_and_std_text(mean: float, std: float) -> str:
    """Return `mean ± standard deviation` to two decimal places, as in the paper."""
    return f"{mean:.2f} ± {std:.2f}"


@dataclass(frozen=True)
class TrainingLog:
    """The finished episodes of one training run, in the order in which they ended. K episodes."""

    algorithm: str
    seed: int
    step: np.ndarray
    """[K] int64, steps of the whole run (all environments) when the episode ended."""
    return_: np.ndarray
    """[K] float64."""
    tight: np.ndarray
    """[K] float64, sum of the episode's tight costs."""
    loose: np.ndarray
    """[K] float64, sum of the episode's loose costs."""
    last_step: int
    """Total steps of the run; of a failed run, the steps until it failed."""
    total: np.ndarray | None = None
    """[K] float64, sum of the episode's costs of all kinds; None: tight and loose are all."""

    @property
    def cost(self) -> np.ndarray:
        """[K] float64, sum of the episode's costs."""
        return self.tight + self.loose if self.total is None else self.total


@dataclass(frozen=True)
class TrainingCurve:
    """A training run at G grid points of steps; NaN after its last step."""

    steps: np.ndarray
    """[G]."""
    return_: np.ndarray
    """[G] mean return of the last `MEAN_EPISODES` episodes; NaN before the first episode has ended."""
    total_rate: np.ndarray
    """[G] violations so far / steps so far, of both kinds."""
    tight_rate: np.ndarray
    loose_rate: np.ndarray


def training_curve(log: TrainingLog, grid: np.ndarray) -> TrainingCurve:
    """Return the paper's training curves at the grid's steps [G] (positive): running return and violation rates."""
    ended, reached = np.searchsorted(log.step, grid, side="right"), _reached(log, grid)

    def rate(violated: np.ndarray) -> np.ndarray:
        return np.where(reached, np.concatenate([[0], np.cumsum(violated)])[ended] / grid, np.nan)

    tight, loose = log.tight > 0, log.loose > 0
    mean = running_mean(log, log.return_, grid)
    return TrainingCurve(grid, mean, rate(tight | loose), rate(tight), rate(loose))


def running_mean(log: TrainingLog, values: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Return the mean [G] of the values [K] of the last `MEAN_EPISODES` episodes of a run at the grid's steps [G]; NaN
    before the first episode has ended, and after the run's last step."""
    ended = np.searchsorted(log.step, grid, side="right")
    sums = np.concatenate([[0.0], np.cumsum(values)])
    first = np.maximum(ended - MEAN_EPISODES, 0)
    with np.errstate(invalid="ignore"):
        return np.where(_reached(log, grid), (sums[ended] - sums[first]) / (ended - first), np.nan)


def _reached(log: TrainingLog, grid: np.ndarray) -> np.ndarray:
    """Return which of the grid's steps [G] a run has reached."""
    return grid <= log.last_step * (1 + 1e-9)  # rounding may put the grid's last point just past the last step


def mean_and_std(values: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and standard deviation over runs, each [G]; runs without a value at a point (NaN) are left out."""
    stack = np.stack(values)
    known = ~np.isnan(stack)
    count = known.sum(axis=0)
    with np.errstate(invalid="ignore"):
        mean = np.where(known, stack, 0.0).sum(axis=0) / count
        std = np.sqrt(np.where(known, (stack - mean) ** 2, 0.0).sum(axis=0) / count)
    return mean, std


def regret(log: TrainingLog, limit: float) -> float:
    """Return the cost of training above a limit, per episode.

    Costs are compared with the limit in blocks of `MEAN_EPISODES` episodes. A block below the limit does not make up
    for one above it: later care does not undo a collision ("strong" regret: Efroni, Mannor, Pirotta 2020). NaN without
    episodes.
    """
    costs = log.cost
    if not len(costs):
        return float("nan")
    blocks = np.split(costs, np.arange(MEAN_EPISODES, len(costs), MEAN_EPISODES))
    return float(sum(max(block.sum() - limit * len(block), 0.0) for block in blocks) / len(costs))
