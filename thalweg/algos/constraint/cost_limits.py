"""Which limits are there on the costs of an episode, and what do the episodes say of them? Of every algorithm that has
such limits."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from thalweg.algos.interface import RECENT_EPISODES, Feedback

ENOUGH_EPISODES = 20
"""Before this many episodes nothing is said about what costs are possible."""


@dataclass(frozen=True)
class CostConfig:
    """Settings of a limit on the mean cost of an episode."""

    cost_limit: float = 0.1
    """d: the mean cost that an episode may have."""
    cost_limits: tuple[float, ...] = ()
    """Limits of the two costs that the environment tells apart, tight and loose, each for itself, in place of
    `cost_limit`."""

    @property
    def limits(self) -> tuple[float, ...]:
        """d of each cost [M]."""
        return self.cost_limits or (self.cost_limit,)

    @property
    def separate_costs(self) -> bool:
        """Whether costs are limited one by one."""
        return bool(self.cost_limits)

    def cost_conditions(self) -> dict[str, tuple[bool, str]]:
        """What must hold, for `require`."""
        return {
            "cost_limit": (0 <= self.cost_limit < math.inf, "must not be negative, nor infinite"),
            "cost_limits": (
                len(self.cost_limits) in (0, 2) and all(0 <= limit < math.inf for limit in self.cost_limits),
                "are two, tight and loose, and not negative, nor infinite",
            ),
        }


@dataclass(frozen=True)
class MeanCostConfig:
    """Settings of the mean cost that is held against the limit."""

    cost_window: int = 0
    """Last episodes that the mean cost is taken over, so that it lags; 0: those that have finished since the last
    update, and if there are none, the last fifty (multipliers then stay as they are)."""

    def window_conditions(self) -> dict[str, tuple[bool, str]]:
        """What must hold, for `require`."""
        return {"cost_window": (0 <= self.cost_window <= RECENT_EPISODES, f"must be in 0..{RECENT_EPISODES}")}


def cost_metrics(feedback: Feedback, limits: Sequence[float] = (), window: int = 0) -> dict[str, float]:
    """J_c of each cost, the number of fresh episodes, and whether each limit has been broken by any episode."""
    names = cost_suffixes(len(feedback.largest_costs))
    means = {f"cost_mean{name}": mean for name, mean in zip(names, feedback.cost_means(window), strict=True)}
    bind = {
        f"limit_can_bind{name}": float(largest > limit)
        for name, largest, limit in zip(names, feedback.largest_costs, limits, strict=bool(limits))
    }
    return means | {"cost_episodes": len(feedback.fresh_costs)} | bind


def limit_warnings(limits: Sequence[float], feedback: Feedback) -> dict[str, str]:
    """Cost limits that no episode has been able to break, by a short code."""
    if feedback.episodes < ENOUGH_EPISODES:
        return {}
    return {
        f"limit_never_binds{name}": f"the {as_word(name)}cost limit {limit:g} has not bound anything: none of "
        f"{feedback.episodes} episodes cost more than {largest:g}, so their mean can't exceed it"
        for name, limit, largest in zip(cost_suffixes(len(limits)), limits, feedback.largest_costs, strict=True)
        if largest <= limit
    }


def cost_suffixes(costs: int) -> tuple[str, ...]:
    """What tells the costs apart in names: nothing if there is but one, else tight and loose, or numbers."""
    if costs == 1:
        return ("",)
    return ("_tight", "_loose") if costs == 2 else tuple(f"_{place}" for place in range(costs))


def as_word(suffix: str) -> str:
    """A suffix as a word in a sentence, or nothing."""
    return f"{suffix.removeprefix('_')} " if suffix else ""
