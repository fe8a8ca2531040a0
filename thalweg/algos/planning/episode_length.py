"""Mean episode length, measured from rollouts, over which planners spread the cost limit of an episode."""

from collections import deque
from typing import Any

import numpy as np

from thalweg.algos.common.state import array_of
from thalweg.algos.interface import Rollout

RECENT_EPISODES = 100
"""Number of finished episodes in the mean."""


class EpisodeLength:
    """Mean length of the most recent episodes of N environments."""

    def __init__(self, num_envs: int, fixed: int = 0) -> None:
        """`fixed` replaces the measurement unless it is 0."""
        self.fixed = fixed
        self._running = np.zeros(num_envs, dtype=np.int64)
        self._finished: deque[int] = deque(maxlen=RECENT_EPISODES)
        self._longest = 1

    @property
    def mean(self) -> float:
        """L, mean steps of the finished episodes; before the first one ends, the steps of the longest so far."""
        if self.fixed:
            return float(self.fixed)
        return float(np.mean(self._finished)) if self._finished else float(self._longest)

    def update(self, rollout: Rollout) -> None:
        """Count the steps of a rollout; an episode that a reset cut off between two rollouts is not counted."""
        fresh, valid = array_of(rollout.fresh[:-1]), array_of(rollout.valid)
        over = array_of(rollout.terminated | rollout.truncated)
        for step in range(len(valid)):
            self._running = np.where(fresh[step], 0, self._running) + valid[step]
            self._longest = max(self._longest, int(self._running.max()))
            self._finished.extend(int(length) for length in self._running[over[step]])
            self._running[over[step]] = 0

    def state(self) -> dict[str, Any]:
        """Return the counters and recent lengths, as arrays and plain data."""
        return {"running": self._running.copy(), "finished": list(self._finished), "longest": self._longest}

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        self._running, self._longest = np.array(state["running"]), int(state["longest"])
        self._finished.clear()
        self._finished.extend(int(length) for length in state["finished"])
