"""Units and bounds of critics' values, from the rewards and costs of a run and the returns of its finished episodes.

The unit of the reward is the standard deviation of the discounted return from a step on; that of a cost is the largest
cost of a single step, or its limit where that is greater and the config says so. A deviation of costs would shrink as a
policy learns to avoid them, and the same multiplier would weigh one cost more and more, until it outweighs all that can
be earned.

Critics learn rewards and costs in these units, and their targets stay within the bounds. The replay buffer holds raw
numbers, so that every batch is in the units of the moment. Letters: N environments, T steps, B rows of a batch, S =
1 + M signals (the reward, then M costs).
"""

from collections.abc import Sequence
from typing import Any, Literal, Protocol

import numpy as np
import torch
from torch import Tensor

from thalweg.algos.common.return_statistics import ReturnStatistics
from thalweg.algos.common.value_bounds import impossible_values
from thalweg.algos.constraint.cost_limits import ENOUGH_EPISODES, as_word, cost_suffixes
from thalweg.algos.interface import Feedback, Rollout

CostScale = Literal["step", "limit"]

LEAST_UNIT = 0.1
"""Least unit of the reward, as a share of the largest return: no return exceeds ten units, however rare it is."""


class ValueScaleConfig(Protocol):
    """Config fields that units and bounds need."""

    @property
    def scale_returns(self) -> bool: ...
    @property
    def cost_scale(self) -> CostScale: ...
    @property
    def limits(self) -> tuple[float, ...]: ...
    @property
    def bound_targets(self) -> bool: ...
    @property
    def bound_margin(self) -> float: ...
    @property
    def return_bounds(self) -> tuple[float, ...]: ...
    @property
    def largest_costs(self) -> tuple[float, ...]: ...
    @property
    def discount(self) -> float: ...
    @property
    def cost_discount(self) -> float: ...


class ValueScale:
    """Units and bounds of the values of S signals, learnt from the episodes of a run, or bounds from the settings."""

    def __init__(self, config: ValueScaleConfig, costs: int, num_envs: int, device: torch.device) -> None:
        self.config, self._costs = config, costs
        self.statistics = ReturnStatistics(num_envs, (config.discount, *[config.cost_discount] * costs))
        # These tensors are changed in place: recorded CUDA graphs read them.
        self.units = torch.ones(1 + costs, 1, dtype=torch.float32, device=device)
        """[S, 1] unit of each signal."""
        self._low = torch.full_like(self.units, -torch.inf)
        self._high = torch.full_like(self.units, torch.inf)
        """[S, 1] bounds in units."""

    def update(self, rollout: Rollout, costs: Tensor) -> None:
        """Add the steps of a rollout, with costs [T, N, M] as critics learn them."""
        signals = torch.cat([rollout.rewards.unsqueeze(-1), costs], -1).cpu().numpy()
        masks = (rollout.fresh[:-1], rollout.terminated, rollout.truncated, rollout.valid)
        self.statistics.update(signals, *(mask.cpu().numpy() for mask in masks))
        self._refresh()

    def scaled(self, signals: Tensor) -> Tensor:
        """Return rewards and costs [S, B] in units."""
        return signals / self.units if self.config.scale_returns else signals

    def bounded(self, targets: Tensor, below: float | Tensor = 0.0, above: float | Tensor = 0.0) -> Tensor:
        """Return targets [S, B] in units, clipped to the bounds.

        `below` and `above`, in units, widen those of the reward for what a target contains beside rewards.
        """
        if not self.config.bound_targets:
            return targets
        low, high = self._low, self._high
        if isinstance(above, float) and below == above == 0.0:
            return targets.clamp(low, high)
        reward = targets[:1].clamp(low[:1] - below, high[:1] + above)
        return torch.cat([reward, targets[1:].clamp(low[1:], high[1:])])

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the smallest and largest value possible of each signal [S], in the task's units.

        Bounds of the settings are used as they are. Learnt ones are the extremes of the returns so far, widened by
        `bound_margin` of their distance; infinite before any episode has finished.
        """
        config = self.config
        low, high = self.statistics.bounds(config.bound_margin)
        if config.return_bounds:
            low[0], high[0] = config.return_bounds
        if config.largest_costs:
            low[1:], high[1:] = 0.0, config.largest_costs
        return low, high

    def _refresh(self) -> None:
        """Set units and bounds from the statistics."""
        found = self.statistics
        if self.config.scale_returns:
            units = found.largest_step.copy()
            if self.config.cost_scale == "limit":
                units[1:] = np.maximum(units[1:], self.config.limits)
            units[0] = max(found.deviation[0], LEAST_UNIT * max(-found.low[0], found.high[0])) if found.count else 1.0
            self._set(self.units, np.where(units > 0.0, units, 1.0))
        for tensor, values in zip((self._low, self._high), self.bounds(), strict=True):
            self._set(tensor, values)
            tensor /= self.units

    @staticmethod
    def _set(tensor: Tensor, values: np.ndarray) -> None:
        tensor.copy_(torch.from_numpy(values).unsqueeze(1))

    def metrics(self) -> dict[str, float]:
        """Return the unit and the largest value possible of the reward and of each cost."""
        names = ["reward", *(f"cost{name}" for name in cost_suffixes(self._costs))]
        units, high = self.units[:, 0].tolist(), self.bounds()[1].tolist()
        return {f"{name}_unit": unit for name, unit in zip(names, units, strict=True)} | {
            f"{name}_value_max": value for name, value in zip(names, high, strict=True)
        }

    def warnings(self, means: Sequence[float], feedback: Feedback, above: float = 0.0) -> dict[str, str]:
        """Return warnings, by a short code, about mean values [S] that no episode can pay or cost.

        `above` widens the bound of the reward, in the task's units. None before enough episodes.
        """
        if feedback.episodes < ENOUGH_EPISODES or not self.statistics.count:
            return {}
        words = ["reward", *(f"{as_word(name)}cost" for name in cost_suffixes(self._costs))]
        low, high = self.bounds()
        high[0] += above
        bounded = "correct the bounds" if self.config.bound_targets else "set bound_targets"
        remedy = f"lower critic_learning_rate or target_rate, or {bounded}"
        return impossible_values(words, means, low.tolist(), high.tolist(), remedy)

    def state(self) -> dict[str, Any]:
        """Return the statistics as arrays and plain data."""
        return self.statistics.state()

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        self.statistics.load_state(state)
        self._refresh()
