"""Small perceptrons forwards and backwards as compiled loops: part of the fast path, see `fast_path`.

A product of 64 x 64 numbers takes a few microseconds, and a call of a library about as long. A gradient step of three
small networks would make some forty such calls; here the policy's makes two, and the critics of an on-policy algorithm
make one per pass. The order of operations is fixed (no `fastmath`), so that a machine always gives the same bits.

Letters: K networks, B rows, L layers; `sizes` [L + 1] holds the sizes of the input and of each layer, and `flat` all
parameters as `mlp_autograd.layers_of` cuts them.
"""

from typing import NamedTuple

import numpy as np

from thalweg.core.compute.jit import kernel

f32 = np.float32
TANH, RELU = 0, 1
SATURATED = f32(7.9)
"""Inputs of tanh are clamped to this: beyond it tanh is less than three ten-millionths from 1."""


class NetworkArrays(NamedTuple):
    """K networks of one shape."""

    flat: np.ndarray
    """All parameters, float32."""
    sizes: np.ndarray
    """[L + 1]."""
    activation: int
    """TANH or RELU."""


class AdamArrays(NamedTuple):
    """State of Adam: its two running means, both like `flat`, the number of steps so far, and the learning rate."""

    first: np.ndarray
    second: np.ndarray
    count: int
    rate: np.float32


@kernel(fastmath=False)
def outputs(x, network, hidden, result):
    """Fill `result` [K, B, outputs] for rows `x` [B, D], and `hidden` [K, B * Σ hidden sizes] with the outputs of the
    hidden layers, one layer after another."""
    flat, sizes, activation = network
    rows, layers = x.shape[0], len(sizes) - 1
    for k in range(len(result)):
        before, offset, start = x, 0, 0
        for layer in range(layers):
            weight, bias, offset = parameters(flat, sizes, layer, k, len(result), offset)
            after = sizes[layer + 1]
            if layer == layers - 1:
                affine(before, weight, bias, result[k])
            else:
                into = hidden[k, start : start + rows * after].reshape((rows, after))
                start += rows * after
                affine(before, weight, bias, into)
                activate(into, activation)
                before = into


@kernel(fastmath=False)
def gradients(x, network, hidden, output_grad, grad):
    """Fill `grad`, laid out like `flat`, from `output_grad` [K, B, outputs] and `hidden`, which `outputs` filled."""
    flat, sizes, activation = network
    rows, layers = x.shape[0], len(sizes) - 1
    for k in range(len(output_grad)):
        above, offset, start = output_grad[k], len(flat), hidden.shape[1]
        # Both offsets run backwards, from the end of the last layer to the begin of the first.
        for layer in range(layers - 1, -1, -1):
            before, after = sizes[layer], sizes[layer + 1]
            offset -= len(output_grad) * (before + 1) * after
            weight, _, _ = parameters(flat, sizes, layer, k, len(output_grad), offset)
            weight_grad, bias_grad, _ = parameters(grad, sizes, layer, k, len(output_grad), offset)
            bias_grad[:] = f32(0)
            for row in range(rows):
                for j in range(after):
                    bias_grad[j] += above[row, j]
            no_bias = np.zeros(after, np.float32)
            if layer == 0:  # the gradient in the rows themselves is not needed
                affine(x.T, above, no_bias, weight_grad)
            else:
                start -= rows * before
                layer_input = hidden[k, start : start + rows * before].reshape((rows, before))
                affine(layer_input.T, above, no_bias, weight_grad)
                below = np.empty((rows, before), np.float32)
                # A contiguous copy of the transposed weights lets the innermost loop vectorise.
                affine(above, np.ascontiguousarray(weight.T), np.zeros(before, np.float32), below)
                through_activation(below, layer_input, activation)
                above = below


@kernel(fastmath=False)
def fit_epoch(inputs, targets, bounds, network, optimiser, l2, max_norm, errors):
    """Take one step of Adam of K critics for each minibatch of rows, and return the optimiser's count of steps.

    A step minimises ½ E[(V - target)²] of each critic plus `l2` times the sum of squares of all parameters; its
    gradient is clipped to the length `max_norm`. `inputs` are [B, D] and `targets` [B, K]; minibatch i is the rows
    `bounds[i]` to `bounds[i + 1]`. `errors` [minibatches, K] is filled with ½ E[(V - target)²].
    """
    flat, sizes, _ = network
    first, second, count, rate = optimiser
    critics, inner = targets.shape[1], np.sum(sizes[1:-1])
    grad = np.empty_like(flat)
    for batch in range(len(bounds) - 1):
        x, aims = inputs[bounds[batch] : bounds[batch + 1]], targets[bounds[batch] : bounds[batch + 1]]
        rows = len(x)
        hidden = np.empty((critics, rows * inner), np.float32)
        values = np.empty((critics, rows, 1), np.float32)
        outputs(x, network, hidden, values)
        for k in range(critics):
            total = f32(0)
            for row in range(rows):
                error = values[k, row, 0] - aims[row, k]
                total += error * error
                values[k, row, 0] = error / f32(rows)  # from here on the gradient in the value
            errors[batch, k] = f32(0.5) * total / f32(rows)
        gradients(x, network, hidden, values, grad)
        for i in range(len(flat)):
            grad[i] += f32(2) * l2 * flat[i]
        # One norm over all critics, as `adam.clip_grad_norm_` takes it.
        length = np.sqrt(sum_of_squares(grad))
        share = f32(max_norm / (length + 1e-6)) if length > max_norm else f32(1)
        count += 1
        adam(flat, grad, share, first, second, count, rate)
    return count


@kernel(fastmath=False, allocates=False)
def adam(flat, grad, share, first, second, count, rate):
    """Take step number `count` of Adam down `share` times the gradient, with β₁ = 0.9, β₂ = 0.999, ε = 1e-8."""
    # Both bias corrections are scalars, so that the loop divides only once per parameter.
    step = f32(rate / (1.0 - 0.9**count))
    scale = f32(np.sqrt(1.0 - 0.999**count))
    for i in range(len(flat)):
        slope = share * grad[i]
        first[i] = f32(0.9) * first[i] + f32(0.1) * slope
        second[i] = f32(0.999) * second[i] + f32(0.001) * slope * slope
        flat[i] -= step * first[i] / (np.sqrt(second[i]) / scale + f32(1e-8))


@kernel(fastmath=False)
def sum_of_squares(values):
    """Return the sum of squares of values [P]."""
    # Sixteen partial sums fill the vector registers without `fastmath`; the order of additions stays fixed.
    lanes = np.zeros(16, np.float32)
    full = len(values) - len(values) % 16
    for i in range(0, full, 16):
        for lane in range(16):
            lanes[lane] += values[i + lane] * values[i + lane]
    total = 0.0
    for lane in range(16):
        total += lanes[lane]
    for i in range(full, len(values)):
        total += values[i] * values[i]
    return total


@kernel(fastmath=False)
def parameters(flat, sizes, layer, k, count, offset):
    """Return weight [before, after] and bias [after] of network k in the layer that begins at `offset`, and the offset
    of the next layer."""
    before, after = sizes[layer], sizes[layer + 1]
    first = offset + k * before * after
    weight = flat[first : first + before * after].reshape((before, after))
    offset += count * before * after
    return weight, flat[offset + k * after : offset + (k + 1) * after], offset + count * after


@kernel(fastmath=False, allocates=False)
def affine(x, weight, bias, into):
    """Set `into` to x weight + bias, for x [B, before] in any layout."""
    rows, before = x.shape
    after = weight.shape[1]
    full = before - before % 4
    for row in range(rows):
        for j in range(after):
            into[row, j] = bias[j]
        # Four rows of the weights at a time: the result is read and written a quarter as often.
        for i in range(0, full, 4):
            x0, x1, x2, x3 = x[row, i], x[row, i + 1], x[row, i + 2], x[row, i + 3]
            for j in range(after):
                low = x0 * weight[i, j] + x1 * weight[i + 1, j]
                into[row, j] += low + (x2 * weight[i + 2, j] + x3 * weight[i + 3, j])
        for i in range(full, before):
            for j in range(after):
                into[row, j] += x[row, i] * weight[i, j]


@kernel(fastmath=False, allocates=False)
def activate(values, activation):
    """Apply tanh or ReLU in place."""
    for row in range(values.shape[0]):
        for j in range(values.shape[1]):
            values[row, j] = tanh(values[row, j]) if activation == TANH else max(values[row, j], f32(0))


@kernel(fastmath=False, allocates=False)
def through_activation(grad, after, activation):
    """Multiply a gradient, in place, by the derivative of the activation that gave `after`."""
    for row in range(grad.shape[0]):
        for j in range(grad.shape[1]):
            value = after[row, j]
            tanh_derivative = f32(1) - value * value
            relu_derivative = f32(1) if value > f32(0) else f32(0)
            grad[row, j] *= tanh_derivative if activation == TANH else relu_derivative


@kernel(fastmath=False, inlined=True, allocates=False)
def tanh(x):
    """Return the hyperbolic tangent within 4e-7: a quotient of polynomials of x², fitted to least relative error.

    Unlike a library's function it vectorises.
    """
    x = min(max(x, -SATURATED), SATURATED)
    s = x * x
    top = s * (s * (s * f32(2.4104593e-11) - f32(1.4906096e-08)) + f32(9.939159e-06)) + f32(0.0029920954)
    top = s * (s * top + f32(0.12984909)) + f32(1)
    bottom = s * (s * (s * f32(0.00023808653) + f32(0.024053087)) + f32(0.46318227)) + f32(1)
    return x * top / bottom
