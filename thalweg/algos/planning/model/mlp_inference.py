"""Fast inference of M perceptrons without gradients, in blocks of rows that fit into the cache.

Matrix products use oneDNN (`mlp_autograd` says why). Plain batched products replace them where PyTorch lacks oneDNN or
the processor lacks bfloat16, and for few rows, where the number of calls matters more than arithmetic.
"""

import torch
from torch import Tensor
from torch.nn.functional import silu

from thalweg.algos.policy import mlp_autograd
from thalweg.algos.policy.mlp_autograd import Layers

ROWS_AT_ONCE = 1024
"""Rows per block: a block passes through all layers while its activations stay in the processor's cache."""
FEW_ROWS = 64
"""Up to this number of rows, all perceptrons are computed in one call per layer."""


def _supports_bfloat16() -> bool:
    """Return whether oneDNN supports bfloat16 on this processor, which needs AVX-512."""
    return bool(torch.ops.mkldnn._is_mkldnn_bf16_supported())


class MLPInference:
    """M perceptrons with swish activations and constant weights: [M, B, inputs] -> [M, B, outputs] float32."""

    def __init__(self, layers: Layers, dtype: torch.dtype = torch.float32) -> None:
        """Copies the weights [M, inputs, outputs] and biases [M, 1, outputs] of each layer."""
        self.dtype = dtype
        self._uses_fused = mlp_autograd.FUSED_LINEAR is not None and (dtype == torch.float32 or _supports_bfloat16())
        self._batched = [
            (weight.detach().to(dtype).clone(), bias.detach().to(dtype).clone()) for weight, bias in layers
        ]
        self._single = [
            [(weight[m].t().contiguous(), bias[m, 0].contiguous()) for weight, bias in self._batched]
            for m in range(len(layers[0][0]))
        ]

    def __call__(self, x: Tensor) -> Tensor:
        rows = x.shape[1]
        if not self._uses_fused or rows <= FEW_ROWS or not x.is_cpu:
            return self._batched_products(x)
        out = x.new_empty(len(x), rows, self._batched[-1][1].shape[-1])
        for m, layers in enumerate(self._single):
            for first in range(0, rows, ROWS_AT_ONCE):
                out[m, first : first + ROWS_AT_ONCE] = self._fused_products(layers, x[m, first : first + ROWS_AT_ONCE])
        return out

    def _batched_products(self, x: Tensor) -> Tensor:
        *inner, (last_weight, last_bias) = self._batched
        x = x.to(self.dtype)
        for weight, bias in inner:
            x = silu(torch.baddbmm(bias, x, weight), inplace=True)
        return torch.baddbmm(last_bias, x, last_weight).float()

    def _fused_products(self, layers: list[tuple[Tensor, Tensor]], x: Tensor) -> Tensor:
        assert mlp_autograd.FUSED_LINEAR is not None
        x = x.to(self.dtype)
        for weight, bias in layers[:-1]:
            x = mlp_autograd.FUSED_LINEAR(x, weight, bias, "swish", [], "")
        return mlp_autograd.FUSED_LINEAR(x, *layers[-1], "none", [], "")
