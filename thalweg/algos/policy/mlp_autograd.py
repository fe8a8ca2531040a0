"""What do K perceptrons of one shape say, and how does a gradient pass through them? The chain rule, layer by layer.

Small networks are bound by the number of calls, so that their layers are batched products. Wide ones are bound by
arithmetic: torch multiplies float32 matrices by MKL, which uses half of the vector width of AMD's Zen 5; oneDNN, which
torch brings too, uses all of it, and adds bias and activation before a result leaves the registers. Where torch lacks
that, the same is done by batched products. Gradients of weights need a transposed matrix, which oneDNN copies first:
without Zen 5's advantage MKL takes less time for them (measured on Zen 4, 256 x 256 x 256).

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
WIDE = 128
"""Numbers of a layer beyond which a product is a matter of arithmetic."""
MIN_ROWS = 64
"""Rows from which on it is."""


def _fused_linear() -> Any:
    """oneDNN's product with bias and activation, or None where this torch has none that works."""
    try:
        fused = torch.ops.mkldnn._linear_pointwise
        ones = torch.ones(2, 2)
        found = fused(ones, ones, torch.ones(2), "swish", [], "")
        return fused if torch.allclose(found, silu(torch.full((2, 2), 3.0))) else None
    except (AttributeError, RuntimeError):
        return None


def mkl_is_faster_for_weight_grads(processor: str) -> bool:
    """Whether MKL takes less time than oneDNN for the gradients of weights, by LLVM's name of the processor."""
    return processor != "znver5"


WEIGHT_GRADS_BY_MKL = mkl_is_faster_for_weight_grads(binding.get_host_cpu_name())
FUSED_LINEAR: Callable[..., Tensor] | None = _fused_linear()
"""FUSED_LINEAR(x [B, before], weight [after, before], bias [after] or None, activation, [], "") -> [B, after]."""


class ForwardCache(NamedTuple):
    """What the gradient of a pass needs of it: for each layer either [K, B, ...] or K times [B, ...]."""

    seen: list[Tensor] | list[list[Tensor]]
    """What each layer was given."""
    before: list[Tensor] | list[list[Tensor]]
    """What each activation was given, where its derivative does not follow from what it gave; else nothing."""


class LayerViews:
    """The layers of K perceptrons of one shape: views of the vector that all their parameters lie in."""

    def __init__(self, layers: Layers) -> None:
        self.layers = layers
        self.widest = max(max(weight.shape[1:]) for weight, _ in layers)

    @classmethod
    def of(cls, flat: Tensor, count: int, sizes: tuple[int, ...]) -> "LayerViews":
        """Cut out of the vector."""
        return cls(layers_of(flat, count, sizes))

    @cached_property
    def apart(self) -> list[Layers]:
        """[before, after] and [after] of each layer of each perceptron."""
        return [[(weight[k], bias[k, 0]) for weight, bias in self.layers] for k in range(len(self.layers[0][0]))]

    def some(self, chosen: slice) -> "LayerViews":
        """Of these perceptrons only."""
        return self if chosen is ALL else LayerViews([(weight[chosen], bias[chosen]) for weight, bias in self.layers])


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


def outputs(x: Tensor, parts: LayerViews, activation: Activation) -> tuple[Tensor, ForwardCache]:
    """[K, B, outputs] of rows [B, D], or [K, B, D], without a record."""
    if (
        FUSED_LINEAR is not None
        and parts.widest > WIDE
        and x.shape[-2] >= MIN_ROWS
        and x.dtype == torch.float32
        and x.is_cpu
    ):
        return _outputs_one_by_one(x, parts.apart, activation)
    *inner, (last_weight, last_bias) = parts.layers
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
    trace: ForwardCache,
    parts: LayerViews,
    places: LayerViews | None,
    activation: Activation,
    wants_x: bool,
) -> Tensor | None:
    """From the gradient of the outputs [K, B, outputs]: that of each layer into its place, if there are places, and
    that of what the first was given [K, B, D], if it is wanted."""
    if not isinstance(trace.seen[0], Tensor):
        return _gradients_one_by_one(above, trace, parts.apart, places and places.apart, activation, wants_x)
    known, layers = trace.before or trace.seen[1:], parts.layers
    for layer in range(len(layers) - 1, -1, -1):
        if places is not None:
            torch.bmm(trace.seen[layer].transpose(1, 2), above, out=places.layers[layer][0])  # pyright: ignore
            torch.sum(above, 1, keepdim=True, out=places.layers[layer][1])
        if layer == 0 and not wants_x:
            return None
        above = torch.bmm(above, layers[layer][0].transpose(1, 2))
        if layer > 0:
            _DERIVATIVES[activation](above, known[layer - 1], above)
    return above


class MLPFunction(torch.autograd.Function):
    """The same as one recorded function of rows and of the vector of all parameters."""

    @staticmethod
    def forward(
        ctx: Any, x: Tensor, flat: Tensor, parts: LayerViews, sizes: tuple[int, ...], activation: Activation
    ) -> Tensor:
        ctx.parts, ctx.sizes, ctx.activation, ctx.shared = parts, sizes, activation, x.dim() == 2
        found, trace = outputs(x, parts, activation)
        ctx.one_by_one = not isinstance(trace.seen[0], Tensor)
        kept = [*trace.seen, *trace.before]
        ctx.save_for_backward(flat, *(itertools.chain.from_iterable(kept) if ctx.one_by_one else kept))  # pyright: ignore
        return found

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, above: Tensor) -> Any:  # pyright: ignore
        flat, *kept = ctx.saved_tensors  # which makes sure that nothing has changed since
        if ctx.one_by_one:
            kept = [kept[first : first + len(above)] for first in range(0, len(kept), len(above))]
        layers = len(ctx.parts.layers)
        trace = ForwardCache(kept[:layers], kept[layers:])
        wants_x, wants_flat = ctx.needs_input_grad[:2]
        into, places = None, None
        if wants_flat:
            into = torch.empty_like(flat)
            places = LayerViews.of(into, len(above), ctx.sizes)
        below = gradients(above, trace, ctx.parts, places, ctx.activation, wants_x)
        return below.sum(0) if below is not None and ctx.shared else below, into, None, None, None


def _outputs_one_by_one(x: Tensor, apart: list[Layers], activation: Activation) -> tuple[Tensor, ForwardCache]:
    """`outputs` by oneDNN, perceptron after perceptron."""
    found = []
    seen, before = [[] for _ in apart[0]], [[] for _ in apart[0][1:]] if activation == "swish" else []
    for k, (*inner, (last_weight, last_bias)) in enumerate(apart):
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
    trace: ForwardCache,
    apart: list[Layers],
    places: list[Layers] | None,
    activation: Activation,
    wants_x: bool,
) -> Tensor | None:
    """`gradients` by oneDNN, perceptron after perceptron."""
    known, found, through = trace.before or trace.seen[1:], [], _DERIVATIVES[activation]
    for k, slope in enumerate(above):
        for layer in range(len(apart[k]) - 1, -1, -1):
            if places is not None:
                weight_place, bias_place = places[k][layer]
                _weight_slope(trace.seen[layer][k], slope, weight_place)
                torch.sum(slope, 0, out=bias_place)
            if layer == 0 and not wants_x:
                break
            slope = _product(slope, apart[k][layer][0].t())
            if layer > 0:
                through(slope, known[layer - 1][k], slope)
        found.append(slope)
    return torch.stack(found) if wants_x else None


def _product(x: Tensor, weight: Tensor, bias: Tensor | None = None, activation: str = "none") -> Tensor:
    """activation(x [B, before] weight [before, after] + bias [after]), for "none", "tanh" or "relu"."""
    assert FUSED_LINEAR is not None
    if 1 not in weight.shape:  # a vector takes less time than asking oneDNN does
        return FUSED_LINEAR(x, weight.t(), bias, activation, [], "")
    found = torch.mm(x, weight) if bias is None else torch.addmm(bias, x, weight)
    return found if activation == "none" else found.tanh_() if activation == "tanh" else found.relu_()


def _weight_slope(seen: Tensor, slope: Tensor, into: Tensor) -> None:
    """seen [B, before] transposed times slope [B, after]."""
    if WEIGHT_GRADS_BY_MKL:
        torch.mm(seen.t(), slope, out=into)
    else:
        into.copy_(_product(seen.t(), slope))


def _through_tanh(above: Tensor, after: Tensor, into: Tensor) -> None:
    torch.ops.aten.tanh_backward.grad_input(above, after, grad_input=into)


def _through_relu(above: Tensor, after: Tensor, into: Tensor) -> None:
    torch.ops.aten.threshold_backward.grad_input(above, after, 0.0, grad_input=into)


def _through_swish(above: Tensor, before: Tensor, into: Tensor) -> None:
    torch.ops.aten.silu_backward.grad_input(above, before, grad_input=into)


FUNCTIONS = {"tanh": torch.tanh, "relu": torch.relu, "swish": nn.functional.silu}
_DERIVATIVES = {"tanh": _through_tanh, "relu": _through_relu, "swish": _through_swish}
"""From the gradient after each, and what it gave (of "swish": what it was given), to the gradient before it."""
