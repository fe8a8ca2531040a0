"""Settings of cost limits, their metrics, and warnings about limits that no episode exceeds."""

from collections.abc import Sequence
from typing import Annotated, Self

from pydantic import Field, model_validator

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.interface import RECENT_EPISODES, Feedback
from thalweg.core.config import FiniteNonNegative, TupleOf, frozen_config

ENOUGH_EPISODES = 20
"""Number of finished episodes from which warnings are given."""


@frozen_config(AlgorithmError)
class CostConfig:
    """Settings of a limit on the mean cost of an episode."""

    cost_limit: FiniteNonNegative = 0.1
    """Limit d on the mean cost of an episode."""
    cost_limits: TupleOf[FiniteNonNegative] = ()
    """Separate limits of the tight and the loose cost, in place of `cost_limit`."""

    @model_validator(mode="after")
    def _limits_are_two(self) -> Self:
        if len(self.cost_limits) not in (0, 2):
            raise ValueError(f"cost_limits must be two, tight and loose, got {list(self.cost_limits)}")
        return self

    @property
    def limits(self) -> tuple[float, ...]:
        """Limit d of each cost [M]."""
        return self.cost_limits or (self.cost_limit,)

    @property
    def separate_costs(self) -> bool:
        """Whether each cost has its own limit."""
        return bool(self.cost_limits)


@frozen_config(AlgorithmError)
class MeanCostConfig:
    """Settings of the mean cost that is compared with the limit."""

    cost_window: Annotated[int, Field(ge=0, le=RECENT_EPISODES)] = 0
    """Number of last episodes in the mean cost, which then lags. With 0, the mean is over the episodes that finished
    since the last update; if there are none, over the last fifty, and multipliers do not change."""


def cost_metrics(feedback: Feedback, limits: Sequence[float] = (), window: int = 0) -> dict[str, float]:
    """Return J_c of each cost, the number of fresh episodes, and whether any episode has exceeded each limit."""
    names = cost_suffixes(len(feedback.largest_costs))
    means = {f"cost_mean{name}": mean for name, mean in zip(names, feedback.cost_means(window), strict=True)}
    bind = {
        f"limit_can_bind{name}": float(largest > limit)
        for name, largest, limit in zip(names, feedback.largest_costs, limits, strict=bool(limits))
    }
    return means | {"cost_episodes": len(feedback.fresh_costs)} | bind


def limit_warnings(limits: Sequence[float], feedback: Feedback) -> dict[str, str]:
    """Return warnings, by a short code, about cost limits that no episode has exceeded."""
    if feedback.episodes < ENOUGH_EPISODES:
        return {}
    return {
        f"limit_never_binds{name}": f"the {as_word(name)}cost limit {limit:g} has not bound anything: none of "
        f"{feedback.episodes} episodes cost more than {largest:g}, so their mean can't exceed it"
        for name, limit, largest in zip(cost_suffixes(len(limits)), limits, feedback.largest_costs, strict=True)
        if largest <= limit
    }


def cost_suffixes(costs: int) -> tuple[str, ...]:
    """Return the suffixes of the costs in names: none for a single cost, tight and loose for two, else numbers."""
    if costs == 1:
        return ("",)
    return ("_tight", "_loose") if costs == 2 else tuple(f"_{index}" for index in range(costs))


def as_word(suffix: str) -> str:
    """Return a suffix as a word followed by a space, or an empty string for a single cost."""
    return f"{suffix.removeprefix('_')} " if suffix else ""
