"""What did the gradient steps since the last report say? Their means, which an interruption must not change."""

from typing import Any

import torch
from torch import Tensor

from thalweg.algos.common.errors import require_finite
from thalweg.algos.common.state import CPU, array_of, tensor_of


class Tally:
    """Sums of a few numbers of each gradient step, by the names that they are reported under."""

    def __init__(self, *groups: tuple[str, ...], device: torch.device = CPU) -> None:
        """The numbers of a group come together, but not every group with every gradient step."""
        self.groups = groups
        self._sums = [torch.zeros(len(group), device=device) for group in groups]
        self._counts = [0] * len(groups)

    def add(self, group: int, numbers: Tensor) -> None:
        """One gradient step's numbers of a group, without gradient; `count` counts it."""
        self._sums[group] += numbers

    def count(self, group: int) -> None:
        """A gradient step has given numbers of a group."""
        self._counts[group] += 1

    def require_finite(self) -> None:
        """Raises `NotFiniteError` naming the first number that has been NaN or infinite since the last report."""
        for group, sums in zip(self.groups, self._sums, strict=True):
            require_finite(**dict(zip(group, sums.tolist(), strict=True)))

    def report(self) -> dict[str, float]:
        """The means since the last report, NaN where there was nothing."""
        means: dict[str, float] = {}
        for group, sums, count in zip(self.groups, self._sums, self._counts, strict=True):
            values = (sums / count).tolist() if count else [float("nan")] * len(group)
            means |= dict(zip(group, values, strict=True))
            sums.zero_()
        self._counts = [0] * len(self.groups)
        return means

    def state(self) -> dict[str, Any]:
        """Arrays and plain data."""
        return {"counts": list(self._counts)} | {str(k): array_of(sums) for k, sums in enumerate(self._sums)}

    def load_state(self, state: dict[str, Any]) -> None:
        """The inverse of `state`."""
        self._counts = [int(count) for count in state["counts"]]
        self._sums = [tensor_of(state[str(k)], sums.device) for k, sums in enumerate(self._sums)]
