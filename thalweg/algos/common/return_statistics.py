"""Running statistics of discounted returns: their deviations and extremes, from all finished episodes of a run.

The return of a step is what the episode pays from that step on, G_t = x_t + γ G_{t+1}, for the reward and for each
cost. It is known once the episode has ended. An episode that was cut off counts as if it had gone on for ever with its
mean reward and cost, since critics estimate what would have come. Letters: T steps, N environments, S signals (the
reward, then the costs), L steps of an episode.
"""

import math
from collections.abc import Sequence
from itertools import accumulate
from typing import Any

import numpy as np

LONGEST = 2000
"""Steps after which an episode that still runs counts as cut off, so that the memory is bounded."""


def returns_to_go(signals: np.ndarray, discounts: Sequence[float], *, cut: bool) -> np.ndarray:
    """Return G_t = x_t + γ G_{t+1} float64 [L, S] for the signals x [L, S] of one episode and the discounts γ [S].

    If the episode was cut off, its last G is x + γ m / (1 - γ) with the mean m of x; without discount x alone.
    """
    columns: list[list[float]] = []
    for column, discount in zip(signals[::-1].astype(np.float64).T.tolist(), discounts, strict=True):
        if cut and discount < 1.0:
            column[0] += discount * math.fsum(column) / len(column) / (1.0 - discount)
        columns.append(list(accumulate(column, lambda after, x, discount=discount: x + discount * after)))
    return np.array(columns).T[::-1]


class ReturnStatistics:
    """Mean, variance and extremes of the discounted returns of all steps of finished episodes, by signal."""

    def __init__(self, num_envs: int, discounts: Sequence[float]) -> None:
        self.discounts = tuple(discounts)
        size = len(self.discounts)
        self.count = 0
        """Steps of finished episodes."""
        self.mean, self._square = np.zeros(size), np.zeros(size)
        """Mean return [S], and the sum of squared differences from it [S]."""
        self.low, self.high = np.zeros(size), np.zeros(size)
        """[S] smallest and largest return, or single reward or cost, so far; at most and at least 0."""
        self.largest_step = np.zeros(size)
        """[S] largest absolute reward or cost of a single step so far."""
        self._recent = np.zeros((0, num_envs, size), np.float32)
        """[rows, N, S] signals since the first step of the oldest running episode."""
        self._begin = np.zeros(num_envs, np.int64)
        """[N] row in which the running episode of each environment begins."""

    @property
    def deviation(self) -> np.ndarray:
        """Standard deviation of the returns [S]; 0 before any episode has finished."""
        return np.sqrt(self._square / max(self.count, 1))

    def bounds(self, margin: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the extremes [S], each widened by `margin` of the distance between them.

        They are infinite before any episode has finished.
        """
        if not self.count:
            return np.full_like(self.low, -np.inf), np.full_like(self.high, np.inf)
        widening = margin * (self.high - self.low)
        return self.low - widening, self.high + widening

    def update(
        self,
        signals: np.ndarray,
        fresh: np.ndarray,
        terminated: np.ndarray,
        truncated: np.ndarray,
        valid: np.ndarray,
    ) -> None:
        """Add T steps of N environments.

        Args:
            signals: x [T, N, S], reward and costs.
            fresh: [T, N] bool, whether an episode begins with this step. An episode before it that never ended, as when
                a run resumes with new ones, is forgotten.
            terminated: [T, N] bool, whether an episode ended by itself in this step.
            truncated: [T, N] bool, whether it was cut off after this step.
            valid: [T, N] bool; false for a step that only reset an environment.
        """
        before = len(self._recent)
        recent = np.concatenate([self._recent, signals.astype(np.float32)])
        for step, env in np.argwhere(fresh | terminated | truncated | ~valid).tolist():
            row = before + step
            if fresh[step, env]:
                self._begin[env] = row
            if terminated[step, env] or truncated[step, env] or not valid[step, env]:
                if valid[step, env]:
                    self._add(recent[self._begin[env] : row + 1, env], cut=not terminated[step, env])
                self._begin[env] = row + 1
        for env in np.flatnonzero(len(recent) - self._begin >= LONGEST).tolist():
            self._add(recent[self._begin[env] :, env], cut=True)
            self._begin[env] = len(recent)
        oldest = int(self._begin.min())
        self._recent = recent[oldest:].copy()
        self._begin -= oldest
        steps = signals[valid].reshape(-1, len(self.low)).astype(np.float64)
        self._widen(steps)
        self.largest_step = np.maximum(self.largest_step, np.abs(steps).max(0, initial=0.0))

    def _add(self, signals: np.ndarray, *, cut: bool) -> None:
        """Add the returns of one episode's signals [L, S] (Chan, Golub, LeVeque 1983: two sets combined)."""
        returns = returns_to_go(signals, self.discounts, cut=cut)
        mean, count = returns.mean(0), len(returns)
        total, apart = self.count + count, mean - self.mean
        self._square = self._square + ((returns - mean) ** 2).sum(0) + apart**2 * self.count * count / total
        self.mean = self.mean + apart * count / total
        self.count = total
        self._widen(returns)

    def _widen(self, values: np.ndarray) -> None:
        """Extend the extremes to values [L, S]."""
        if len(values):
            self.low, self.high = np.minimum(self.low, values.min(0)), np.maximum(self.high, values.max(0))

    def state(self) -> dict[str, Any]:
        """Return the state as arrays and plain data."""
        return {
            "count": self.count,
            "mean": self.mean.copy(),
            "square": self._square.copy(),
            "low": self.low.copy(),
            "high": self.high.copy(),
            "largest_step": self.largest_step.copy(),
            "recent": self._recent.copy(),
            "begin": self._begin.copy(),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        self.count = int(state["count"])
        self.mean, self._square = np.array(state["mean"]), np.array(state["square"])
        self.low, self.high = np.array(state["low"]), np.array(state["high"])
        self.largest_step = np.array(state["largest_step"])
        self._recent, self._begin = np.array(state["recent"]), np.array(state["begin"])
