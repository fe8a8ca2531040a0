"""Settings of cost limits, their metrics, and warnings about limits that no episode exceeds, or no policy meets."""

import math
from collections.abc import Sequence
from typing import Annotated, Any, Self

from pydantic import Field, PositiveInt, model_validator

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.interface import RECENT_EPISODES, Feedback, recent_episodes
from thalweg.core.config import FiniteNonNegative, TupleOf, frozen_config

Multiple = Annotated[float, Field(ge=1, allow_inf_nan=False)]
"""A limit at the beginning of a run, as a multiple of the final one."""

ENOUGH_EPISODES = 20
"""Number of finished episodes from which warnings are given."""
LONG_ENOUGH = 0.5
"""Share of the time with the final limit after which a limit that has never been met is named."""


@frozen_config(AlgorithmError)
class CostConfig:
    """Settings of a limit on the mean cost of an episode."""

    cost_limit: FiniteNonNegative = 0.1
    """Limit d on the mean cost of an episode."""
    cost_limits: TupleOf[FiniteNonNegative] = ()
    """Separate limits of the tight and the loose cost, in place of `cost_limit`."""
    cost_limit_schedule: TupleOf[Multiple] = ()
    """Limits at the beginning of the run, as multiples of the final ones: one number for all costs, or one for each.
    They tighten linearly, and at once when the mean cost of fifty episodes in a row has met the final limit, above 16
    environments that of three episodes of each. Empty: limits stay the same. A limit that idling exceeds teaches a
    beginner to avoid costs before it has seen what flying pays."""
    cost_limit_share: Annotated[float, Field(gt=0, le=1)] = 0.5
    """Share of the run after which limits with a schedule have tightened to the final ones."""

    @model_validator(mode="after")
    def _limits_are_two(self) -> Self:
        if len(self.cost_limits) not in (0, 2):
            raise ValueError(f"cost_limits must be two, tight and loose, got {list(self.cost_limits)}")
        return self

    @model_validator(mode="after")
    def _schedule_fits_the_limits(self) -> Self:
        if len(self.cost_limit_schedule) not in {0, 1, len(self.limits)}:
            raise ValueError(
                f"cost_limit_schedule must have one number, or one for each of {len(self.limits)} limits, got "
                f"{list(self.cost_limit_schedule)}"
            )
        return self

    @property
    def limits(self) -> tuple[float, ...]:
        """Limit d of each cost [M]."""
        return self.cost_limits or (self.cost_limit,)

    def limits_at(self, progress: float, lowest_costs: Sequence[float] = ()) -> tuple[float, ...]:
        """Return the limits d [M] after this share of the run, 0..1.

        d (m + (1 - m) min(p / s, 1)), for the multiple m of `cost_limit_schedule` and the share s; d itself once it has
        been met by the lowest mean cost so far of W episodes in a row [M] (`Feedback.lowest_costs`; NaN: unknown).
        """
        if not self.cost_limit_schedule:
            return self.limits
        tightened = min(progress / self.cost_limit_share, 1.0)
        multiples = self.cost_limit_schedule
        if len(multiples) == 1:
            multiples = multiples * len(self.limits)
        lowest = lowest_costs or (math.nan,) * len(self.limits)
        return tuple(
            d if cost <= d else d * (m + (1.0 - m) * tightened)
            for d, m, cost in zip(self.limits, multiples, lowest, strict=True)
        )

    def current_limits(self, feedback: Feedback) -> tuple[float, ...]:
        """Return the limits d [M] of an update; see `limits_at`."""
        return self.limits_at(feedback.progress, feedback.lowest_costs)

    @property
    def separate_costs(self) -> bool:
        """Whether each cost has its own limit."""
        return bool(self.cost_limits)


@frozen_config(AlgorithmError)
class MeanCostConfig:
    """Settings of the mean cost that is compared with the limit."""

    cost_window: Annotated[int, Field(ge=0, le=RECENT_EPISODES)] = 0
    """Number of last episodes in the mean cost, which then lags. With 0, the mean is over the episodes that finished
    since the last update, and at least over the last `cost_episodes`; without a new one multipliers do not change."""
    cost_episodes: PositiveInt = 30
    """Least number of episodes in the mean cost, as soon as so many have finished: the mean of a few is mostly chance.
    Has no effect with `cost_window`. Above 16 environments the default is two episodes of each."""

    def cost_means(self, feedback: Feedback) -> tuple[float, ...]:
        """Return J_c [M], the mean costs that are compared with the limits; NaN before any episode has finished."""
        return feedback.cost_means(self.cost_window, self.cost_episodes)


def check_cost_episodes(config: Any, num_envs: int) -> None:
    """Raise `AlgorithmError` for more `cost_episodes` than a run with N environments remembers."""
    if not isinstance(config, MeanCostConfig) or config.cost_episodes <= (most := recent_episodes(num_envs)):
        return
    given = config.cost_episodes
    raise AlgorithmError(f"cost_episodes must be at most {most} with {num_envs} environments, got {given}")


def cost_metrics(
    feedback: Feedback, limits: Sequence[float] = (), means: Sequence[float] | None = None
) -> dict[str, float]:
    """Return J_c of each cost, the number of new episodes, the limits, and whether any episode exceeded them.

    Args:
        feedback: The statistics.
        limits: d [M] of this update; none for an algorithm without limits.
        means: J_c [M] that is compared with them; by default the mean of the new episodes.
    """
    names = cost_suffixes(len(feedback.largest_costs))
    compared = feedback.cost_means() if means is None else means
    found = {f"cost_mean{name}": mean for name, mean in zip(names, compared, strict=True)}
    found |= {"cost_episodes": len(feedback.new_costs)}
    for name, largest, limit in zip(names, feedback.largest_costs, limits, strict=bool(limits)):
        found |= {f"cost_limit{name}": limit, f"limit_can_bind{name}": float(largest > limit)}
    return found


def limit_warnings(config: CostConfig, feedback: Feedback) -> dict[str, str]:
    """Return warnings, by a short code, about cost limits that no episode has exceeded, or no policy has met."""
    if feedback.episodes < ENOUGH_EPISODES:
        return {}
    names = cost_suffixes(len(config.limits))
    never_binds = {
        f"limit_never_binds{name}": f"the {as_word(name)}cost limit {limit:g} has not bound anything: none of "
        f"{feedback.episodes} episodes cost more than {largest:g}, so their mean can't exceed it"
        for name, limit, largest in zip(names, config.limits, feedback.largest_costs, strict=True)
        if largest <= limit
    }
    tightening = config.cost_limit_share if config.cost_limit_schedule else 0.0
    if feedback.progress < tightening + LONG_ENOUGH * (1.0 - tightening):
        return never_binds
    wider, later = "begin with a wider limit (cost_limit_schedule)", "let it tighten later (cost_limit_share)"
    return never_binds | {
        f"limit_never_met{name}": f"the {as_word(name)}cost limit {limit:g} has never been met: in "
        f"{feedback.episodes} episodes, the mean cost of {feedback.judged} in a row never fell below {lowest:.3g}; if "
        f"a policy that has learnt nothing yet can't meet it, {later if config.cost_limit_schedule else wider}"
        for name, limit, lowest in zip(names, config.limits, feedback.lowest_costs, strict=True)
        if lowest > limit
    }


def cost_suffixes(costs: int) -> tuple[str, ...]:
    """Return the suffixes of the costs in names: none for a single cost, tight and loose for two, else numbers."""
    if costs == 1:
        return ("",)
    return ("_tight", "_loose") if costs == 2 else tuple(f"_{index}" for index in range(costs))


def as_word(suffix: str) -> str:
    """Return a suffix as a word followed by a space, or an empty string for a single cost."""
    return f"{suffix.removeprefix('_')} " if suffix else ""
