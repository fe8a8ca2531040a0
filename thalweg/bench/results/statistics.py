"""Summary statistics of episodes as in the paper: means, standard deviations, counts, and training curves.

Standard deviations are those of the sample itself (divided by n, as `numpy.std` does); the paper does not say which.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

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


VIOLATIONS = ("violations", "tight_violations", "loose_violations")
"""Episodes with a cost of either kind, with a tight one, and with a loose one."""


@dataclass(frozen=True)
class TrainingLog:
    """The finished episodes of one training run, in the order in which they ended, one by one or in blocks. K rows."""

    algorithm: str
    seed: int
    step: np.ndarray
    """[K] int64, steps of the whole run (all environments) when the episode ended, or the last one of the block."""
    return_: np.ndarray
    """[K] float64, mean over the row's episodes, as the costs."""
    tight: np.ndarray
    """[K] float64, sum of an episode's tight costs."""
    loose: np.ndarray
    """[K] float64, sum of an episode's loose costs."""
    last_step: int
    """Total steps of the run; of a failed run, the steps until it failed."""
    total: np.ndarray | None = None
    """[K] float64, sum of an episode's costs of all kinds; None: tight and loose are all."""
    episodes: np.ndarray | None = None
    """[K] int64, number of episodes of each row; None: one each."""
    violations: np.ndarray | None = None
    """[K, 3] int64, numbers of episodes with `VIOLATIONS`; None where rows are episodes, whose costs tell."""

    @property
    def cost(self) -> np.ndarray:
        """[K] float64, sum of an episode's costs, mean over the row's episodes."""
        return self.tight + self.loose if self.total is None else self.total

    @property
    def episodes_of_rows(self) -> np.ndarray:
        """[K] int64, number of episodes of each row."""
        return np.ones(len(self.step), np.int64) if self.episodes is None else self.episodes

    @property
    def violations_of_rows(self) -> np.ndarray:
        """[K, 3] int64, numbers of episodes with `VIOLATIONS`."""
        if self.violations is not None:
            return self.violations
        tight, loose = self.tight > 0, self.loose > 0
        return np.stack([tight | loose, tight, loose], axis=1).astype(np.int64)


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


def in_blocks(log: TrainingLog) -> TrainingLog:
    """Return a log of single episodes in blocks of `MEAN_EPISODES`; the last block has as many as are left."""
    first = np.arange(0, len(log.step), MEAN_EPISODES)
    if not len(first):
        return replace(log, episodes=log.episodes_of_rows, violations=log.violations_of_rows)
    episodes = np.diff(np.append(first, len(log.step)))

    def mean(values: np.ndarray) -> np.ndarray:
        return np.add.reduceat(values, first) / episodes

    return TrainingLog(
        log.algorithm,
        log.seed,
        log.step[first + episodes - 1],
        mean(log.return_),
        mean(log.tight),
        mean(log.loose),
        log.last_step,
        mean(log.cost),
        episodes,
        np.add.reduceat(log.violations_of_rows, first),
    )


def training_curve(log: TrainingLog, grid: np.ndarray) -> TrainingCurve:
    """Return the paper's training curves at the grid's steps [G] (positive): running return and violation rates."""
    ended, reached = np.searchsorted(log.step, grid, side="right"), _reached(log, grid)
    so_far = np.concatenate([np.zeros((1, len(VIOLATIONS))), np.cumsum(log.violations_of_rows, axis=0)])
    total, tight, loose = np.where(reached, so_far[ended].T / grid, np.nan)
    return TrainingCurve(grid, running_mean(log, log.return_, grid), total, tight, loose)


def running_mean(log: TrainingLog, values: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Return the mean [G] of the values [K] of the last `MEAN_EPISODES` episodes of a run at the grid's steps [G]; NaN
    before the first episode has ended, and after the run's last step. Of blocks, it is that of the fewest last ones
    that have as many episodes."""
    ended = np.searchsorted(log.step, grid, side="right")
    counts = np.concatenate([[0], np.cumsum(log.episodes_of_rows)])
    sums = np.concatenate([[0.0], np.cumsum(values * log.episodes_of_rows)])
    first = np.maximum(np.searchsorted(counts, counts[ended] - MEAN_EPISODES, side="right") - 1, 0)
    with np.errstate(invalid="ignore"):
        mean = (sums[ended] - sums[first]) / (counts[ended] - counts[first])
    return np.where(_reached(log, grid), mean, np.nan)


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
    blocks = in_blocks(log) if log.episodes is None else log
    if not len(blocks.step):
        return float("nan")
    episodes = blocks.episodes_of_rows
    return float((np.maximum(blocks.cost - limit, 0.0) * episodes).sum() / episodes.sum())
