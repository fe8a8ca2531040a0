"""How do observations come to have mean 0 and standard deviation 1? Running statistics that learning alone updates."""

import numpy as np
import torch
from torch import Tensor

from thalweg.algos.errors import AlgorithmError

CLIP = 5.0
"""Normalised observations are clipped to this many standard deviations."""
STD_FLOOR = 0.01
"""A number that hardly varies is not blown up beyond 1 / this."""


class Normaliser:
    """Running mean and variance of D numbers; the identity while it has seen nothing or is switched off.

    Acting never changes it, so an evaluation uses the statistics of training.
    """

    def __init__(self, size: int, enabled: bool = True) -> None:
        self.enabled = enabled
        self.count = 0
        self.mean = np.zeros(size)
        self.square = np.zeros(size)
        """Sum of squared differences from the mean, float64 [D]."""
        self._shift, self._scale = torch.zeros(size), torch.ones(size)

    def __call__(self, obs: Tensor) -> Tensor:
        """Normalised observations [B, D]."""
        if not self.enabled or self.count == 0:
            return obs
        return ((obs - self._shift) * self._scale).clamp_(-CLIP, CLIP)

    def update(self, obs: Tensor) -> None:
        """Take in observations [B, D] (Chan, Golub, LeVeque 1983: statistics of two sets joined)."""
        if not self.enabled or len(obs) == 0:
            return
        batch = obs.numpy().astype(np.float64)
        mean, count = batch.mean(0), len(batch)
        total = self.count + count
        apart = mean - self.mean
        self.square = self.square + ((batch - mean) ** 2).sum(0) + apart**2 * self.count * count / total
        self.mean = self.mean + apart * count / total
        self.count = total
        self._refresh()

    @property
    def scale(self) -> Tensor:
        """[D] by which differences of observations are multiplied."""
        return self._scale if self.enabled and self.count else torch.ones_like(self._scale)

    def state(self) -> dict:
        """Everything, as arrays and plain data."""
        return {"count": self.count, "enabled": self.enabled, "mean": self.mean, "square": self.square}

    def load_state(self, state: dict) -> None:
        """The inverse of `state`; raises `AlgorithmError` if the size differs."""
        if np.shape(state["mean"]) != self.mean.shape:
            raise AlgorithmError(
                f"a normaliser of {len(self.mean)} numbers can't take one of {np.shape(state['mean'])}"
            )
        self.count, self.enabled = int(state["count"]), bool(state["enabled"])
        self.mean = np.array(state["mean"], dtype=np.float64)
        self.square = np.array(state["square"], dtype=np.float64)
        self._refresh()

    def _refresh(self) -> None:
        std = np.maximum(np.sqrt(self.square / max(self.count, 1)), STD_FLOOR)
        self._shift, self._scale = torch.from_numpy(self.mean).float(), torch.from_numpy(1.0 / std).float()
