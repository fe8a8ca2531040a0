"""Lagrange multipliers at work: one for each cost, how they move, and how far they could still get."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from thalweg.algos.constraint.cost_limits import ENOUGH_EPISODES, MeanCostConfig, as_word, cost_suffixes
from thalweg.algos.interface import Feedback
from thalweg.algos.maths import multiplier as maths

Rule = Literal["gradient", "adam"]

NEGLIGIBLE = 0.1
"""A multiplier that can't exceed this hardly changes what is learnt, be it one of standardised advantages or, off
policy, of rewards of some size."""
ADAM_LONGEST = math.sqrt(10.0)
"""The most steps' rates that a step of Adam can have: (1 - β₁) / √(1 - β₂)."""
SETTLING = 0.25
"""Share of a run, its last, in which multipliers and natural steps may settle."""


@dataclass(frozen=True)
class MultiplierConfig(MeanCostConfig):
    """Settings of a Lagrange multiplier λ; each cost has one of its own."""

    multiplier_rule: Rule = "gradient"
    """How the part of λ that integrates moves: by projected gradient, or by Adam."""
    multiplier_rate: float = 1.0
    """Step size of that part; K_I of a PID multiplier."""
    multiplier_gain: float = 10.0
    """K_P: what is added to λ for each unit by which the mean cost exceeds the limit, at once; 0 for none."""
    multiplier_derivative: float = 0.0
    """K_D: what is added for each unit by which the mean cost has grown within `multiplier_delay` updates."""
    multiplier_smoothing: float = 0.0
    """How much of the old mean cost the terms of K_P and K_D keep at each update, 0..1; 0: the last one alone."""
    multiplier_delay: int = 1
    """Updates over which the growth of the mean cost is taken."""
    multiplier_initial: float = 0.0
    """λ before the first update."""
    multiplier_max: float = 10.0
    """Upper bound of λ."""
    multiplier_settles: bool = True
    """Whether a mean cost below the limit counts ever less over the last quarter of the run, down to nothing at its
    end: what swings about its limit, as a policy without chance always does, then ends on the safe side of it."""
    multiplier_warmup: int = 0
    """Updates before λ first moves."""

    def multiplier_conditions(self) -> dict[str, tuple[bool, str]]:
        """What must hold, for `require`."""
        return self.window_conditions() | {
            "multiplier_rate": (self.multiplier_rate >= 0, "must not be negative"),
            "multiplier_gain": (self.multiplier_gain >= 0, "must not be negative"),
            "multiplier_derivative": (self.multiplier_derivative >= 0, "must not be negative"),
            "multiplier_smoothing": (0 <= self.multiplier_smoothing < 1, "must be in 0..1, and less than 1"),
            "multiplier_delay": (self.multiplier_delay > 0, "must be positive"),
            "multiplier_max": (self.multiplier_max >= 0, "must not be negative"),
            "multiplier_initial": (
                0 <= self.multiplier_initial <= self.multiplier_max,
                "must be in 0..multiplier_max",
            ),
            "multiplier_warmup": (self.multiplier_warmup >= 0, "must not be negative"),
        }


class Multiplier:
    """λ in 0..upper for one limit on the mean cost of an episode.

    λ = clip(I + K_P δ + K_D ∂, 0, upper): a part I that moves by its rule, the smoothed violation δ, and the growth of
    the smoothed cost ∂ (Stooke, Achiam, Abbeel 2020, algorithm 2). With K_P = K_D = 0 it is the usual dual ascent.
    """

    def __init__(self, config: MultiplierConfig, limit: float) -> None:
        self.config, self.limit = config, limit
        self.value = self._moving = config.multiplier_initial
        self._moments, self._count, self._updates = (0.0, 0.0), 0, 0
        self._smooth: deque[float] = deque(maxlen=config.multiplier_delay + 1)
        """Smoothed mean costs, the newest last."""

    def update(self, cost: float, progress: float) -> None:
        """Answer to the mean cost of the last episodes at this share of the run; NaN, where no episode has finished
        yet, changes nothing."""
        config = self.config
        self._updates += 1
        if math.isnan(cost) or self._updates <= config.multiplier_warmup:
            return
        upper, rate, felt = config.multiplier_max, config.multiplier_rate, self._felt(cost, progress)
        if config.multiplier_rule == "gradient":
            self._moving = maths.projected_gradient(self._moving, felt, self.limit, rate, upper)
        else:
            self._count += 1
            self._moving, self._moments = maths.adam(
                self._moving, self._moments, self._count, felt, self.limit, rate, upper
            )
        before = self._smooth[-1] if self._smooth else cost
        self._smooth.append(maths.smoothed(before, cost, config.multiplier_smoothing))
        self.value = maths.pid(
            self._moving,
            self._felt(self._smooth[-1], progress) - self.limit,
            self._smooth[-1] - self._smooth[0],
            gain=config.multiplier_gain,
            derivative=config.multiplier_derivative,
            upper=upper,
        )

    def reach(self, updates: int, largest_cost: float) -> float:
        """The largest λ possible after so many more updates if every episode had the largest cost seen."""
        moves = max(updates - max(self.config.multiplier_warmup - self._updates, 0), 0)
        return self._after(self._moving, moves, largest_cost) if moves else self.value

    def possible(self, updates: int, largest_cost: float) -> float:
        """The largest λ possible in the whole run, of which so many updates are left, if every episode had."""
        moves = max(self._updates + updates - self.config.multiplier_warmup, 0)
        return self._after(self.config.multiplier_initial, moves, largest_cost)

    def _after(self, begin: float, moves: int, largest_cost: float) -> float:
        config, gap = self.config, max(largest_cost - self.limit, 0.0)
        step = config.multiplier_rate * (gap if config.multiplier_rule == "gradient" else ADAM_LONGEST * (gap > 0))
        growth = config.multiplier_derivative * max(largest_cost, 0.0)
        return min(begin + moves * step + (config.multiplier_gain * gap + growth) * (moves > 0), config.multiplier_max)

    def _felt(self, cost: float, progress: float) -> float:
        """The cost as it counts: one below the limit ever less, where the multiplier settles."""
        if not self.config.multiplier_settles or cost >= self.limit:
            return cost
        return cost + max(1.0 - (1.0 - progress) / SETTLING, 0.0) * (self.limit - cost)

    def state(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "value": self.value,
            "moving": self._moving,
            "moments": list(self._moments),
            "count": self._count,
            "updates": self._updates,
            "smooth": list(self._smooth),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """The inverse of `state`."""
        first, second = state["moments"]
        self.value, self._moving = float(state["value"]), float(state["moving"])
        self._moments, self._count = (float(first), float(second)), int(state["count"])
        self._updates = int(state["updates"])
        self._smooth.clear()
        self._smooth.extend(float(cost) for cost in state["smooth"])


class Multipliers:
    """One multiplier for each of M costs."""

    def __init__(self, config: MultiplierConfig, limits: Sequence[float]) -> None:
        self.config = config
        self.each = tuple(Multiplier(config, limit) for limit in limits)

    @property
    def values(self) -> tuple[float, ...]:
        """λ of each cost [M]."""
        return tuple(one.value for one in self.each)

    def update(self, feedback: Feedback) -> None:
        """Answer to the mean costs of the episodes that count; without a window, each episode counts once."""
        known = self.config.cost_window or len(feedback.fresh_costs)
        for one, cost in zip(self.each, feedback.cost_means(self.config.cost_window), strict=True):
            one.update(cost if known else math.nan, feedback.progress)

    def metrics(self, feedback: Feedback, updates_left: int) -> dict[str, float]:
        """Each λ used in this update, and how far it can still get."""
        names = cost_suffixes(len(self.each))
        reaches = [
            one.reach(updates_left, largest) for one, largest in zip(self.each, feedback.largest_costs, strict=True)
        ]
        return {f"multiplier{name}": value for name, value in zip(names, self.values, strict=True)} | {
            f"multiplier_reach{name}": reach for name, reach in zip(names, reaches, strict=True)
        }

    def warnings(self, feedback: Feedback, updates_left: int) -> dict[str, str]:
        """Multipliers that can't do their work, by a short code; nothing is said before enough episodes."""
        found: dict[str, str] = {}
        if feedback.episodes < ENOUGH_EPISODES:
            return found
        names = cost_suffixes(len(self.each))
        for one, name, largest in zip(self.each, names, feedback.largest_costs, strict=True):
            possible = one.possible(updates_left, largest)
            if largest > one.limit and possible < NEGLIGIBLE:
                found[f"multiplier_too_slow{name}"] = (
                    f"the {as_word(name)}multiplier can't exceed {possible:.3g} in this run, {updates_left} updates "
                    f"before its end: raise multiplier_rate (now {self.config.multiplier_rate:g}), multiplier_gain, "
                    f"multiplier_max (now {self.config.multiplier_max:g}) or the steps, or update more often"
                )
        return found

    def state(self) -> dict[str, Any]:
        """Plain data."""
        return {str(place): one.state() for place, one in enumerate(self.each)}

    def load_state(self, state: dict[str, Any]) -> None:
        """The inverse of `state`."""
        for place, one in enumerate(self.each):
            one.load_state(state[str(place)])
