"""Fast inference of M perceptrons without gradients: blocks of rows that fit into the cache, and several threads.

Products are oneDNN's (`chain` says why); where torch lacks them, or the processor those in bfloat16, and for few rows,
where calls cost more than sums, plain batched products do the same.
"""

import torch
from torch import Tensor
from torch.nn.functional import silu

from thalweg.algos.policy import mlp_autograd as chain
from thalweg.algos.policy.mlp_autograd import Layers

ROWS_AT_ONCE = 1024
"""Rows that go through all layers before the next ones do: their numbers then stay in the processor's cache."""
FEW_ROWS = 64
"""Up to so many rows of each perceptron, all of them go through a layer in one call."""


def _has_half() -> bool:
    """Whether oneDNN multiplies in bfloat16 here, for which it takes AVX-512."""
    return bool(torch.ops.mkldnn._is_mkldnn_bf16_supported())


class MLPInference:
    """M perceptrons with swish between their layers, as constants: [M, B, before] -> [M, B, after] float32."""

    def __init__(self, layers: Layers, dtype: torch.dtype = torch.float32) -> None:
        """From weights [M, before, after] and biases [M, 1, after], which are copied."""
        self.dtype = dtype
        self._fuses = chain.FUSED_LINEAR is not None and (dtype == torch.float32 or _has_half())
        self._batched = [
            (weight.detach().to(dtype).clone(), bias.detach().to(dtype).clone()) for weight, bias in layers
        ]
        self._single = [
            [(weight[m].t().contiguous(), bias[m, 0].contiguous()) for weight, bias in self._batched]
            for m in range(len(layers[0][0]))
        ]

    def __call__(self, x: Tensor) -> Tensor:
        rows = x.shape[1]
        if not self._fuses or rows <= FEW_ROWS or not x.is_cpu:
            return self._at_once(x)
        out = x.new_empty(len(x), rows, self._batched[-1][1].shape[-1])
        for m, layers in enumerate(self._single):
            for first in range(0, rows, ROWS_AT_ONCE):
                out[m, first : first + ROWS_AT_ONCE] = self._fused(layers, x[m, first : first + ROWS_AT_ONCE])
        return out

    def _at_once(self, x: Tensor) -> Tensor:
        *inner, (last_weight, last_bias) = self._batched
        x = x.to(self.dtype)
        for weight, bias in inner:
            x = silu(torch.baddbmm(bias, x, weight), inplace=True)
        return torch.baddbmm(last_bias, x, last_weight).float()

    def _fused(self, layers: list[tuple[Tensor, Tensor]], x: Tensor) -> Tensor:
        assert chain.FUSED_LINEAR is not None
        x = x.to(self.dtype)
        for weight, bias in layers[:-1]:
            x = chain.FUSED_LINEAR(x, weight, bias, "swish", [], "")
        return chain.FUSED_LINEAR(x, *layers[-1], "none", [], "")
