"""The networks: perceptrons of one shape, several of them computed as one, and their gradient in one go.

Small networks are bound by the number of calls, not by arithmetic. So all parameters of a stack lie in one vector,
which an optimiser, a target network and a checkpoint handle at once; its layers are batched products; and its gradient
is written out instead of being recorded call by call. `plain` is the same function as torch would differentiate it.
"""

import itertools
import math
from dataclasses import dataclass
from typing import Any, Literal

import torch
from torch import Tensor, nn

from thalweg.algos.actions import Actions
from thalweg.algos.memory import Gru, Sequences

Activation = Literal["tanh", "relu", "swish"]
Initial = Literal["orthogonal", "kaiming", "truncated"]
Layers = list[tuple[Tensor, Tensor]]
"""Weight [K, before, after] and bias [K, 1, after] of each layer."""
ALL = slice(None)


@dataclass(frozen=True)
class Shape:
    """What a policy's network and its critics are built like."""

    hidden: tuple[int, ...] = (64, 64)
    activation: Activation = "tanh"
    initial: Initial = "orthogonal"
    memory: int = 0
    """Numbers of the recurrent state; 0: none."""


def orthogonal(shape: tuple[int, int], gain: float, generator: torch.Generator) -> Tensor:
    """A matrix with orthonormal rows or columns, times `gain` (Saxe et al. 2014)."""
    weight = torch.empty(shape)
    nn.init.orthogonal_(weight, gain, generator=generator)
    return weight


class Stack(nn.Module):
    """K separate perceptrons of the same shape, [B, D] or [K, B, D] -> [K, B, outputs], computed together.

    Each layer is x W + b, with W [K, before, after] and b [K, 1, after], all in the vector `flat`.
    """

    def __init__(
        self,
        count: int,
        inputs: int,
        hidden: tuple[int, ...],
        outputs: int,
        *,
        generator: torch.Generator,
        last_gain: float = 1.0,
        activation: Activation = "tanh",
        initial: Initial = "orthogonal",
    ) -> None:
        """Orthogonal weights and zero biases (gain √2, and `last_gain` for the last layer); "kaiming": everything
        uniform within ±1/√before, as torch starts its own layers; "truncated": weights from a normal distribution of
        deviation 1/(2√before), cut off at two of them, and zero biases."""
        super().__init__()
        self.count, self.activation = count, activation
        self.sizes = (inputs, *hidden, outputs)
        self.flat = nn.Parameter(
            torch.empty(sum(count * (before + 1) * after for before, after in itertools.pairwise(self.sizes)))
        )
        self._views: tuple[int, Layers] = (0, [])
        with torch.no_grad():
            for layer, (weight, bias) in enumerate(self.layers):
                before, after = weight.shape[1:]
                gain = last_gain if layer == len(hidden) else math.sqrt(2.0)
                bound = 1 / math.sqrt(before)
                for k in range(count):
                    if initial == "orthogonal":
                        weight[k] = orthogonal((before, after), gain, generator)
                    elif initial == "truncated":
                        nn.init.trunc_normal_(weight[k], 0.0, bound / 2, -bound, bound, generator=generator)
                    else:
                        weight[k].uniform_(-bound, bound, generator=generator)
                        bias[k].uniform_(-bound, bound, generator=generator)
                if initial != "kaiming":
                    bias.zero_()

    def forward(self, x: Tensor, frozen: bool = False, chosen: slice = ALL) -> Tensor:
        """[K, B, outputs]; `frozen`: as if the parameters were constants, while x may have a gradient; `chosen`: of
        these perceptrons only."""
        flat = self.flat.detach() if frozen else self.flat
        return _Perceptrons.apply(x, flat, self.layers, self.sizes, chosen, self.activation)  # pyright: ignore

    def plain(self, x: Tensor, flat: Tensor | None = None) -> Tensor:
        """The same by recorded calls, which can be differentiated twice; `flat` stands for the own parameters."""
        x = x.expand(self.count, *x.shape) if x.dim() == 2 else x
        *inner, (last_weight, last_bias) = layers_of(self.flat if flat is None else flat, self.count, self.sizes)
        for weight, bias in inner:
            x = _FUNCTIONS[self.activation](torch.baddbmm(bias, x, weight))
        return torch.baddbmm(last_bias, x, last_weight)

    @property
    def layers(self) -> Layers:
        """The layers as views of the vector without its gradient, made once for each place that it lies in."""
        place = self.flat.data_ptr()
        if self._views[0] != place:
            self._views = (place, layers_of(self.flat.detach(), self.count, self.sizes))
        return self._views[1]


def layers_of(flat: Tensor, count: int, sizes: tuple[int, ...]) -> Layers:
    """Weight [K, before, after] and bias [K, 1, after] of each layer of K perceptrons: views of their vector."""
    lengths = [
        length for before, after in itertools.pairwise(sizes) for length in (count * before * after, count * after)
    ]
    pieces = iter(flat.split(lengths))
    return [
        (next(pieces).view(count, before, after), next(pieces).view(count, 1, after))
        for before, after in itertools.pairwise(sizes)
    ]


class _Perceptrons(torch.autograd.Function):
    """The stack and its gradient: the chain rule layer by layer, into one vector."""

    @staticmethod
    def forward(
        ctx: Any, x: Tensor, flat: Tensor, parts: Layers, sizes: tuple[int, ...], chosen: slice, activation: Activation
    ) -> Tensor:
        ctx.count, ctx.sizes, ctx.chosen, ctx.activation = len(parts[0][0]), sizes, chosen, activation
        parts = ctx.parts = _chosen(parts, chosen)
        ctx.shared = x.dim() == 2
        hidden = x.expand(len(parts[0][0]), *x.shape) if ctx.shared else x
        seen, before = [hidden], []
        for weight, bias in parts[:-1]:
            hidden = torch.baddbmm(bias, hidden, weight)
            if activation == "swish":
                before.append(hidden)  # its derivative does not follow from its value alone
                hidden = nn.functional.silu(hidden)
            else:
                hidden = hidden.tanh_() if activation == "tanh" else hidden.relu_()
            seen.append(hidden)
        ctx.save_for_backward(flat, *seen, *before)
        return torch.baddbmm(parts[-1][1], hidden, parts[-1][0])

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, above: Tensor) -> Any:  # pyright: ignore
        flat, *seen = ctx.saved_tensors  # which makes sure that nothing has changed since
        inner = len(ctx.sizes) - 2
        known = seen[-inner:] if inner else []
        wants_x, wants_flat = ctx.needs_input_grad[:2]
        parts: Layers = ctx.parts
        into = (torch.empty_like if len(above) == ctx.count else torch.zeros_like)(flat) if wants_flat else None
        places = _chosen(layers_of(into, ctx.count, ctx.sizes), ctx.chosen) if into is not None else []
        for layer in range(len(parts) - 1, -1, -1):
            if into is not None:
                torch.bmm(seen[layer].transpose(1, 2), above, out=places[layer][0])
                torch.sum(above, 1, keepdim=True, out=places[layer][1])
            if layer == 0 and not wants_x:
                return None, into, None, None, None, None
            above = torch.bmm(above, parts[layer][0].transpose(1, 2))
            if layer > 0:
                _DERIVATIVES[ctx.activation](above, known[layer - 1], above)
        return above.sum(0) if ctx.shared else above, into, None, None, None, None


def _through(above: Tensor, after: Tensor, activation: Activation) -> None:
    """Pass a gradient through an activation of which the outcome is given, in place."""
    if activation == "tanh":
        torch.ops.aten.tanh_backward.grad_input(above, after, grad_input=above)
    else:
        torch.ops.aten.threshold_backward.grad_input(above, after, 0.0, grad_input=above)


def _chosen(layers: Layers, chosen: slice) -> Layers:
    return layers if chosen is ALL else [(weight[chosen], bias[chosen]) for weight, bias in layers]


def _through_tanh(above: Tensor, after: Tensor, into: Tensor) -> None:
    torch.ops.aten.tanh_backward.grad_input(above, after, grad_input=into)


def _through_relu(above: Tensor, after: Tensor, into: Tensor) -> None:
    torch.ops.aten.threshold_backward.grad_input(above, after, 0.0, grad_input=into)


def _through_swish(above: Tensor, before: Tensor, into: Tensor) -> None:
    torch.ops.aten.silu_backward.grad_input(above, before, grad_input=into)


_FUNCTIONS = {"tanh": torch.tanh, "relu": torch.relu, "swish": nn.functional.silu}
_DERIVATIVES = {"tanh": _through_tanh, "relu": _through_relu, "swish": _through_swish}
"""From the gradient after each, and what it gave (of "swish": what it was given), to the gradient before it."""


class Actor(nn.Module):
    """Parameters [B, P] of the policy at each state, from observations [B, D] or from sequences.

    They are logits, or means, or whatever `actions` says; where the policy is a Gaussian, its log standard deviations
    stand beside the means and are the same in every state.
    """

    def __init__(self, inputs: int, actions: Actions, shape: Shape, generator: torch.Generator) -> None:
        super().__init__()
        self.gru = Gru(inputs, shape.memory, generator) if shape.memory else None
        # A last layer near zero: the first policy draws every option alike whatever it sees.
        self.stack = Stack(
            1,
            inputs + shape.memory,
            shape.hidden,
            actions.outputs,
            last_gain=0.01,
            activation=shape.activation,
            initial=shape.initial,
            generator=generator,
        )
        self.log_std = nn.Parameter(torch.zeros(actions.count)) if actions.kind == "gaussian" else None

    def forward(self, inputs: Tensor | Sequences, plain: bool = False) -> Tensor:
        """`plain`: so that it can be differentiated twice."""
        features = _features(self.gru, inputs, "actor")
        outputs = (self.stack.plain if plain else self.stack)(features)[0]
        return outputs if self.log_std is None else torch.cat([outputs, self.log_std.expand_as(outputs)], -1)

    def step(self, obs: Tensor, state: Tensor, fresh: Tensor) -> tuple[Tensor, Tensor]:
        """Parameters [N, P] and the recurrent state after observations [N, D]."""
        assert self.gru is not None
        state = self.gru.step(obs, state, fresh)
        return self(torch.cat([obs, state], -1)), state


class Critics(nn.Module):
    """`count` separate perceptrons with one output each, [B, D] or sequences -> [count, B], computed together.

    With a memory they share one recurrent network.
    """

    def __init__(self, count: int, inputs: int, shape: Shape, generator: torch.Generator) -> None:
        super().__init__()
        self.count = count
        self.gru = Gru(inputs, shape.memory, generator) if shape.memory else None
        self.stack = Stack(
            count,
            inputs + shape.memory,
            shape.hidden,
            1,
            activation=shape.activation,
            initial=shape.initial,
            generator=generator,
        )

    def forward(self, inputs: Tensor | Sequences) -> Tensor:
        return self.stack(_features(self.gru, inputs, "critics")).squeeze(-1)


def _features(gru: Gru | None, inputs: Tensor | Sequences, name: str) -> Tensor:
    """What the perceptron sees: the observations, or features [B, D + M] (a tensor is taken to be features already)."""
    if isinstance(inputs, Tensor):
        return inputs
    assert gru is not None
    return gru.features(inputs, name)
