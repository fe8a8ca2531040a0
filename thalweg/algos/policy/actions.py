"""Action spaces as policies see them: network outputs to distributions, raw actions to environment actions.

`raw` actions are what the algorithm learns from: the drawn options, or continuous numbers. `executable` makes of them
what the environment executes. Letters: N environments, A branches of a discrete space or numbers of a Box.
"""

import math
import operator
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, get_args

import gymnasium as gym
import numpy as np
import torch
from torch import Tensor

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.maths import gaussian
from thalweg.algos.policy.distributions import Categoricals, Deterministic, Distribution, Gaussians, SquashedGaussian

Adapter = Literal["native", "box_literal", "box_scaled"]
"""How discrete actions are learnt: as they are, or as numbers that are rounded to options.

`box_literal` rounds the number itself to 0..K-1, as the study's published code does: a policy bounded to -1..1 then
reaches the first options only. `box_scaled` stretches -1..1 over all options first.
"""
Kind = Literal["categorical", "gaussian", "squashed", "point"]
"""Kind of policy: categorical, Gaussian, Gaussian through tanh, or deterministic through tanh."""
MOST_JOINT_ACTIONS = 4096
"""Largest number of joint actions for exact sums."""
MOST_FIRST = 2**31
"""Greatest number of an environment's first option: with all options it fits into 64 bits."""


@dataclass(frozen=True)
class Actions:
    """An action space as a policy sees it."""

    kind: Kind
    shape: tuple[int, ...]
    """Shape of one action of the environment: () for Discrete."""
    dtype: str
    adapter: Adapter = "native"
    sizes: tuple[int, ...] = ()
    """[A] options of each branch; empty for a Box."""
    start: tuple[int, ...] = ()
    """[A] the environment's number for option 0 of each branch."""
    low: tuple[float, ...] = ()
    """[A] lower bounds of a Box; -inf where there is none."""
    high: tuple[float, ...] = ()

    @property
    def count(self) -> int:
        """Number A of branches or dimensions."""
        return len(self.sizes) or len(self.low)

    @property
    def outputs(self) -> int:
        """Number of outputs of the policy's network: logits, means, or means and log standard deviations."""
        per_number = 2 if self.kind == "squashed" else 1
        return sum(self.sizes) if self.kind == "categorical" else per_number * self.count

    def joint_count(self, algorithm: str) -> int:
        """Return the number J of joint actions; raise `AlgorithmError` for more than an algorithm can sum over."""
        count = math.prod(self.sizes)
        if count > MOST_JOINT_ACTIONS:
            raise AlgorithmError(
                f"{algorithm} sums over all joint actions, of which this space has {count:,}, more than "
                f"{MOST_JOINT_ACTIONS:,}: use adapter='box_scaled'"
            )
        return count

    def uniform(self, count: int, generator: torch.Generator) -> Tensor:
        """Return uniformly distributed raw actions [count, A]: options, or numbers in -1..1."""
        drawn = torch.rand(count, self.count, dtype=torch.float32, generator=generator, device=generator.device)
        return (drawn * constant(self.sizes, drawn.device)).long() if self.kind == "categorical" else 2.0 * drawn - 1.0

    def distribution(self, parameters: Tensor) -> Distribution:
        """Return the policy's distribution at each state, from parameters [B, P]."""
        if self.kind == "categorical":
            return Categoricals.from_logits(parameters, self.sizes)
        if self.kind == "point":
            return Deterministic(parameters.tanh())
        return (SquashedGaussian if self.kind == "squashed" else Gaussians)(*parameters.chunk(2, dim=-1))

    def options(self, raw: Tensor) -> Tensor:
        """Return the options [N, A] int64 of a discrete space for raw actions [N, A]."""
        if self.kind == "categorical":
            return raw
        return gaussian.discretised(raw, constant(self.sizes, raw.device), scaled=self.adapter == "box_scaled")

    def quantised(self, raw: Tensor) -> Tensor:
        """Return the raw actions [N, A] that represent the executed actions, for which action values are learned.

        With `box_scaled` the middle of the bin that a number falls into. `box_literal` keeps the number, as the
        study's code does, and so leaves an action value that is constant in steps.
        """
        if self.adapter != "box_scaled":
            return raw
        return 2.0 * self.options(raw).to(raw.dtype) / (constant(self.sizes, raw.device) - 1).clamp(min=1) - 1.0

    def env_actions(self, raw: Tensor) -> Tensor:
        """Return actions [N, *shape] for the environment from raw actions [N, A]: int64, or float64 for a Box."""
        found = self.options(raw) + constant(self.start, raw.device) if self.sizes else self._within_bounds(raw)
        return found.view(-1, *self.shape)

    def to_numpy(self, raw: Tensor) -> np.ndarray:
        """Return the environment's actions as an array of the action space's dtype."""
        return self.env_actions(raw).cpu().numpy().astype(self.dtype)

    def _within_bounds(self, raw: Tensor) -> Tensor:
        """Return numbers clipped to the box; dimensions with two bounds map -1..1 to the whole range first."""
        low, high = (constant(bounds, raw.device, torch.float64) for bounds in (self.low, self.high))
        bounded = low.isfinite() & high.isfinite()
        below, above = torch.where(bounded, low, -1.0), torch.where(bounded, high, 1.0)
        return ((above + below) / 2 + (above - below) / 2 * raw).clamp(low, high)

    def as_data(self) -> dict[str, object]:
        """Return plain data for JSON, which `from_data` reads; infinite bounds become None."""
        bounds = {name: [x if np.isfinite(x) else None for x in getattr(self, name)] for name in ("low", "high")}
        lists = {name: list(getattr(self, name)) for name in ("shape", "sizes", "start")}
        return {"kind": self.kind, "dtype": self.dtype, "adapter": self.adapter, **lists, **bounds}

    @classmethod
    def from_data(cls, data: dict) -> "Actions":
        low = tuple(-np.inf if x is None else float(x) for x in data["low"])
        high = tuple(np.inf if x is None else float(x) for x in data["high"])
        lists = {name: tuple(int(x) for x in data[name]) for name in ("shape", "sizes", "start")}
        actions = cls(data["kind"], dtype=str(data["dtype"]), adapter=data["adapter"], low=low, high=high, **lists)
        if wrong := actions._error():
            raise AlgorithmError(f"the actions of a policy {wrong}")
        return actions

    def _error(self) -> str:
        """Return what does not fit together; empty for nothing."""
        if self.kind not in get_args(Kind) or self.adapter not in get_args(Adapter):
            return f"are {self.kind!r:.40} with the adapter {self.adapter!r:.40}, which this version does not know"
        if np.dtype(self.dtype).kind not in "iuf":
            return f"are of the type {self.dtype:.40}, which is no number"
        if any(size < 1 for size in self.sizes) or len(self.sizes) != len(self.start):
            return f"have {len(self.sizes)} branches of options, {len(self.start)} of them with a first one"
        if any(abs(first) > MOST_FIRST for first in self.start):
            return f"have a first option beyond ±{MOST_FIRST:,}"
        if len(self.low) != len(self.high) or not all(map(operator.le, self.low, self.high)):
            return "have bounds that do not fit together"
        if bool(self.sizes) == bool(self.low) or math.prod(self.shape) != self.count:
            return f"have the shape {self.shape} and {self.count} numbers"
        if (self.kind == "categorical") > bool(self.sizes):
            return "are options, but there are none"
        return ""


@cache
def constant(numbers: tuple[Any, ...], device: torch.device, dtype: torch.dtype = torch.int64) -> Tensor:
    """Return numbers [A] as a tensor, cached for each device."""
    # The first call may be in inference mode, but the cached tensor is used in learning too.
    with torch.inference_mode(False):
        return torch.tensor(numbers, dtype=dtype, device=device)


def actions_of(space: gym.Space, adapter: Adapter = "native", continuous: Kind = "gaussian") -> Actions:
    """Return the `Actions` of a single environment's action space.

    Args:
        space: Discrete, MultiDiscrete with one axis, or a Box of floats.
        adapter: For discrete spaces; a Box knows only `native`.
        continuous: The kind of policy for numbers; a discrete space without an adapter gets categorical choices.

    Raises `AlgorithmError` for a space or an adapter that is not supported.
    """
    if isinstance(space, gym.spaces.Box) and np.issubdtype(space.dtype, np.floating):
        if adapter != "native":
            raise AlgorithmError(f"the adapter {adapter!r} is for discrete actions, not for {space}")
        low, high = (tuple(float(x) for x in bound.reshape(-1)) for bound in (space.low, space.high))
        return Actions(continuous, space.shape, str(space.dtype), low=low, high=high)
    if isinstance(space, gym.spaces.Discrete):
        shape, sizes, start = (), (int(space.n),), (int(space.start),)
    elif isinstance(space, gym.spaces.MultiDiscrete) and space.nvec.ndim == 1:
        shape, sizes = space.shape, tuple(int(n) for n in space.nvec)
        start = tuple(int(n) for n in space.start)
    else:
        raise AlgorithmError(
            f"the action space must be Discrete, MultiDiscrete (one axis) or a Box of floats, not {space}"
        )
    if adapter not in ("native", "box_literal", "box_scaled"):
        raise AlgorithmError(f"the adapter is 'native', 'box_literal' or 'box_scaled', got {adapter!r}")
    kind = "categorical" if adapter == "native" else continuous
    return Actions(kind, shape, str(space.dtype), adapter, sizes, start)
