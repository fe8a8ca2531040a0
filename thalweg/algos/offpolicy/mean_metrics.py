"""Means of metrics over the gradient steps between two reports, part of the training state."""

from typing import Any

import torch
from torch import Tensor

from thalweg.algos.common.errors import require_finite
from thalweg.algos.common.state import CPU, array_of, tensor_of


class MeanMetrics:
    """Sums of a few numbers per gradient step, by the names that they are reported under."""

    def __init__(self, *groups: tuple[str, ...], device: torch.device = CPU) -> None:
        """The numbers of a group are added together; a gradient step need not add every group."""
        self.groups = groups
        self._sums = [torch.zeros(len(group), dtype=torch.float32, device=device) for group in groups]
        self._counts = [0] * len(groups)

    def add(self, group: int, numbers: Tensor) -> None:
        """Add one gradient step's numbers of a group, without gradient; `count` counts the step.

        The two are apart because a CUDA graph replays only the addition.
        """
        self._sums[group] += numbers

    def count(self, group: int) -> None:
        """Count one gradient step of a group."""
        self._counts[group] += 1

    def require_finite(self) -> None:
        """Raises `NotFiniteError` naming the first number that has been NaN or infinite since the last report."""
        for group, sums in zip(self.groups, self._sums, strict=True):
            require_finite(**dict(zip(group, sums.tolist(), strict=True)))

    def report(self) -> dict[str, float]:
        """Return the means since the last report, NaN without any gradient step, and start anew."""
        means: dict[str, float] = {}
        for group, sums, count in zip(self.groups, self._sums, self._counts, strict=True):
            values = (sums / count).tolist() if count else [float("nan")] * len(group)
            means |= dict(zip(group, values, strict=True))
            sums.zero_()
        self._counts = [0] * len(self.groups)
        return means

    def state(self) -> dict[str, Any]:
        """Return the state as arrays and plain data."""
        return {"counts": list(self._counts)} | {str(k): array_of(sums) for k, sums in enumerate(self._sums)}

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        self._counts = [int(count) for count in state["counts"]]
        self._sums = [tensor_of(state[str(k)], sums.device) for k, sums in enumerate(self._sums)]
