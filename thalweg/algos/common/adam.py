"""Adam on a few vectors of parameters, by a direct call of torch's fused kernel.

torch.optim.Adam calls the same kernel after some 50 µs of handling cases that do not occur here, while a gradient step
of a small network takes a few hundred. A test compares the two bit by bit.
"""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import torch
from torch import Tensor

from thalweg.algos.common.state import CPU, array_of, tensor_of


class Adam:
    """Adam (Kingma, Ba 2015, algorithm 1) on some parameters, with β₁ = 0.9, β₂ = 0.999, ε = 1e-8."""

    def __init__(self, parameters: Iterable[Tensor], rate: float) -> None:
        self.parameters, self._rate = list(parameters), rate
        self._first = [torch.zeros_like(parameter) for parameter in self.parameters]
        self._second = [torch.zeros_like(parameter) for parameter in self.parameters]
        self._counts = [torch.zeros((), dtype=torch.float32, device=parameter.device) for parameter in self.parameters]
        self._device_rate: Tensor | None = None
        """The rate on the GPU, which steps in a CUDA graph read."""
        if not self.parameters[0].is_cpu:
            self._device_rate = torch.full((), rate, dtype=torch.float32, device=self.parameters[0].device)

    @property
    def rate(self) -> float:
        """The learning rate."""
        return self._rate

    @rate.setter
    def rate(self, rate: float) -> None:
        if self._device_rate is not None and rate != self._rate:
            self._device_rate.fill_(rate)
        self._rate = rate

    @torch.no_grad()
    def step(self, max_norm: float = math.inf) -> None:
        """Take one step, with the gradients clipped together to the norm `max_norm`; do nothing if any is missing."""
        gradients = [parameter.grad for parameter in self.parameters if parameter.grad is not None]
        if len(gradients) < len(self.parameters):
            return
        clip_grad_norm_(gradients, max_norm)
        torch._foreach_add_(self._counts, 1.0)  # pyright: ignore[reportPrivateImportUsage]
        torch._fused_adam_(  # pyright: ignore[reportPrivateImportUsage]
            self.parameters,
            gradients,
            self._first,
            self._second,
            [],
            self._counts,
            lr=self._rate if self._device_rate is None else self._device_rate,  # pyright: ignore[reportArgumentType]
            beta1=0.9,
            beta2=0.999,
            weight_decay=0.0,
            eps=1e-8,
            amsgrad=False,
            maximize=False,
        )

    def arrays(self) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
        """Return parameters, both means and counts of steps, each a list by parameter; writing to them changes it."""
        kinds = (self.parameters, self._first, self._second, self._counts)
        values, first, second, counts = ([tensor.detach().numpy() for tensor in kind] for kind in kinds)
        return values, first, second, counts

    def zero_grad(self) -> None:
        """Drop the gradients."""
        for parameter in self.parameters:
            parameter.grad = None

    def state(self) -> dict[str, Any]:
        """Return a copy of the means and the count of each parameter, by the parameter's number."""
        return {
            str(number): {"first": array_of(first), "second": array_of(second), "count": float(count)}
            for number, (first, second, count) in enumerate(zip(self._first, self._second, self._counts, strict=True))
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned; the learning rate is not part of it."""
        for number, saved in state.items():
            index = int(number)
            self._first[index].copy_(tensor_of(saved["first"], CPU))
            self._second[index].copy_(tensor_of(saved["second"], CPU))
            self._counts[index].fill_(saved["count"])


def clip_grad_norm_(gradients: list[Tensor], max_norm: float) -> None:
    """Scale gradients in place so that their joint norm is at most `max_norm`."""
    if max_norm == math.inf:
        return
    lengths = [torch.linalg.vector_norm(gradient) for gradient in gradients]
    if gradients[0].is_cpu:
        length = math.hypot(*(float(each) for each in lengths))
        if length > max_norm:
            for gradient in gradients:
                gradient.mul_(max_norm / (length + 1e-6))
    else:  # the length stays on the GPU, so that the host need not wait for it
        length = torch.linalg.vector_norm(torch.stack(lengths))
        share = torch.where(length > max_norm, max_norm / (length + 1e-6), 1.0)
        for gradient in gradients:
            gradient.mul_(share)
