"""Adam without what stands around it: torch's own fused kernel on a few vectors of parameters.

torch.optim.Adam calls the same kernel, after some 50 µs of looking after cases that do not occur here; a gradient step
of a small network takes a few hundred. A test holds the two together to the last bit.
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
        self._counts = [torch.zeros((), device=parameter.device) for parameter in self.parameters]
        self._rate_there: Tensor | None = None
        """The rate on a GPU, so that steps that were recorded follow it."""
        if not self.parameters[0].is_cpu:
            self._rate_there = torch.full((), rate, device=self.parameters[0].device)

    @property
    def rate(self) -> float:
        """The learning rate."""
        return self._rate

    @rate.setter
    def rate(self, rate: float) -> None:
        if self._rate_there is not None and rate != self._rate:
            self._rate_there.fill_(rate)
        self._rate = rate

    @torch.no_grad()
    def step(self, most: float = math.inf) -> None:
        """One step down the gradients, shortened together to the length `most`; without all of them nothing moves."""
        gradients = [parameter.grad for parameter in self.parameters if parameter.grad is not None]
        if len(gradients) < len(self.parameters):
            return
        clip_grad_norm_(gradients, most)
        torch._foreach_add_(self._counts, 1.0)  # pyright: ignore[reportPrivateImportUsage]
        torch._fused_adam_(  # pyright: ignore[reportPrivateImportUsage]
            self.parameters,
            gradients,
            self._first,
            self._second,
            [],
            self._counts,
            lr=self._rate if self._rate_there is None else self._rate_there,  # pyright: ignore[reportArgumentType]
            beta1=0.9,
            beta2=0.999,
            weight_decay=0.0,
            eps=1e-8,
            amsgrad=False,
            maximize=False,
        )

    def arrays(self) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
        """Parameters, both means and counts of steps, each a list by parameter: the memory itself, to be written to."""
        kinds = (self.parameters, self._first, self._second, self._counts)
        values, first, second, counts = ([tensor.detach().numpy() for tensor in kind] for kind in kinds)
        return values, first, second, counts

    def zero_grad(self) -> None:
        """Begin a new gradient."""
        for parameter in self.parameters:
            parameter.grad = None

    def state(self) -> dict[str, Any]:
        """A copy of what it remembers of each parameter, by the parameter's number."""
        return {
            str(number): {"first": array_of(first), "second": array_of(second), "count": float(count)}
            for number, (first, second, count) in enumerate(zip(self._first, self._second, self._counts, strict=True))
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """The inverse of `state`; the rate stays as it is."""
        for number, remembered in state.items():
            place = int(number)
            self._first[place].copy_(tensor_of(remembered["first"], CPU))
            self._second[place].copy_(tensor_of(remembered["second"], CPU))
            self._counts[place].fill_(remembered["count"])


def clip_grad_norm_(gradients: list[Tensor], most: float) -> None:
    """Scale gradients, in place, so that together they are no longer than `most`."""
    if most == math.inf:
        return
    lengths = [torch.linalg.vector_norm(gradient) for gradient in gradients]
    if gradients[0].is_cpu:
        length = math.hypot(*(float(each) for each in lengths))
        if length > most:
            for gradient in gradients:
                gradient.mul_(most / (length + 1e-6))
    else:  # without waiting for a GPU to say how long they are
        length = torch.linalg.vector_norm(torch.stack(lengths))
        share = torch.where(length > most, most / (length + 1e-6), 1.0)
        for gradient in gradients:
            gradient.mul_(share)
