"""The networks: small perceptrons, and several critics computed as one.

Small networks are bound by the number of calls, not by arithmetic: the reward critic and the cost critics are one
stack of matrices and cost one batched product a layer.
"""

import itertools
import math

import torch
from torch import Tensor, nn


def orthogonal(shape: tuple[int, int], gain: float, generator: torch.Generator) -> Tensor:
    """A matrix with orthonormal rows or columns, times `gain` (Saxe et al. 2014)."""
    weight = torch.empty(shape)
    nn.init.orthogonal_(weight, gain, generator=generator)
    return weight


class Perceptron(nn.Module):
    """A tanh perceptron [B, D] -> [B, outputs]; orthogonal weights, zero biases."""

    def __init__(
        self, inputs: int, hidden: tuple[int, ...], outputs: int, last_gain: float, generator: torch.Generator
    ) -> None:
        super().__init__()
        sizes = [inputs, *hidden]
        layers: list[nn.Module] = []
        for before, after in itertools.pairwise(sizes):
            layers += [self._linear(before, after, math.sqrt(2.0), generator), nn.Tanh()]
        self.layers = nn.Sequential(*layers, self._linear(sizes[-1], outputs, last_gain, generator))

    @staticmethod
    def _linear(before: int, after: int, gain: float, generator: torch.Generator) -> nn.Linear:
        # Torch's own start would draw from its global generator, and so change what others draw.
        layer = nn.Linear(before, after, device="meta").to_empty(device="cpu")
        with torch.no_grad():
            layer.weight.copy_(orthogonal((after, before), gain, generator))
            layer.bias.zero_()
        return layer

    def forward(self, x: Tensor) -> Tensor:
        return self.layers(x)


class Critics(nn.Module):
    """`count` separate tanh perceptrons with one output each, [B, D] -> [count, B], computed together."""

    def __init__(self, count: int, inputs: int, hidden: tuple[int, ...], generator: torch.Generator) -> None:
        super().__init__()
        self.count = count
        sizes = [inputs, *hidden, 1]
        gains = [math.sqrt(2.0)] * len(hidden) + [1.0]
        weights = [
            torch.stack([orthogonal((before, after), gain, generator) for _ in range(count)])
            for (before, after), gain in zip(itertools.pairwise(sizes), gains, strict=True)
        ]
        self.weights = nn.ParameterList(weights)
        self.biases = nn.ParameterList([torch.zeros(count, 1, size) for size in sizes[1:]])

    def forward(self, x: Tensor) -> Tensor:
        hidden = x.expand(self.count, *x.shape)
        layers = list(zip(self.weights, self.biases, strict=True))
        for weight, bias in layers[:-1]:
            hidden = torch.baddbmm(bias, hidden, weight).tanh()
        return torch.baddbmm(layers[-1][1], hidden, layers[-1][0]).squeeze(-1)
