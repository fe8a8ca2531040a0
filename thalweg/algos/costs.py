"""Which limits are there on the costs of an episode, and what do the episodes say of them? Of every algorithm that has
such limits."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from thalweg.algos.interface import Feedback
from thalweg.algos.multiplier import suffixes


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


def cost_metrics(feedback: Feedback, limits: Sequence[float] = (), window: int = 0) -> dict[str, float]:
    """J_c of each cost and the number of episodes behind it, and whether each limit has been broken by any episode."""
    names = suffixes(len(feedback.largest_costs))
    means = {f"cost_mean{name}": mean for name, mean in zip(names, feedback.cost_means(window), strict=True)}
    bind = {
        f"limit_can_bind{name}": float(largest > limit)
        for name, largest, limit in zip(names, feedback.largest_costs, limits, strict=bool(limits))
    }
    return means | {"cost_episodes": len(feedback.fresh_costs)} | bind
