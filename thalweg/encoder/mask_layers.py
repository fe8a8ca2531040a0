"""The first layers of an encoder of masks, computed only where a mask is not uniform.

Most outputs of the first three layers, which see at most 15 x 15 pixels each, see nothing but water or no water. Those
have the value that a uniform mask of 0 or of 255 has at the same place, which is computed once; the others, a tenth or
so, are computed. Any mask can be encoded, but one of noise takes longer than by dense convolutions.

Letters: N masks, H and W pixels of a layer's input, C channels of it, C' of its output. H and W of masks are multiples
of `SPARSE_STEP`, so that each layer halves them.
"""

from typing import NamedTuple

import numpy as np
from torch import nn

from thalweg.core.compute.jit import kernel
from thalweg.encoder.vae import LEAK

f32 = np.float32
SPARSE_LAYERS = 3
"""Layers that are computed here; `encode_masks` is written for these three. Most outputs of deeper ones see both."""
SPARSE_STEP = 2**SPARSE_LAYERS
DRY, WET, MIXED = 1, 2, 3
"""Kind of a pixel or an output: it sees zeros only, 255 only, or anything else. The kind of several is their "or"."""
PLACES = 16
"""Outputs that are computed together, so that weights are read from the cache once for all of them."""


class MaskLayer(NamedTuple):
    """A convolution of stride 2 with its leaky ReLU."""

    weight: np.ndarray
    """[9 C, C'] float32, rows in the order of the window's rows, columns and channels."""
    bias: np.ndarray
    """[C'] float32."""
    uniform: np.ndarray
    """[2, H / 2, W / 2, C'] float32, the outputs for masks that are all DRY, and all WET."""


def output_shape(layers: tuple[MaskLayer, ...]) -> tuple[int, int, int]:
    """Return the shape [H', W', C'] of the last layer's output."""
    _, height, width, channels = layers[-1].uniform.shape
    return height, width, channels


def mask_layers(convolutions: list[nn.Conv2d], size_px: tuple[int, int]) -> tuple[MaskLayer, ...]:
    """Return the first layers of an encoder of masks [H, W], given as `size_px`, from its convolutions for pixels in
    0..255."""
    layers: list[MaskLayer] = []
    inputs = np.zeros((2, *size_px, 1), np.float32)
    inputs[1] = 255
    for convolution in convolutions[:SPARSE_LAYERS]:
        weight = convolution.weight.detach().permute(2, 3, 1, 0).flatten(0, 2).contiguous().numpy()
        assert convolution.bias is not None
        size = inputs.shape[1] // 2, inputs.shape[2] // 2
        layer = MaskLayer(weight, convolution.bias.detach().numpy(), np.empty((2, *size, weight.shape[1]), np.float32))
        everything = np.full(inputs.shape[1:3], MIXED, np.uint8)
        for side, outputs in zip(inputs, layer.uniform, strict=True):
            _layer(side, inputs, everything, layer, outputs, np.empty(size, np.uint8))
        layers.append(layer)
        inputs = layer.uniform
    return tuple(layers)


@kernel(fastmath=False)
def encode_masks(masks, layers, features):
    """Fill `features` [N, H', W', C'] float32, the output of the last of three layers, for masks [N, H, W] uint8."""
    first, second, third = layers
    height, width = masks.shape[1], masks.shape[2]
    pixels, kinds = np.empty((height, width, 1), np.float32), np.empty((height, width), np.uint8)
    uniform = np.zeros((2, height, width, 1), np.float32)
    uniform[1] = f32(255)
    middle_kinds = np.empty((height // 2, width // 2), np.uint8)
    last_kinds = np.empty((height // 4, width // 4), np.uint8)
    end_kinds = np.empty((height // 8, width // 8), np.uint8)
    after_first = np.empty((height // 2, width // 2, len(first.bias)), np.float32)
    after_second = np.empty((height // 4, width // 4, len(second.bias)), np.float32)
    for n in range(len(masks)):
        _kinds_of_pixels(masks[n], pixels[..., 0], kinds)
        _layer(pixels, uniform, kinds, first, after_first, middle_kinds)
        _layer(after_first, first.uniform, middle_kinds, second, after_second, last_kinds)
        _layer(after_second, second.uniform, last_kinds, third, features[n], end_kinds)
        _fill_uniform(end_kinds, third.uniform, features[n])


@kernel(fastmath=False)
def _layer(inputs, uniform, kinds, layer, outputs, output_kinds):
    """Fill the kinds [H / 2, W / 2] of a layer's outputs, and the outputs [H / 2, W / 2, C'] that are MIXED.

    inputs [H, W, C] are read where their kinds [H, W] are MIXED, uniform [2, H, W, C] elsewhere.
    """
    height, width = output_kinds.shape
    _kinds_of_windows(kinds, output_kinds)
    windows = np.empty((PLACES, len(layer.weight)), np.float32)
    found = np.empty((PLACES, len(layer.bias)), np.float32)
    places = np.empty((PLACES, 2), np.int64)
    waiting = 0
    for y in range(height):
        for x in range(width):
            if output_kinds[y, x] == MIXED:
                _gather(inputs, uniform, kinds, y, x, windows[waiting])
                places[waiting, 0], places[waiting, 1] = y, x
                waiting += 1
            if waiting == PLACES or (waiting > 0 and y == height - 1 and x == width - 1):
                _product(windows[:waiting], layer.weight, layer.bias, found)
                for k in range(waiting):
                    for j in range(found.shape[1]):
                        value = found[k, j]
                        outputs[places[k, 0], places[k, 1], j] = value if value > f32(0) else value * f32(LEAK)
                waiting = 0


@kernel(fastmath=False, disjoint=True, allocates=False)
def _fill_uniform(kinds, uniform, outputs):
    """Set the outputs [H, W, C] that are not MIXED."""
    for y in range(kinds.shape[0]):
        for x in range(kinds.shape[1]):
            kind = kinds[y, x]
            if kind != MIXED:
                for channel in range(outputs.shape[2]):
                    outputs[y, x, channel] = uniform[kind - 1, y, x, channel]


@kernel(fastmath=False, disjoint=True, allocates=False)
def _kinds_of_pixels(mask, pixels, kinds):
    """Fill pixels [H, W] float32 and their kinds, for a mask [H, W] uint8."""
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            pixels[y, x] = f32(mask[y, x])
        for x in range(mask.shape[1]):
            value = mask[y, x]
            dry_or_wet = np.uint8(DRY) if value == 0 else np.uint8(WET)
            kinds[y, x] = np.uint8(MIXED) if (value != 0) & (value != 255) else dry_or_wet


@kernel(fastmath=False, disjoint=True)
def _kinds_of_windows(kinds, output_kinds):
    """Fill the kinds [H / 2, W / 2] of a layer's outputs from those of its inputs [H, W]; padding has no kind."""
    height, width = kinds.shape
    column = np.empty(width, np.uint8)
    for y in range(height // 2):
        # The first row has padding above it; its own row in place of that changes nothing.
        above = max(2 * y - 1, 0)
        for x in range(width):
            column[x] = kinds[above, x] | kinds[2 * y, x] | kinds[2 * y + 1, x]
        output_kinds[y, 0] = column[0] | column[1]
        for x in range(1, width // 2):
            output_kinds[y, x] = column[2 * x - 1] | column[2 * x] | column[2 * x + 1]


@kernel(fastmath=False, disjoint=True, allocates=False)
def _gather(inputs, uniform, kinds, y, x, window):
    """Copy the inputs of an output into its window [9 C]; padding is zero."""
    channels, at = inputs.shape[2], 0
    for row in range(2 * y - 1, 2 * y + 2):
        for column in range(2 * x - 1, 2 * x + 2):
            outside = row < 0 or column < 0
            kind = np.uint8(MIXED) if outside else kinds[row, column]
            for channel in range(channels):
                if outside:
                    window[at + channel] = f32(0)
                elif kind == MIXED:
                    window[at + channel] = inputs[row, column, channel]
                else:
                    window[at + channel] = uniform[kind - 1, row, column, channel]
            at += channels


@kernel(disjoint=True, allocates=False)
def _product(windows, weight, bias, found):
    """Set rows of `found` to windows [P, 9 C] weight + bias; a row's bits do not depend on the others."""
    rows, length = windows.shape
    width = weight.shape[1]
    for k in range(rows):
        for j in range(width):
            found[k, j] = bias[j]
    full = length - length % 4
    for i in range(0, full, 4):
        # Four rows of the weights at a time: the result is read and written a quarter as often.
        for k in range(rows):
            x0, x1, x2, x3 = windows[k, i], windows[k, i + 1], windows[k, i + 2], windows[k, i + 3]
            for j in range(width):
                low = x0 * weight[i, j] + x1 * weight[i + 1, j]
                found[k, j] += low + (x2 * weight[i + 2, j] + x3 * weight[i + 3, j])
    for i in range(full, length):
        for k in range(rows):
            for j in range(width):
                found[k, j] += windows[k, i] * weight[i, j]
