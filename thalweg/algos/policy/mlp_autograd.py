"""Batched perceptrons of one shape, with hand-written gradients of each layer.

This module is part of the fast path (see `fast_path`); `MLPFunction` is a function of PyTorch's autograd. The speed of
small networks depends on the number of calls, so their layers are batched products. The speed of wide ones depends on
arithmetic: PyTorch multiplies float32 matrices by MKL, which uses half of the vector width of AMD's Zen 5. oneDNN, a
part of PyTorch, uses all of it, and adds bias and activation before a result leaves the registers. Builds of PyTorch
without oneDNN use batched products. Gradients of weights need a transposed matrix, which oneDNN copies first; except on
Zen 5, MKL is faster for them (measured on Zen 4, 256 x 256 x 256).

Letters: K perceptrons, B rows, D numbers of an observation.
"""

import itertools
from collections.abc import Callable
from functools import cached_property
from typing import Any, Literal, NamedTuple

import torch
from llvmlite import binding
from torch import Tensor, nn
from torch.nn.functional import silu

Activation = Literal["tanh", "relu", "swish"]
Layers = list[tuple[Tensor, Tensor]]
"""Weight [K, before, after] and bias [K, 1, after] of each layer."""
ALL = slice(None)
WIDE_LAYER = 128
"""Layers wider than this are computed by oneDNN, one perceptron after another."""
MIN_ROWS = 64
"""Smallest number of rows for oneDNN."""


def _fused_linear() -> Any:
    """Return oneDNN's product with bias and activation, or None if this build of PyTorch has no working one."""
    try:
        fused = torch.ops.mkldnn._linear_pointwise
        ones = torch.ones(2, 2).float()
        found = fused(ones, ones, torch.ones(2).float(), "swish", [], "")
        return fused if torch.allclose(found, silu(torch.full((2, 2), 3.0).float())) else None
    except (AttributeError, RuntimeError):
        return None


def mkl_is_faster_for_weight_grads(processor: str) -> bool:
    """Return whether MKL is faster than oneDNN for gradients of weights; `processor` is its name in LLVM."""
    return processor != "znver5"


WEIGHT_GRADS_BY_MKL = mkl_is_faster_for_weight_grads(binding.get_host_cpu_name())
FUSED_LINEAR: Callable[..., Tensor] | None = _fused_linear()
"""FUSED_LINEAR(x [B, before], weight [after, before], bias [after] or None, activation, [], "") -> [B, after]."""


class ForwardCache(NamedTuple):
    """Values of a forward pass for the backward pass: per layer [K, B, ...], or a list of K tensors [B, ...]."""

    inputs: list[Tensor] | list[list[Tensor]]
    """Input of each layer."""
    pre_activations: list[Tensor] | list[list[Tensor]]
    """Input of each activation whose derivative does not follow from its output ("swish"); otherwise empty."""


class LayerViews:
    """The layers of K perceptrons of one shape: views of one vector with all their parameters."""

    def __init__(self, layers: Layers) -> None:
        self.layers = layers
        self.max_width = max(max(weight.shape[1:]) for weight, _ in layers)

    @classmethod
    def from_flat(cls, flat: Tensor, count: int, sizes: tuple[int, ...]) -> "LayerViews":
        """Return views of the vector `flat`."""
        return cls(layers_of(flat, count, sizes))

    @cached_property
    def per_network(self) -> list[Layers]:
        """Weight [before, after] and bias [after] of each layer, for each perceptron."""
        return [[(weight[k], bias[k, 0]) for weight, bias in self.layers] for k in range(len(self.layers[0][0]))]

    def select(self, chosen: slice) -> "LayerViews":
        """Return the views of the chosen perceptrons only."""
        return self if chosen is ALL else LayerViews([(weight[chosen], bias[chosen]) for weight, bias in self.layers])


def layers_of(flat: Tensor, count: int, sizes: tuple[int, ...]) -> Layers:
    """Return weight [K, before, after] and bias [K, 1, after] of each layer of K perceptrons, as views of `flat`."""
    lengths = [
        length for before, after in itertools.pairwise(sizes) for length in (count * before * after, count * after)
    ]
    pieces = iter(flat.split(lengths))
    return [
        (next(pieces).view(count, before, after), next(pieces).view(count, 1, after))
        for before, after in itertools.pairwise(sizes)
    ]


def outputs(x: Tensor, views: LayerViews, activation: Activation) -> tuple[Tensor, ForwardCache]:
    """Return [K, B, outputs] for rows [B, D] or [K, B, D], and what `gradients` needs; autograd records nothing."""
    if (
        FUSED_LINEAR is not None
        and views.max_width > WIDE_LAYER
        and x.shape[-2] >= MIN_ROWS
        and x.dtype == torch.float32
        and x.is_cpu
    ):
        return _outputs_one_by_one(x, views.per_network, activation)
    *inner, (last_weight, last_bias) = views.layers
    hidden = x.expand(len(last_weight), *x.shape) if x.dim() == 2 else x
    seen, before = [hidden], []
    for weight, bias in inner:
        hidden = torch.baddbmm(bias, hidden, weight)
        if activation == "swish":
            before.append(hidden)
            hidden = silu(hidden)
        else:
            hidden = hidden.tanh_() if activation == "tanh" else hidden.relu_()
        seen.append(hidden)
    return torch.baddbmm(last_bias, hidden, last_weight), ForwardCache(seen, before)


def gradients(
    above: Tensor,
    cache: ForwardCache,
    views: LayerViews,
    grads: LayerViews | None,
    activation: Activation,
    wants_x: bool,
) -> Tensor | None:
    """Backpropagate the gradient `above` [K, B, outputs] of the outputs.

    The gradients of the layers are written to `grads`, if it is given; that of the input [K, B, D] is returned, if
    `wants_x`.
    """
    if not isinstance(cache.inputs[0], Tensor):
        return _gradients_one_by_one(above, cache, views.per_network, grads and grads.per_network, activation, wants_x)
    known, layers = cache.pre_activations or cache.inputs[1:], views.layers
    for layer in range(len(layers) - 1, -1, -1):
        if grads is not None:
            torch.bmm(cache.inputs[layer].transpose(1, 2), above, out=grads.layers[layer][0])  # pyright: ignore
            torch.sum(above, 1, keepdim=True, out=grads.layers[layer][1])
        if layer == 0 and not wants_x:
            return None
        above = torch.bmm(above, layers[layer][0].transpose(1, 2))
        if layer > 0:
            _DERIVATIVES[activation](above, known[layer - 1], above)
    return above


class MLPFunction(torch.autograd.Function):
    """`outputs` and `gradients` as one function of autograd, of rows and of the vector of all parameters."""

    @staticmethod
    def forward(
        ctx: Any, x: Tensor, flat: Tensor, views: LayerViews, sizes: tuple[int, ...], activation: Activation
    ) -> Tensor:
        ctx.views, ctx.sizes, ctx.activation, ctx.shared = views, sizes, activation, x.dim() == 2
        found, cache = outputs(x, views, activation)
        ctx.one_by_one = not isinstance(cache.inputs[0], Tensor)
        saved = [*cache.inputs, *cache.pre_activations]
        ctx.save_for_backward(flat, *(itertools.chain.from_iterable(saved) if ctx.one_by_one else saved))  # pyright: ignore
        return found

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, above: Tensor) -> Any:  # pyright: ignore
        flat, *saved = ctx.saved_tensors  # raises an error if a tensor was changed in place
        if ctx.one_by_one:
            saved = [saved[first : first + len(above)] for first in range(0, len(saved), len(above))]
        layers = len(ctx.views.layers)
        cache = ForwardCache(saved[:layers], saved[layers:])
        wants_x, wants_flat = ctx.needs_input_grad[:2]
        flat_grad, grads = None, None
        if wants_flat:
            flat_grad = torch.empty_like(flat)
            grads = LayerViews.from_flat(flat_grad, len(above), ctx.sizes)
        below = gradients(above, cache, ctx.views, grads, ctx.activation, wants_x)
        return below.sum(0) if below is not None and ctx.shared else below, flat_grad, None, None, None


def _outputs_one_by_one(x: Tensor, networks: list[Layers], activation: Activation) -> tuple[Tensor, ForwardCache]:
    """Compute `outputs` by oneDNN, one perceptron after another."""
    found = []
    seen, before = [[] for _ in networks[0]], [[] for _ in networks[0][1:]] if activation == "swish" else []
    for k, (*inner, (last_weight, last_bias)) in enumerate(networks):
        hidden = x if x.dim() == 2 else x[k]
        for layer, (weight, bias) in enumerate(inner):
            seen[layer].append(hidden)
            if activation == "swish":
                hidden = _product(hidden, weight, bias)
                before[layer].append(hidden)
                hidden = silu(hidden)
            else:
                hidden = _product(hidden, weight, bias, activation)
        seen[-1].append(hidden)
        found.append(_product(hidden, last_weight, last_bias))
    return torch.stack(found), ForwardCache(seen, before)


def _gradients_one_by_one(
    above: Tensor,
    cache: ForwardCache,
    networks: list[Layers],
    grads: list[Layers] | None,
    activation: Activation,
    wants_x: bool,
) -> Tensor | None:
    """Compute `gradients` by oneDNN, one perceptron after another."""
    known, found, through = cache.pre_activations or cache.inputs[1:], [], _DERIVATIVES[activation]
    for k, grad in enumerate(above):
        for layer in range(len(networks[k]) - 1, -1, -1):
            if grads is not None:
                weight_grad, bias_grad = grads[k][layer]
                _weight_grad(cache.inputs[layer][k], grad, weight_grad)
                torch.sum(grad, 0, out=bias_grad)
            if layer == 0 and not wants_x:
                break
            grad = _product(grad, networks[k][layer][0].t())
            if layer > 0:
                through(grad, known[layer - 1][k], grad)
        found.append(grad)
    return torch.stack(found) if wants_x else None


def _product(x: Tensor, weight: Tensor, bias: Tensor | None = None, activation: str = "none") -> Tensor:
    """Return activation(x [B, before] weight [before, after] + bias [after]), for "none", "tanh" or "relu"."""
    assert FUSED_LINEAR is not None
    if 1 not in weight.shape:  # for a vector, a call of oneDNN takes longer than the product
        return FUSED_LINEAR(x, weight.t(), bias, activation, [], "")
    found = torch.mm(x, weight) if bias is None else torch.addmm(bias, x, weight)
    return found if activation == "none" else found.tanh_() if activation == "tanh" else found.relu_()


def _weight_grad(x: Tensor, grad: Tensor, into: Tensor) -> None:
    """Set `into` to x [B, before] transposed times grad [B, after]."""
    if WEIGHT_GRADS_BY_MKL:
        torch.mm(x.t(), grad, out=into)
    else:
        into.copy_(_product(x.t(), grad))


def _through_tanh(above: Tensor, after: Tensor, into: Tensor) -> None:
    torch.ops.aten.tanh_backward.grad_input(above, after, grad_input=into)


def _through_relu(above: Tensor, after: Tensor, into: Tensor) -> None:
    torch.ops.aten.threshold_backward.grad_input(above, after, 0.0, grad_input=into)


def _through_swish(above: Tensor, before: Tensor, into: Tensor) -> None:
    torch.ops.aten.silu_backward.grad_input(above, before, grad_input=into)


FUNCTIONS = {"tanh": torch.tanh, "relu": torch.relu, "swish": nn.functional.silu}
_DERIVATIVES = {"tanh": _through_tanh, "relu": _through_relu, "swish": _through_swish}
"""Functions that multiply a gradient by an activation's derivative, given its output, or for "swish" its input."""
