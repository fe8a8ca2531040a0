"""A frozen convolution with its leaky ReLU, as one operation of oneDNN where PyTorch has it.

oneDNN applies the activation before a result leaves the registers, and takes weights in its own layout, which PyTorch's
layers make anew at every call. The bits are those of the two layers one after the other.
"""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d, leaky_relu_

from thalweg.encoder.vae import LEAK

STRIDE, PADDING = (2, 2), (1, 1)
"""Those of every convolution of an encoder."""
TYPICAL_FRAMES = 8
"""Frames for which oneDNN chooses the layout of weights; any number can be encoded."""


class LeakyConvolution(nn.Module):
    """Maps images [N, C, H, W] to the leaky ReLU of a convolution of stride 2, [N, C', H / 2, W / 2]."""

    def __init__(self, layer: nn.Conv2d, size_px: tuple[int, int]) -> None:
        """Take the weights of a layer, on its device; `size_px` is H and W of the images."""
        super().__init__()
        self.layer = layer
        self._packed: Tensor | None = None
        weight = layer.weight
        # For bfloat16, oneDNN refuses processors that PyTorch has other code for.
        if FUSED is not None and weight.is_cpu and weight.dtype == torch.float32:
            shape = (TYPICAL_FRAMES, weight.shape[1], *size_px)
            self._packed = _packed(weight.detach(), shape)

    def forward(self, images: Tensor) -> Tensor:
        if FUSED is None or self._packed is None:
            return leaky_relu_(conv2d(images, self.layer.weight, self.layer.bias, STRIDE, PADDING), LEAK)
        return _apply(FUSED, images, self._packed, self.layer.bias)


def _packed(weight: Tensor, shape: Sequence[int]) -> Tensor:
    """Return weights [C', C, 3, 3] in oneDNN's layout for images of a shape [N, C, H, W]."""
    return torch.ops.mkldnn._reorder_convolution_weight(weight, PADDING, STRIDE, (1, 1), 1, list(shape))


def _apply(fused: Any, images: Tensor, packed: Tensor, bias: Tensor | None) -> Tensor:
    """Return the leaky ReLU of a convolution with weights of `_packed`, by oneDNN's operation."""
    return fused(images, packed, bias, PADDING, STRIDE, (1, 1), 1, "leaky_relu", [LEAK], "")


def _fused_operation() -> Any:
    """Return oneDNN's convolution with an activation, or None if this build of PyTorch has no working one."""
    try:
        fused = torch.ops.mkldnn._convolution_pointwise
        images, weight = torch.ones(1, 1, 4, 4).float(), torch.full((1, 1, 3, 3), -1.0).float()
        found = _apply(fused, images, _packed(weight, images.shape), None)
        return fused if torch.allclose(found, LEAK * conv2d(images, weight, None, STRIDE, PADDING)) else None
    except (AttributeError, RuntimeError):
        return None


FUSED = _fused_operation()
"""The operation of oneDNN, or None without it."""
