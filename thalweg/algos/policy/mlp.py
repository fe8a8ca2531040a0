"""K perceptrons of one shape as one module, whose gradients follow the switch of `fast_path`.

Small networks are bound by the number of calls, not by arithmetic. All parameters of the K perceptrons therefore lie in
one vector, which an optimiser, a target network and a checkpoint handle at once, and their layers are batched products.
`StackedMLP.reference` is the definition; the other methods return the same values and gradients in fewer calls.

Letters: K perceptrons, B rows, D inputs.
"""

import itertools
import math
from collections.abc import Callable
from typing import Literal

import numpy as np
import torch
from torch import Tensor, nn

from thalweg.algos.policy import fast_path, mlp_autograd, mlp_numba
from thalweg.algos.policy.mlp_autograd import ALL, FUNCTIONS, Activation, Layers, LayerViews, MLPFunction, layers_of

Initial = Literal["orthogonal", "kaiming", "truncated"]
MAX_COMPILED_WIDTH = 128
"""Widest layer for which compiled loops are faster than a library's products."""


def orthogonal(shape: tuple[int, int], gain: float, generator: torch.Generator) -> Tensor:
    """Return a matrix with orthonormal rows or columns, times `gain` (Saxe et al. 2014)."""
    weight = torch.empty(shape, dtype=torch.float32, device=generator.device)
    nn.init.orthogonal_(weight, gain, generator=generator)
    return weight


class StackedMLP(nn.Module):
    """K perceptrons of one shape that share no weights: [B, D] or [K, B, D] -> [K, B, outputs].

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
        """Initialise the parameters.

        Args:
            count: K.
            inputs: D.
            hidden: Sizes of the hidden layers.
            outputs: Size of the last layer.
            generator: Source of the initial weights, on the device of the parameters.
            last_gain: Gain of the last layer, for "orthogonal"; the others have √2.
            activation: Activation of the hidden layers.
            initial: "orthogonal" weights and zero biases; "kaiming", everything uniform within ±1/√before, as torch
                initialises its own layers; or "truncated", weights from a normal distribution of standard deviation
                1/(2√before), cut off at two of them, and zero biases.
        """
        super().__init__()
        self.count = count
        self.activation: Activation = activation
        self.sizes = (inputs, *hidden, outputs)
        length = sum(count * (before + 1) * after for before, after in itertools.pairwise(self.sizes))
        self.flat = nn.Parameter(torch.empty(length, dtype=torch.float32, device=generator.device))
        self._views: dict[str, LayerViews] = {}
        self._sizes_array = np.array(self.sizes)
        self._activation_code = mlp_numba.TANH if activation == "tanh" else mlp_numba.RELU
        self.compilable = activation != "swish" and max(self.sizes) <= MAX_COMPILED_WIDTH
        """Whether compiled loops can compute it on a CPU."""
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
        """Return [K, B, outputs]; with `frozen`, the parameters are constants, while x may have a gradient."""
        flat = self.flat.detach() if frozen else self.flat
        if not fast_path.enabled():
            return self.reference(x, flat)
        if not (torch.is_grad_enabled() and (x.requires_grad or flat.requires_grad)):
            return mlp_autograd.outputs(x, self.views, self.activation)[0]
        return MLPFunction.apply(x, flat, self.views, self.sizes, self.activation)  # pyright: ignore

    @torch.no_grad()
    def forward_and_backward(self, x: Tensor) -> tuple[Tensor, Callable[[Tensor], None]]:
        """Return [K, B, outputs] and a function that backpropagates.

        The function takes the gradient of the outputs and leaves that of the parameters in `flat.grad`, replacing what
        was there.
        """
        if not fast_path.enabled():
            return self._forward_and_backward_reference(x)
        if self.compilable and x.dim() == 2 and x.dtype == torch.float32 and x.is_cpu:
            return self._forward_and_backward_compiled(x)
        views = self.views
        outputs, cache = mlp_autograd.outputs(x, views, self.activation)

        @torch.no_grad()
        def backward(above: Tensor) -> None:
            grads = self._views_of("gradients", self._flat_grad())
            mlp_autograd.gradients(above, cache, views, grads, self.activation, wants_x=False)

        return outputs, backward

    @torch.no_grad()
    def forward_and_input_backward(self, x: Tensor, chosen: slice = ALL) -> tuple[Tensor, Callable[[Tensor], Tensor]]:
        """Return [K, B, outputs] of the chosen perceptrons for rows [B, D], and a function that backpropagates.

        The function takes the gradient of the outputs and returns that of the rows [B, D]; the parameters are
        constants.
        """
        if not fast_path.enabled():
            return self._forward_and_input_backward_reference(x, chosen)
        views = self.views.select(chosen)
        outputs, cache = mlp_autograd.outputs(x, views, self.activation)

        @torch.no_grad()
        def backward(above: Tensor) -> Tensor:
            below = mlp_autograd.gradients(above, cache, views, None, self.activation, wants_x=True)
            assert below is not None
            return below.sum(0)

        return outputs, backward

    def _forward_and_backward_compiled(self, x: Tensor) -> tuple[Tensor, Callable[[Tensor], None]]:
        rows, network = x.contiguous().numpy(), self.arrays()
        hidden = np.empty((self.count, len(x) * sum(self.sizes[1:-1])), np.float32)
        result = np.empty((self.count, len(x), self.sizes[-1]), np.float32)
        mlp_numba.outputs(rows, network, hidden, result)

        def backward(above: Tensor) -> None:
            output_grad = above.detach().contiguous().numpy()
            mlp_numba.gradients(rows, network, hidden, output_grad, self._flat_grad().numpy())

        return torch.from_numpy(result), backward

    def _forward_and_backward_reference(self, x: Tensor) -> tuple[Tensor, Callable[[Tensor], None]]:
        flat = self.flat.detach().requires_grad_()
        with torch.enable_grad():
            outputs = self.reference(x.detach(), flat)

        def backward(above: Tensor) -> None:
            self._flat_grad().copy_(torch.autograd.grad(outputs, flat, above.detach())[0])

        return outputs.detach(), backward

    def _forward_and_input_backward_reference(
        self, x: Tensor, chosen: slice
    ) -> tuple[Tensor, Callable[[Tensor], Tensor]]:
        rows = x.detach().requires_grad_()
        with torch.enable_grad():
            outputs = self.reference(rows, self.flat.detach())[chosen]
        return outputs.detach(), lambda above: torch.autograd.grad(outputs, rows, above.detach())[0]

    def arrays(self) -> mlp_numba.NetworkArrays:
        """Return the parameters in place, as compiled loops take them."""
        return mlp_numba.NetworkArrays(self.flat.detach().numpy(), self._sizes_array, self._activation_code)

    def reference(self, x: Tensor, flat: Tensor | None = None) -> Tensor:
        """Return [K, B, outputs] by plain operations of torch: the definition, which can be differentiated twice.

        `flat` stands for the module's own parameters, if it is given.
        """
        x = x.expand(self.count, *x.shape) if x.dim() == 2 else x
        *inner, (last_weight, last_bias) = layers_of(self.flat if flat is None else flat, self.count, self.sizes)
        for weight, bias in inner:
            x = FUNCTIONS[self.activation](torch.baddbmm(bias, x, weight))
        return torch.baddbmm(last_bias, x, last_weight)

    @property
    def views(self) -> LayerViews:
        """Views of the parameters, detached."""
        return self._views_of("parameters", self.flat.detach())

    @property
    def layers(self) -> Layers:
        """Weight and bias of each layer, as detached views of the parameters."""
        return self.views.layers

    def scale_outputs(self, factor: float) -> None:
        """Multiply all outputs by a factor, by the weights and biases of the last layer."""
        for part in self.layers[-1]:
            part.mul_(factor)

    def clear_inputs(self, which: Tensor) -> None:
        """Set the first layer's weights of inputs to 0: those of `which` [d] bool among the first d inputs."""
        self.layers[0][0][:, : len(which)][:, which] = 0.0

    def _views_of(self, name: str, flat: Tensor) -> LayerViews:
        """Return views of a vector that is laid out like the parameters, cached until the vector moves in memory."""
        views = self._views.get(name)
        if views is None or views.layers[0][0].data_ptr() != flat.data_ptr():
            views = self._views[name] = LayerViews.from_flat(flat, self.count, self.sizes)
        return views

    def _flat_grad(self) -> Tensor:
        """Return `flat.grad`, allocated if it is missing."""
        if self.flat.grad is None:
            self.flat.grad = torch.empty_like(self.flat)
        return self.flat.grad
