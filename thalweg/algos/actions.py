"""What does a network's output mean for the environment? One record per action space and head.

`raw` actions are what the algorithm learns from: the drawn options, or the continuous sample. `to_env` makes of
them what the environment executes.
"""

from dataclasses import dataclass
from typing import Literal

import gymnasium as gym
import numpy as np
import torch
from torch import Tensor

from thalweg.algos.distributions import Categoricals, Distribution, Gaussians
from thalweg.algos.errors import AlgorithmError
from thalweg.algos.maths import gaussian

Head = Literal["native", "gaussian_discretised"]
Kind = Literal["categorical", "gaussian", "gaussian_discretised"]


@dataclass(frozen=True)
class Actions:
    """An action space as a head sees it. A counts the branches of a discrete space or the numbers of a Box."""

    kind: Kind
    shape: tuple[int, ...]
    """Shape of one action of the environment: () for Discrete."""
    dtype: str
    sizes: tuple[int, ...] = ()
    """[A] options of each branch; empty for a Box."""
    start: tuple[int, ...] = ()
    """[A] the environment's number for option 0 of each branch."""
    low: tuple[float, ...] = ()
    """[A] lower bounds of a Box; -inf where there is none."""
    high: tuple[float, ...] = ()
    affine: bool = False
    """For the discretised Gaussian: whether a sample of 0 is the middle option."""

    @property
    def count(self) -> int:
        """A."""
        return len(self.sizes) or len(self.low)

    @property
    def outputs(self) -> int:
        """How many numbers the policy's network gives: logits, or means."""
        return sum(self.sizes) if self.kind == "categorical" else self.count

    def distribution(self, parameters: Tensor) -> Distribution:
        """The policy at each state, from parameters [B, P]: logits, or means and log standard deviations side by
        side."""
        if self.kind == "categorical":
            return Categoricals.from_logits(parameters, self.sizes)
        return Gaussians(*parameters.chunk(2, dim=-1))

    def to_env(self, raw: Tensor) -> np.ndarray:
        """Actions [N, *shape] for the environment, from raw ones [N, A]."""
        if self.kind == "gaussian":
            return self._within_bounds(raw.numpy()).reshape(-1, *self.shape).astype(self.dtype)
        if self.kind == "gaussian_discretised":
            raw = gaussian.discretised(raw, torch.tensor(self.sizes), affine=self.affine)
        return (raw.numpy() + np.asarray(self.start)).reshape(-1, *self.shape).astype(self.dtype)

    def _within_bounds(self, raw: np.ndarray) -> np.ndarray:
        """Clipped to the box; where it has both bounds, -1..1 spans it, so that a fresh policy reaches all of it."""
        low, high = np.asarray(self.low), np.asarray(self.high)
        bounded = np.isfinite(low) & np.isfinite(high)
        below, above = np.where(bounded, low, -1.0), np.where(bounded, high, 1.0)
        return np.clip((above + below) / 2 + (above - below) / 2 * raw, low, high)

    def as_data(self) -> dict[str, object]:
        """Plain data for JSON; `from_data` is its inverse. Infinite bounds become None."""
        bounds = {name: [x if np.isfinite(x) else None for x in getattr(self, name)] for name in ("low", "high")}
        lists = {name: list(getattr(self, name)) for name in ("shape", "sizes", "start")}
        return {"kind": self.kind, "dtype": self.dtype, "affine": self.affine, **lists, **bounds}

    @classmethod
    def from_data(cls, data: dict) -> "Actions":
        low = tuple(-np.inf if x is None else float(x) for x in data["low"])
        high = tuple(np.inf if x is None else float(x) for x in data["high"])
        lists = {name: tuple(int(x) for x in data[name]) for name in ("shape", "sizes", "start")}
        return cls(
            kind=data["kind"], dtype=str(data["dtype"]), affine=bool(data["affine"]), low=low, high=high, **lists
        )


def actions_of(space: gym.Space, head: Head = "native", affine: bool = False) -> Actions:
    """The record of a single environment's action space.

    Raises `AlgorithmError` for a space or a head that is not supported.
    """
    if isinstance(space, gym.spaces.Discrete):
        shape, sizes, start = (), (int(space.n),), (int(space.start),)
    elif isinstance(space, gym.spaces.MultiDiscrete) and space.nvec.ndim == 1:
        shape, sizes = space.shape, tuple(int(n) for n in space.nvec)
        start = tuple(int(n) for n in space.start)
    elif isinstance(space, gym.spaces.Box) and np.issubdtype(space.dtype, np.floating):
        if head != "native":
            raise AlgorithmError(f"the head {head!r} is for discrete actions, not for {space}")
        low, high = (tuple(float(x) for x in bound.reshape(-1)) for bound in (space.low, space.high))
        return Actions("gaussian", space.shape, str(space.dtype), low=low, high=high)
    else:
        raise AlgorithmError(
            f"the action space must be Discrete, MultiDiscrete (one axis) or a Box of floats, not {space}"
        )
    if head == "native":
        return Actions("categorical", shape, str(space.dtype), sizes, start)
    if head == "gaussian_discretised":
        return Actions("gaussian_discretised", shape, str(space.dtype), sizes, start, affine=affine)
    raise AlgorithmError(f"the head is 'native' or 'gaussian_discretised', got {head!r}")
