"""Normalisation of observations by running statistics."""

import numpy as np
import torch
from torch import Tensor

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.common.state import CPU, array_of, tensor_of
from thalweg.algos.policy.option_sampling import Scaling

CLIP = 5.0
"""Normalised observations are clipped to this many standard deviations."""
STD_FLOOR = 0.01
"""Smallest standard deviation, so that numbers that hardly vary are scaled by at most 1 / this."""
CONSTANT_STD = 1e-5
"""Numbers that have varied by no more than this are ignored: nothing was learnt about them, so that another value, seen
later, must not reach the network, least of all `CLIP` deviations large."""
ROUNDING = 1e-6
"""Standard deviation, as a share of the mean, up to which numbers in float32 vary by rounding alone."""


class Normaliser:
    """Standardises D numbers by their running mean and variance; the identity if disabled or before the first update.

    Acting does not change the statistics, so an evaluation uses those of training.
    """

    def __init__(self, size: int, enabled: bool = True, device: torch.device = CPU) -> None:
        self.enabled = enabled
        self.count = 0
        self.mean = torch.zeros(size, dtype=torch.float64, device=device)
        self.square = torch.zeros_like(self.mean)
        """Sum of squared differences from the mean, float64 [D]."""
        self._shift, self._scale = (
            torch.zeros(size, dtype=torch.float32, device=device),
            torch.ones(size, dtype=torch.float32, device=device),
        )

    def __call__(self, obs: Tensor) -> Tensor:
        """Return normalised observations [B, D]."""
        if not self.enabled or self.count == 0:
            return obs
        return ((obs - self._shift) * self._scale).clamp_(-CLIP, CLIP)

    def arrays(self) -> Scaling:
        """Return what a call computes with, as compiled loops take it; for a normaliser on the CPU."""
        if not self.enabled or self.count == 0:
            size = len(self.mean)
            return Scaling(np.zeros(size, np.float32), np.ones(size, np.float32), np.finfo(np.float32).max)
        return Scaling(self._shift.numpy(), self._scale.numpy(), np.float32(CLIP))

    def update(self, obs: Tensor) -> None:
        """Add observations [B, D] to the statistics (Chan, Golub, LeVeque 1983: statistics of two sets combined)."""
        if not self.enabled or len(obs) == 0:
            return
        batch = obs.double()
        mean, count = batch.mean(0), len(batch)
        total = self.count + count
        apart = mean - self.mean
        self.square = self.square + ((batch - mean) ** 2).sum(0) + apart**2 * self.count * count / total
        self.mean = self.mean + apart * count / total
        self.count = total
        self._refresh()

    @property
    def scale(self) -> Tensor:
        """Factor [D] by which differences of observations are multiplied."""
        return self._scale if self.enabled and self.count else torch.ones_like(self._scale)

    @property
    def ignored(self) -> Tensor:
        """[D] bool, which numbers never reached the network, because they have not varied (`CONSTANT_STD`)."""
        return self.scale == 0.0

    @property
    def overlooked(self) -> Tensor:
        """[D] bool, which of the ignored numbers do vary, only by little in their unit."""
        return self.ignored & (self._std > ROUNDING * self.mean.abs())

    def state(self) -> dict:
        """Return the statistics as arrays and plain data."""
        moments = {"mean": array_of(self.mean), "square": array_of(self.square)}
        return {"count": self.count, "enabled": self.enabled, **moments}

    def load_state(self, state: dict) -> None:
        """Restore what `state` returned; raises `AlgorithmError` if the size differs."""
        if np.shape(state["mean"]) != tuple(self.mean.shape):
            raise AlgorithmError(
                f"a normaliser of {len(self.mean)} numbers can't take one of {np.shape(state['mean'])}"
            )
        if np.shape(state["square"]) != tuple(self.mean.shape) or (np.asarray(state["square"]) < 0).any():
            raise AlgorithmError(f"a normaliser's squares must be {len(self.mean)} numbers of at least 0")
        if int(state["count"]) < 0:
            raise AlgorithmError(f"a normaliser's count must be at least 0, got {state['count']}")
        self.count, self.enabled = int(state["count"]), bool(state["enabled"])
        self.mean, self.square = (tensor_of(state[name], self.mean.device).double() for name in ("mean", "square"))
        self._refresh()

    @property
    def _std(self) -> Tensor:
        return (self.square / max(self.count, 1)).sqrt()

    def _refresh(self) -> None:
        std = self._std
        scale = torch.where(std > CONSTANT_STD, 1.0 / std.clamp(min=STD_FLOOR), 0.0)
        self._shift, self._scale = self.mean.float(), scale.float()
