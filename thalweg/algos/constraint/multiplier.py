"""Lagrange multipliers: settings, one multiplier per cost, its update, and the largest value it can still reach."""

import math
from collections import deque
from collections.abc import Sequence
from typing import Annotated, Any, Literal, Self

from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveInt, model_validator

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.constraint.cost_limits import ENOUGH_EPISODES, MeanCostConfig, as_word, cost_suffixes
from thalweg.algos.interface import Feedback
from thalweg.algos.maths import multiplier as maths
from thalweg.core.config import FiniteNonNegative, Fraction, frozen_config

Rule = Literal["gradient", "adam"]
Violation = Literal["relative", "absolute"]

NEGLIGIBLE = 0.1
"""A multiplier that can't exceed this hardly changes the policy, whether it weighs standardised advantages or, off
policy, rewards of some size."""
ADAM_LONGEST = math.sqrt(10.0)
"""Largest step of Adam in units of its learning rate: (1 - β₁) / √(1 - β₂)."""
SETTLING = 0.25
"""Final share of a run in which multipliers and natural steps settle, if their config says so."""


@frozen_config(AlgorithmError)
class MultiplierConfig(MeanCostConfig):
    """Settings of the Lagrange multipliers λ; each cost has its own multiplier."""

    multiplier_rule: Rule = "gradient"
    """Optimiser of the integral part of λ: projected gradient, or Adam."""
    multiplier_violation: Violation = "relative"
    """The violation δ that λ responds to: (J_c - d) / max(J_c, d), from -1 to 1, so that λ rises and falls alike and
    other settings suit any unit of cost ("relative"), or J_c - d ("absolute")."""
    multiplier_rate: FiniteNonNegative = 0.1
    """Step size of the integral part; K_I of a PID multiplier."""
    multiplier_gain: FiniteNonNegative = 2.0
    """K_P: added to λ for each unit of the violation; 0 switches this part off."""
    multiplier_derivative: FiniteNonNegative = 0.0
    """K_D: added to λ for each unit by which the violation has grown within `multiplier_delay` updates."""
    multiplier_smoothing: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Weight of the previous mean cost in the exponential mean that K_P and K_D use, 0..1; 0 uses the last mean cost
    alone."""
    multiplier_delay: PositiveInt = 1
    """Number of updates over which the growth of the mean cost is measured."""
    multiplier_initial: FiniteNonNegative = 0.0
    """λ before the first update."""
    multiplier_max: NonNegativeFloat = 10.0
    """Upper bound of λ."""
    multiplier_antiwindup: bool = True
    """Whether the integral part stops rising while λ is at its upper bound, so that λ falls as soon as costs do."""
    multiplier_settles: bool = True
    """Whether a mean cost below the limit lowers λ less and less over the last quarter of the run. A policy that
    oscillates about its limit, as a deterministic one does, then ends below it."""
    multiplier_final_fall: Fraction = 0.5
    """Share of the violation that remains at the end of a run with `multiplier_settles`, for costs below the limit: 0
    holds λ, 1 lowers it as before."""
    multiplier_warmup: NonNegativeInt = 0
    """Number of updates before λ first changes."""

    @model_validator(mode="after")
    def _multiplier_begins_below_its_maximum(self) -> Self:
        if self.multiplier_initial > self.multiplier_max:
            raise ValueError(
                f"multiplier_initial must be at most multiplier_max = {self.multiplier_max}, "
                f"got {self.multiplier_initial}"
            )
        return self


class Multiplier:
    """A multiplier λ in 0..upper for one limit on the mean cost of an episode.

    λ = clip(I + K_P δ + K_D ∂, 0, upper), with an integral part I, the smoothed violation δ, and its growth ∂ (Stooke,
    Achiam, Abbeel 2020, algorithm 2). With K_P = K_D = 0 it is the usual dual ascent.
    """

    def __init__(self, config: MultiplierConfig, limit: float) -> None:
        """`limit` is the smallest limit d of the run."""
        self.config, self.limit = config, limit
        self.value = self._integral = config.multiplier_initial
        self._moments, self._count, self._updates = (0.0, 0.0), 0, 0
        self._smooth: deque[float] = deque(maxlen=config.multiplier_delay + 1)
        """Exponential means of the mean cost, the newest last."""

    def update(self, cost: float, progress: float, limit: float | None = None) -> None:
        """Update λ by the mean cost of the last episodes.

        Args:
            cost: J_c; NaN, if no episode has finished yet, changes nothing.
            progress: Share of the run so far, 0..1.
            limit: d of this update, if it is not the final one yet.
        """
        config, limit = self.config, self.limit if limit is None else limit
        self._updates += 1
        if math.isnan(cost) or self._updates <= config.multiplier_warmup:
            return
        before = self._smooth[-1] if self._smooth else cost
        self._smooth.append(maths.smoothed(before, cost, config.multiplier_smoothing))
        now, then = (self._violation(smooth, limit) for smooth in (self._smooth[-1], self._smooth[0]))
        settled, growth = self._settled(now, progress), now - then
        violation = self._settled(self._violation(cost, limit), progress)
        if not (config.multiplier_antiwindup and self._winds_up(settled, growth, violation)):
            self._integrate(violation)
        self.value = min(max(self._output(settled, growth), 0.0), config.multiplier_max)

    def _integrate(self, violation: float) -> None:
        """Take one step of the integral part by its rule."""
        upper, rate = self.config.multiplier_max, self.config.multiplier_rate
        if self.config.multiplier_rule == "gradient":
            self._integral = maths.projected_gradient(self._integral, violation, rate, upper)
        else:
            self._count += 1
            self._integral, self._moments = maths.adam(
                self._integral, self._moments, self._count, violation, rate, upper
            )

    def _winds_up(self, smooth: float, growth: float, violation: float) -> bool:
        return maths.winds_up(self._output(smooth, growth), violation, self.config.multiplier_max)

    def _output(self, violation: float, growth: float) -> float:
        """Return λ before it is clipped, from the smoothed violation and its growth."""
        gain, derivative = self.config.multiplier_gain, self.config.multiplier_derivative
        return maths.pid(self._integral, violation, growth, gain=gain, derivative=derivative)

    def _violation(self, cost: float, limit: float) -> float:
        """Return δ of a mean cost, in the unit of the config."""
        return maths.relative_violation(cost, limit) if self.config.multiplier_violation == "relative" else cost - limit

    def _settled(self, violation: float, progress: float) -> float:
        """Return the violation that λ responds to: while the multiplier settles, one below the limit shrinks."""
        if not self.config.multiplier_settles or violation >= 0:
            return violation
        settled = max(1.0 - (1.0 - progress) / SETTLING, 0.0)
        return violation * (1.0 - settled * (1.0 - self.config.multiplier_final_fall))

    def reach(self, updates: int, largest_cost: float) -> float:
        """Return the largest λ possible after this many more updates, if every episode had the largest cost seen."""
        moves = max(updates - max(self.config.multiplier_warmup - self._updates, 0), 0)
        return self._largest_after(self._integral, moves, largest_cost) if moves else self.value

    def possible(self, updates: int, largest_cost: float) -> float:
        """Return the largest λ possible in the run if every episode had the largest cost seen.

        `updates` is the number of updates that are left.
        """
        moves = max(self._updates + updates - self.config.multiplier_warmup, 0)
        return self._largest_after(self.config.multiplier_initial, moves, largest_cost)

    def _largest_after(self, initial: float, moves: int, largest_cost: float) -> float:
        config, gap = self.config, max(self._violation(largest_cost, self.limit), 0.0)
        step = config.multiplier_rate * (gap if config.multiplier_rule == "gradient" else ADAM_LONGEST * (gap > 0))
        growth = config.multiplier_derivative * (
            self._violation(largest_cost, self.limit) - self._violation(0.0, self.limit)
        )
        return min(
            initial + moves * step + (config.multiplier_gain * gap + growth) * (moves > 0), config.multiplier_max
        )

    def state(self) -> dict[str, Any]:
        """Return the state as plain data."""
        return {
            "value": self.value,
            "moving": self._integral,
            "moments": list(self._moments),
            "count": self._count,
            "updates": self._updates,
            "smooth": list(self._smooth),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        first, second = state["moments"]
        self.value, self._integral = float(state["value"]), float(state["moving"])
        self._moments, self._count = (float(first), float(second)), int(state["count"])
        self._updates = int(state["updates"])
        self._smooth.clear()
        self._smooth.extend(float(cost) for cost in state["smooth"])


class Multipliers:
    """The multipliers of M costs."""

    def __init__(self, config: MultiplierConfig, limits: Sequence[float]) -> None:
        self.config, self._limits = config, tuple(limits)
        self.each = tuple(Multiplier(config, limit) for limit in limits)

    @property
    def values(self) -> tuple[float, ...]:
        """λ of each cost [M]."""
        return tuple(multiplier.value for multiplier in self.each)

    def update(self, feedback: Feedback, limits: Sequence[float] = ()) -> None:
        """Update every λ by the mean cost of its episodes, and the limits of this update if they are not final yet.

        Without a window and without a new episode, nothing changes.
        """
        has_news = self.config.cost_window or len(feedback.new_costs)
        means = self.config.cost_means(feedback)
        for multiplier, cost, limit in zip(self.each, means, limits or self._limits, strict=True):
            multiplier.update(cost if has_news else math.nan, feedback.progress, limit)

    def metrics(self, feedback: Feedback, updates_left: int) -> dict[str, float]:
        """Return each λ used in this update, and the largest value it can still reach."""
        names = cost_suffixes(len(self.each))
        reaches = [
            multiplier.reach(updates_left, largest)
            for multiplier, largest in zip(self.each, feedback.largest_costs, strict=True)
        ]
        return {f"multiplier{name}": value for name, value in zip(names, self.values, strict=True)} | {
            f"multiplier_reach{name}": reach for name, reach in zip(names, reaches, strict=True)
        }

    def warnings(self, feedback: Feedback, updates_left: int) -> dict[str, str]:
        """Return warnings, by a short code, about multipliers that stay negligible; none before enough episodes."""
        found: dict[str, str] = {}
        if feedback.episodes < ENOUGH_EPISODES:
            return found
        names = cost_suffixes(len(self.each))
        for multiplier, name, largest in zip(self.each, names, feedback.largest_costs, strict=True):
            possible = multiplier.possible(updates_left, largest)
            if largest > multiplier.limit and possible < NEGLIGIBLE:
                found[f"multiplier_too_slow{name}"] = (
                    f"the {as_word(name)}multiplier can't exceed {possible:.3g} in this run, {updates_left} updates "
                    f"before its end: raise multiplier_rate (now {self.config.multiplier_rate:g}), multiplier_gain, "
                    f"multiplier_max (now {self.config.multiplier_max:g}) or the steps, or update more often"
                )
        return found

    def state(self) -> dict[str, Any]:
        """Return the state as plain data."""
        return {str(index): multiplier.state() for index, multiplier in enumerate(self.each)}

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        for index, multiplier in enumerate(self.each):
            multiplier.load_state(state[str(index)])
