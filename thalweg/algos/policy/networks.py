"""The networks: perceptrons of one shape, several of them computed as one, and their gradient in one go.

Small networks are bound by the number of calls, not by arithmetic. So all parameters of a stack lie in one vector,
which an optimiser, a target network and a checkpoint handle at once; its layers are batched products; and its gradient
is written out instead of being recorded call by call. `reference` is the same function as torch would differentiate it.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from torch import Tensor, nn

from thalweg.algos.common.adam import Adam
from thalweg.algos.maths import losses
from thalweg.algos.policy import mlp_autograd as chain
from thalweg.algos.policy import mlp_numba as loops
from thalweg.algos.policy.actions import Actions
from thalweg.algos.policy.memory import Gru, Sequences
from thalweg.algos.policy.mlp_autograd import ALL, FUNCTIONS, Activation, Layers, LayerViews, MLPFunction, layers_of

Initial = Literal["orthogonal", "kaiming", "truncated"]
SMALL = 128
"""Numbers of a layer up to which compiled loops are faster than a library's products."""
ROWS = 1024


@dataclass(frozen=True)
class NetworkShape:
    """What a policy's network and its critics are built like."""

    hidden: tuple[int, ...] = (64, 64)
    activation: Activation = "tanh"
    initial: Initial = "orthogonal"
    memory: int = 0
    """Numbers of the recurrent state; 0: none."""


def orthogonal(shape: tuple[int, int], gain: float, generator: torch.Generator) -> Tensor:
    """A matrix with orthonormal rows or columns, times `gain` (Saxe et al. 2014)."""
    weight = torch.empty(shape, device=generator.device)
    nn.init.orthogonal_(weight, gain, generator=generator)
    return weight


class StackedMLP(nn.Module):
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
        self.count = count
        self.activation: Activation = activation
        self.sizes = (inputs, *hidden, outputs)
        length = sum(count * (before + 1) * after for before, after in itertools.pairwise(self.sizes))
        self.flat = nn.Parameter(torch.empty(length, device=generator.device))
        self._views: dict[str, LayerViews] = {}
        self.sizes_array, self.code = np.array(self.sizes), loops.TANH if activation == "tanh" else loops.RELU
        self.small = activation != "swish" and max(self.sizes) <= SMALL
        """Whether compiled loops compute it, if it is asked for on a CPU."""
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

    def forward(self, x: Tensor, frozen: bool = False) -> Tensor:
        """[K, B, outputs]; `frozen`: as if the parameters were constants, while x may have a gradient."""
        flat = self.flat.detach() if frozen else self.flat
        if not (torch.is_grad_enabled() and (x.requires_grad or flat.requires_grad)):
            return chain.outputs(x, self.parts, self.activation)[0]
        return MLPFunction.apply(x, flat, self.parts, self.sizes, self.activation)  # pyright: ignore

    @torch.no_grad()
    def forward_and_backward(self, x: Tensor) -> tuple[Tensor, Callable[[Tensor], None]]:
        """[K, B, outputs] without a record, and what is to be called with their gradient: it leaves that of the
        parameters in `flat.grad`, in place of what was there. For a step that torch need not keep books of."""
        if self.small and x.dim() == 2 and x.dtype == torch.float32 and x.is_cpu:
            return self._ahead_in_loops(x)
        parts = self.parts
        outputs, trace = chain.outputs(x, parts, self.activation)

        @torch.no_grad()
        def back(above: Tensor) -> None:
            slopes = self._cut("slopes", self._slopes())
            chain.gradients(above, trace, parts, slopes, self.activation, wants_x=False)

        return outputs, back

    @torch.no_grad()
    def forward_and_input_backward(self, x: Tensor, chosen: slice = ALL) -> tuple[Tensor, Callable[[Tensor], Tensor]]:
        """[K, B, outputs] of rows [B, D] without a record, of these perceptrons, as if they were constants; and what
        gives from their gradient that of the rows [B, D]."""
        parts = self.parts.some(chosen)
        outputs, trace = chain.outputs(x, parts, self.activation)

        @torch.no_grad()
        def back(above: Tensor) -> Tensor:
            below = chain.gradients(above, trace, parts, None, self.activation, wants_x=True)
            assert below is not None
            return below.sum(0)

        return outputs, back

    def _ahead_in_loops(self, x: Tensor) -> tuple[Tensor, Callable[[Tensor], None]]:
        sizes, activation = self.sizes_array, self.code
        seen, flat = x.contiguous().numpy(), self.flat.detach().numpy()
        hidden = np.empty((self.count, len(x) * sum(self.sizes[1:-1])), np.float32)
        found = np.empty((self.count, len(x), self.sizes[-1]), np.float32)
        loops.outputs(seen, flat, sizes, activation, hidden, found)

        def back(above: Tensor) -> None:
            slopes = self._slopes().numpy()
            loops.gradients(seen, flat, sizes, activation, hidden, above.detach().contiguous().numpy(), slopes)

        return torch.from_numpy(found), back

    def reference(self, x: Tensor, flat: Tensor | None = None) -> Tensor:
        """The same by recorded calls, which can be differentiated twice; `flat` stands for the own parameters."""
        x = x.expand(self.count, *x.shape) if x.dim() == 2 else x
        *inner, (last_weight, last_bias) = layers_of(self.flat if flat is None else flat, self.count, self.sizes)
        for weight, bias in inner:
            x = FUNCTIONS[self.activation](torch.baddbmm(bias, x, weight))
        return torch.baddbmm(last_bias, x, last_weight)

    @property
    def parts(self) -> LayerViews:
        """Views of the vector without its gradient."""
        return self._cut("parameters", self.flat.detach())

    @property
    def layers(self) -> Layers:
        """Weight and bias of each layer, as views of the vector without its gradient."""
        return self.parts.layers

    def _cut(self, name: str, flat: Tensor) -> LayerViews:
        """Views of a vector that is cut like the parameters, made once for each place that it lies in."""
        parts = self._views.get(name)
        if parts is None or parts.layers[0][0].data_ptr() != flat.data_ptr():
            parts = self._views[name] = LayerViews.of(flat, self.count, self.sizes)
        return parts

    def _slopes(self) -> Tensor:
        """Where the parameters' gradients lie."""
        if self.flat.grad is None:
            self.flat.grad = torch.empty_like(self.flat)
        return self.flat.grad


class Actor(nn.Module):
    """Parameters [B, P] of the policy at each state, from observations [B, D] or from sequences.

    They are logits, or means, or whatever `actions` says; where the policy is a Gaussian, its log standard deviations
    stand beside the means and are the same in every state.
    """

    def __init__(self, inputs: int, actions: Actions, shape: NetworkShape, generator: torch.Generator) -> None:
        super().__init__()
        self.gru = Gru(inputs, shape.memory, generator) if shape.memory else None
        # A last layer near zero: the first policy draws every option alike whatever it sees.
        self.stack = StackedMLP(
            1,
            inputs + shape.memory,
            shape.hidden,
            actions.outputs,
            last_gain=0.01,
            activation=shape.activation,
            initial=shape.initial,
            generator=generator,
        )
        spread = torch.zeros(actions.count, device=generator.device)
        self.log_std = nn.Parameter(spread) if actions.kind == "gaussian" else None

    def forward(self, inputs: Tensor | Sequences, twice_differentiable: bool = False) -> Tensor:
        """`twice_differentiable`: by recorded calls, for second derivatives."""
        features = _features(self.gru, inputs, "actor")
        outputs = (self.stack.reference if twice_differentiable else self.stack)(features)[0]
        return outputs if self.log_std is None else torch.cat([outputs, self.log_std.expand_as(outputs)], -1)

    def everywhere(self, inputs: Tensor | Sequences) -> Tensor:
        """Parameters at all states of a rollout, in blocks of rows that stay in the processor's cache."""
        return torch.cat([self(rows) for rows in inputs.split(ROWS)]) if isinstance(inputs, Tensor) else self(inputs)

    def forward_and_backward(self, inputs: Tensor | Sequences) -> tuple[Tensor, Callable[[Tensor], None]]:
        """Parameters [B, P] without a record, and what is to be called with their gradient: it leaves that of the
        network in `grad`, in place of what was there."""
        if not isinstance(inputs, Tensor):
            for parameter in self.parameters():
                parameter.grad = None
            recorded = self(inputs)
            return recorded.detach(), recorded.backward
        outputs, through = self.stack.forward_and_backward(inputs)
        spread, count = self.log_std, outputs.shape[-1]
        found = outputs[0] if spread is None else torch.cat([outputs[0], spread.detach().expand_as(outputs[0])], -1)

        def back(slope: Tensor) -> None:
            through(slope[:, :count].unsqueeze(0))
            if spread is not None:
                spread.grad = slope[:, count:].sum(0)

        return found, back

    def step(self, obs: Tensor, state: Tensor, fresh: Tensor) -> tuple[Tensor, Tensor]:
        """Parameters [N, P] and the recurrent state after observations [N, D]."""
        assert self.gru is not None
        state = self.gru.step(obs, state, fresh)
        return self(torch.cat([obs, state], -1)), state


def minibatch_count(rows: int, minibatch: int) -> int:
    """Into how many parts of about `minibatch` rows are they cut, so that none is a small rest?"""
    return max(1, round(rows / minibatch))


def minibatch_bounds(rows: int, minibatch: int) -> np.ndarray:
    """Where each of these parts begins, and where the last ends."""
    parts = np.array_split(np.arange(rows), minibatch_count(rows, minibatch))
    return np.concatenate([[0], np.cumsum([len(part) for part in parts])])


class Critics(nn.Module):
    """`count` separate perceptrons with one output each, [B, D] or sequences -> [count, B], computed together.

    With a memory they share one recurrent network.
    """

    def __init__(self, count: int, inputs: int, shape: NetworkShape, generator: torch.Generator) -> None:
        super().__init__()
        self.count = count
        self.gru = Gru(inputs, shape.memory, generator) if shape.memory else None
        self.stack = StackedMLP(
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

    @property
    def in_loops(self) -> bool:
        """Whether `fit_epoch` can do it."""
        return self.gru is None and self.stack.small and self.stack.flat.is_cpu

    def fit_epoch(
        self, inputs: Tensor, targets: Tensor, *, minibatch: int, optimiser: Adam, decay: float, most: float
    ) -> Tensor:
        """One gradient step for each part of about `minibatch` rows [B, D] and targets [B, count], as with `regress`
        and `optimiser.step(most)`, but without Python in between; returns the losses [steps, count]."""
        bounds = minibatch_bounds(len(inputs), minibatch)
        errors = np.empty((len(bounds) - 1, self.count), np.float32)
        (flat,), (first,), (second,), (count,) = optimiser.arrays()
        count[...] = loops.regress(
            inputs.numpy(),
            targets.contiguous().numpy(),
            bounds,
            flat,
            self.stack.sizes_array,
            self.stack.code,
            first,
            second,
            int(count),
            np.float32(optimiser.rate),
            np.float32(decay),
            float(most),
            errors,
        )
        return torch.from_numpy(errors)

    def regress(self, inputs: Tensor | Sequences, targets: Tensor, decay: float = 0.0) -> Tensor:
        """[count] ½ E[(V - target)²] of each, for targets [count, B]; the gradient of their sum, and of `decay` times
        the sum of squares of all parameters, is left in `grad`, in place of what was there."""
        if isinstance(inputs, Tensor):
            values, back = self.stack.forward_and_backward(inputs)
            values = values.squeeze(-1)
            back(losses.squared_error_grad(values, targets).unsqueeze(-1))
            found = losses.squared_error(values, targets)
        else:
            for parameter in self.parameters():
                parameter.grad = None
            found = losses.squared_error(self(inputs), targets)
            found.sum().backward()
        for parameter in self.parameters():
            if decay and parameter.grad is not None:
                parameter.grad.add_(parameter.detach(), alpha=2.0 * decay)
        return found.detach()


def _features(gru: Gru | None, inputs: Tensor | Sequences, name: str) -> Tensor:
    """What the perceptron sees: the observations, or features [B, D + M] (a tensor is taken to be features already)."""
    if isinstance(inputs, Tensor):
        return inputs
    assert gru is not None
    return gru.features(inputs, name)
