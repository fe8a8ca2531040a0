"""A Lagrange multiplier at work: its value, how it moves, and how far it could still get."""

import math
from typing import Any, Literal, Protocol

from thalweg.algos.maths import multiplier as maths

Rule = Literal["gradient", "adam"]

NEGLIGIBLE = 0.1
"""A multiplier of standardised advantages that can't exceed this hardly changes what is learnt."""
ENOUGH_EPISODES = 20
"""Before this many episodes nothing is said about what costs are possible."""


class MultiplierConfig(Protocol):
    """The settings that an algorithm with a multiplier has among its own."""

    @property
    def cost_limit(self) -> float: ...
    @property
    def multiplier_rule(self) -> Rule: ...
    @property
    def multiplier_rate(self) -> float: ...
    @property
    def multiplier_gain(self) -> float: ...
    @property
    def multiplier_initial(self) -> float: ...
    @property
    def multiplier_max(self) -> float: ...


class Multiplier:
    """λ in 0..upper for a limit on the mean cost of an episode: a part that moves, and one that answers at once."""

    def __init__(self, config: MultiplierConfig) -> None:
        self.limit, self.rate, self.upper = config.cost_limit, config.multiplier_rate, config.multiplier_max
        self.rule, self.gain = config.multiplier_rule, config.multiplier_gain
        self.value = self._moving = config.multiplier_initial
        self._moments, self._count = (0.0, 0.0), 0

    def update(self, cost: float) -> None:
        """Answer to the mean cost of the last episodes; NaN, where no episode has finished yet, changes nothing."""
        if math.isnan(cost):
            return
        if self.rule == "gradient":
            self._moving = maths.projected_gradient(self._moving, cost, self.limit, self.rate, self.upper)
        else:
            self._count += 1
            self._moving, self._moments = maths.adam(
                self._moving, self._moments, self._count, cost, self.limit, self.rate, self.upper
            )
        self.value = maths.with_proportion(self._moving, cost, self.limit, self.gain, self.upper)

    def reach(self, updates: int, largest_cost: float) -> float:
        """The largest λ possible after so many updates if every episode had the largest cost seen."""
        gap = max(largest_cost - self.limit, 0.0)
        step = self.rate * gap if self.rule == "gradient" else self.rate * (gap > 0)
        return min(self._moving + updates * step + self.gain * gap, self.upper)

    def warnings(self, updates_left: int, episodes: int, largest_cost: float) -> dict[str, str]:
        """What keeps this multiplier from doing its work, by a short code; nothing is said before enough episodes."""
        if episodes < ENOUGH_EPISODES:
            return {}
        if largest_cost <= self.limit:
            return {
                "limit_never_binds": f"the cost limit {self.limit:g} has not bound anything: none of "
                f"{episodes} episodes cost more than {largest_cost:g}, so their mean can't exceed it"
            }
        reach = self.reach(updates_left, largest_cost)
        if reach < min(NEGLIGIBLE, self.upper):
            return {
                "multiplier_too_slow": f"the multiplier can't exceed {reach:.3g} in the {updates_left} updates left: "
                f"raise multiplier_rate (now {self.rate:g}), multiplier_gain, the steps, or update more often"
            }
        return {}

    def state(self) -> dict[str, Any]:
        """Plain data."""
        return {"value": self.value, "moving": self._moving, "moments": list(self._moments), "count": self._count}

    def load_state(self, state: dict[str, Any]) -> None:
        """The inverse of `state`."""
        first, second = state["moments"]
        self.value, self._moving = float(state["value"]), float(state["moving"])
        self._moments, self._count = (float(first), float(second)), int(state["count"])
