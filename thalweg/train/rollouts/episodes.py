"""Episode statistics: sums of running episodes, a record of each finished one, and the rates that the paper plots."""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from thalweg.algos.interface import MEAN_EPISODES, judged_episodes, recent_episodes

RETURN_MEAN, COST_MEAN, LENGTH_MEAN = (f"{name}_mean_{MEAN_EPISODES}" for name in ("return", "cost", "length"))
"""Names of the means of the last episodes in metrics."""


@dataclass(frozen=True)
class StepRecord:
    """Result of a step of N environments, as far as statistics of episodes need it."""

    reward: np.ndarray
    """[N] float64; 0 where not valid."""
    cost: np.ndarray
    """[N] float64; 0 where not valid."""
    costs: np.ndarray | None
    """[N, K] float64, tight and loose and then the other kinds, if the environment reports them; 0 where not valid."""
    terminated: np.ndarray
    """[N] bool."""
    truncated: np.ndarray
    """[N] bool, and not terminated."""
    valid: np.ndarray
    """[N] bool; false where the environment only reset itself."""
    finished: np.ndarray
    """[F] int64, environments whose episode ended in this step, either way."""
    reasons: Any
    """[N] the environment's codes for the reason why an episode ended, if it reports any."""
    rivers: Any = field(default=None, kw_only=True)
    """[N] index of the river in which each environment took this step, if the environments change river."""


@dataclass(frozen=True)
class Episode:
    """A finished episode: a row of `episodes.csv`."""

    step: int
    """Steps of the run, all environments together, when it ended."""
    env: int
    return_: float
    """Undiscounted sum of rewards."""
    cost: float
    """Undiscounted sum of costs."""
    tight: float
    """Tight share of the cost; NaN if the environment does not report it."""
    loose: float
    """Loose share of the cost, likewise."""
    length: int
    """Steps."""
    reason: str
    """Why it ended: the environment's name for the reason, or terminated or truncated."""
    world: str
    """Name of its world; empty if the environment has none."""


COLUMNS = tuple(name.rstrip("_") for name in Episode.__dataclass_fields__)
"""Columns of `episodes.csv`."""


class EpisodeStatistics:
    """Statistics of the episodes of N environments."""

    def __init__(self, num_envs: int, worlds: list[str], reasons: Mapping[int, str] | None = None) -> None:
        """`reasons`: the environment's names for the codes of `info["done_reason"]`."""
        self._reasons = reasons or {}
        self.worlds = worlds
        """[N] name of each environment's world, or empty strings; of all rivers if the environments change river."""
        self._sums = np.zeros((num_envs, 4))
        """[N, 4] reward, cost, tight, loose of the running episodes."""
        self._lengths = np.zeros(num_envs, dtype=np.int64)
        self.judged = judged_episodes(num_envs)
        """W, the number of episodes in a row in `lowest`."""
        self.recent: deque[Episode] = deque(maxlen=recent_episodes(num_envs))
        self._last_costs = {name: deque[float](maxlen=self.judged) for name in ("cost", "tight", "loose")}
        """Costs of the last W episodes, by kind."""
        self.since_update: list[Episode] = []
        """Episodes finished since the last update."""
        self.steps = 0
        """Valid steps, all environments together."""
        self.count = 0
        """Finished episodes."""
        self.largest = {"cost": 0.0, "tight": 0.0, "loose": 0.0}
        """Largest cost of any episode, by kind."""
        self.lowest: dict[str, float] = {}
        """Lowest mean cost of W episodes in a row, by kind; empty before so many have finished. With several episodes
        that end in one step, only the mean after all of them counts."""
        self.violations = {"cost": 0, "tight": 0, "loose": 0}
        """Number of episodes with a cost, by kind."""
        self.split = False
        """Whether the environment reports tight and loose costs."""

    def add(self, step: StepRecord) -> list[Episode]:
        """Add a step; returns the episodes that it ended."""
        self.steps += int(step.valid.sum())
        self._sums[:, 0] += step.reward
        self._sums[:, 1] += step.cost
        if step.costs is not None:
            self.split = True
            self._sums[:, 2:] += step.costs[:, :2]  # a task's own kind is the rest of the cost
        self._lengths += step.valid
        ended = [self._finish(int(env), step) for env in step.finished]
        for episode in ended:
            self.count += 1
            for name in self.violations:
                cost = getattr(episode, name)
                self.violations[name] += cost > 0
                self.largest[name] = max(self.largest[name], cost)
        self._remember(ended)
        self.since_update.extend(ended)
        if ended and len(self.recent) >= self.judged:
            self._lower()
        return ended

    def costs(self, separate: bool) -> tuple[np.ndarray, np.ndarray, tuple[float, ...]]:
        """Return the costs [E, M] of the episodes since the last update and of the recent ones, and the largest [M].

        They are tight and loose costs if `separate`, else their sum.
        """
        names = ("tight", "loose") if separate else ("cost",)
        new, recent = (
            np.array([[getattr(episode, name) for name in names] for episode in episodes]).reshape(-1, len(names))
            for episodes in (self.since_update, self.recent)
        )
        return new, recent, tuple(self.largest[name] for name in names)

    def lowest_costs(self, separate: bool) -> tuple[float, ...]:
        """Return the lowest mean cost [M] of W episodes in a row; NaN before so many have finished."""
        names = ("tight", "loose") if separate else ("cost",)
        return tuple(self.lowest.get(name, math.nan) for name in names)

    @property
    def mean_length(self) -> float:
        """Mean length of the recent episodes in steps; NaN without episodes."""
        return float(np.mean([episode.length for episode in self.recent])) if self.recent else math.nan

    def metrics(self) -> dict[str, float]:
        """Return means of the last episodes, and the number of episodes with a cost per step so far."""
        recent = list(self.recent)[-MEAN_EPISODES:]
        rates = {name: number / max(self.steps, 1) for name, number in self.violations.items()}
        nan = math.nan
        return {
            "episodes": self.count,
            RETURN_MEAN: float(np.mean([e.return_ for e in recent])) if recent else nan,
            COST_MEAN: float(np.mean([e.cost for e in recent])) if recent else nan,
            LENGTH_MEAN: float(np.mean([e.length for e in recent])) if recent else nan,
            "cost_rate": rates["cost"],
            "cost_rate_tight": rates["tight"] if self.split else nan,
            "cost_rate_loose": rates["loose"] if self.split else nan,
        }

    def state(self) -> dict[str, Any]:
        """Return everything as arrays and plain data."""
        return {
            "sums": self._sums.copy(),
            "lengths": self._lengths.copy(),
            "steps": self.steps,
            "count": self.count,
            "largest": dict(self.largest),
            "lowest": dict(self.lowest),
            **({"judged": self.judged} if self.judged != MEAN_EPISODES else {}),
            "violations": dict(self.violations),
            "split": self.split,
            "recent": [asdict(episode) for episode in self.recent],
            "since_update": [asdict(episode) for episode in self.since_update],
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore a state of `state`."""
        self._sums, self._lengths = np.array(state["sums"]), np.array(state["lengths"])
        self.steps, self.count = int(state["steps"]), int(state["count"])
        self.split = bool(state["split"])
        self.largest = {name: float(cost) for name, cost in state["largest"].items()}
        # Earlier versions wrote none, or that of fewer episodes; then the lowest since the run was resumed counts.
        lowest = state.get("lowest", {}) if state.get("judged", MEAN_EPISODES) == self.judged else {}
        self.lowest = {name: float(cost) for name, cost in lowest.items()}
        self.violations = {name: int(number) for name, number in state["violations"].items()}
        for kept in (self.recent, *self._last_costs.values()):
            kept.clear()
        self._remember([Episode(**row) for row in state["recent"]])
        # Version 0.1.0 called them fresh at first.
        self.since_update = [Episode(**row) for row in state["since_update" if "since_update" in state else "fresh"]]

    def discard_running(self) -> None:
        """Discard the running episodes of all environments, which are reset."""
        self._sums[:], self._lengths[:] = 0.0, 0

    def _finish(self, env: int, step: StepRecord) -> Episode:
        """Return the record of an episode that ended in a step, and clear its sums."""
        total, cost, tight, loose = (float(x) for x in self._sums[env])
        episode = Episode(
            step=self.steps,
            env=env,
            return_=total,
            cost=cost,
            tight=tight if self.split else math.nan,
            loose=loose if self.split else math.nan,
            length=int(self._lengths[env]),
            reason=self._reason(step, env),
            world=self.worlds[env if step.rivers is None else step.rivers[env]],
        )
        self._sums[env], self._lengths[env] = 0.0, 0
        return episode

    def _remember(self, ended: list[Episode]) -> None:
        """Add episodes that ended to the recent ones."""
        self.recent.extend(ended)
        for name, costs in self._last_costs.items():
            costs.extend(getattr(episode, name) for episode in ended)

    def _lower(self) -> None:
        """Include the mean costs of the last W episodes in the lowest ones."""
        for name in ("cost", "tight", "loose") if self.split else ("cost",):
            mean = sum(self._last_costs[name]) / self.judged
            self.lowest[name] = min(self.lowest.get(name, math.inf), mean)

    def _reason(self, step: StepRecord, env: int) -> str:
        """Return the name of the reason why an episode ended; a code without a name is returned as text."""
        if step.reasons is None:
            return "terminated" if step.terminated[env] else "truncated"
        return self._reasons.get(step.reasons[env], str(step.reasons[env]))
