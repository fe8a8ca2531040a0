"""A Lagrange multiplier at work: its value, how it moves, and how far it could still get."""

import math
from typing import Any, Literal

from thalweg.algos.maths import multiplier as maths

Rule = Literal["gradient", "adam"]

NEGLIGIBLE = 0.1
"""A multiplier of standardised advantages that can't exceed this hardly changes what is learnt."""
ENOUGH_EPISODES = 20
"""Before this many episodes nothing is said about what costs are possible."""


class Multiplier:
    """λ in 0..upper for a limit on the mean cost of an episode."""

    def __init__(self, limit: float, initial: float, rate: float, upper: float, rule: Rule) -> None:
        self.limit, self.rate, self.upper, self.rule = limit, rate, upper, rule
        self.value = initial
        self._moments, self._count = (0.0, 0.0), 0

    def update(self, cost: float) -> None:
        """Answer to the mean cost of the last episodes; NaN, where no episode has finished yet, changes nothing."""
        if math.isnan(cost):
            return
        if self.rule == "gradient":
            self.value = maths.projected_gradient(self.value, cost, self.limit, self.rate, self.upper)
            return
        self._count += 1
        self.value, self._moments = maths.adam(
            self.value, self._moments, self._count, cost, self.limit, self.rate, self.upper
        )

    def reach(self, updates: int, largest_cost: float) -> float:
        """The largest λ possible after so many updates if every episode had the largest cost seen."""
        gap = max(largest_cost - self.limit, 0.0)
        step = self.rate * gap if self.rule == "gradient" else self.rate * (gap > 0)
        return min(self.value + updates * step, self.upper)

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
                f"raise multiplier_rate (now {self.rate:g}), the steps, or update more often"
            }
        return {}

    def state(self) -> dict[str, Any]:
        """Plain data."""
        return {"value": self.value, "moments": list(self._moments), "count": self._count}

    def load_state(self, state: dict[str, Any]) -> None:
        """The inverse of `state`."""
        first, second = state["moments"]
        self.value, self._moments, self._count = (
            float(state["value"]),
            (float(first), float(second)),
            int(state["count"]),
        )
