"""A small perceptron forwards and backwards, as compiled loops.

A product of 64 x 64 numbers takes a few microseconds, and about as many to ask a library for it; a gradient step of
three small networks asks some forty times. Here the policy's asks twice, and that of critics on-policy only once a
pass. Nothing is reordered (no `fastmath`), so that a machine gives the same bits whenever it compiled.

Letters: K networks, B rows, L layers; `sizes` [L + 1] holds the numbers before and after each layer, and `flat` their
parameters as `networks.layers_of` cuts them.
"""

import numpy as np

from thalweg.core.jit import kernel

f32 = np.float32
TANH, RELU = 0, 1
SATURATED = f32(7.9)
"""Beyond it tanh is less than three ten-millionths from 1, and counts as it is here."""


@kernel(fastmath=False)
def outputs(x, flat, sizes, activation, hidden, result):
    """Fill `result` [K, B, outputs] for rows `x` [B, D], and `hidden` [K, B * Σ hidden sizes] with what each inner
    layer gave, layer after layer."""
    rows, layers = x.shape[0], len(sizes) - 1
    for k in range(len(result)):
        before, at, place = x, 0, 0
        for layer in range(layers):
            weight, bias, at = parameters(flat, sizes, layer, k, len(result), at)
            after = sizes[layer + 1]
            if layer == layers - 1:
                affine(before, weight, bias, result[k])
            else:
                into = hidden[k, place : place + rows * after].reshape((rows, after))
                place += rows * after
                affine(before, weight, bias, into)
                activate(into, activation)
                before = into


@kernel(fastmath=False)
def gradients(x, flat, sizes, activation, hidden, above, slopes):
    """Fill `slopes`, which is cut like `flat`, from the gradient `above` [K, B, outputs] and what `outputs` left."""
    rows, layers = x.shape[0], len(sizes) - 1
    for k in range(len(above)):
        slope, at, place = above[k], len(flat), hidden.shape[1]
        for layer in range(layers - 1, -1, -1):
            before, after = sizes[layer], sizes[layer + 1]
            at -= len(above) * (before + 1) * after
            weight, _, _ = parameters(flat, sizes, layer, k, len(above), at)
            weight_slope, bias_slope, _ = parameters(slopes, sizes, layer, k, len(above), at)
            bias_slope[:] = f32(0)
            for row in range(rows):
                for j in range(after):
                    bias_slope[j] += slope[row, j]
            nothing = np.zeros(after, np.float32)
            if layer == 0:
                affine(x.T, slope, nothing, weight_slope)
            else:
                place -= rows * before
                seen = hidden[k, place : place + rows * before].reshape((rows, before))
                affine(seen.T, slope, nothing, weight_slope)
                below = np.empty((rows, before), np.float32)
                affine(slope, np.ascontiguousarray(weight.T), np.zeros(before, np.float32), below)
                through(below, seen, activation)
                slope = below


@kernel(fastmath=False)
def regress(inputs, targets, bounds, flat, sizes, activation, first, second, count, rate, decay, most, errors):
    """One step of Adam of K critics for each stretch of rows between `bounds`, down the gradient of ½ E[(V - target)²]
    of each and `decay` times the sum of squares of `flat`, shortened to the length `most`; returns the count of steps.

    `inputs` [B, D], `targets` [B, K]; `first` and `second` are Adam's means, `count` its steps so far, and `errors`
    [stretches, K] is filled with ½ E[(V - target)²].
    """
    critics, inner = targets.shape[1], np.sum(sizes[1:-1])
    slopes = np.empty_like(flat)
    for part in range(len(bounds) - 1):
        x, aims = inputs[bounds[part] : bounds[part + 1]], targets[bounds[part] : bounds[part + 1]]
        rows = len(x)
        hidden = np.empty((critics, rows * inner), np.float32)
        found = np.empty((critics, rows, 1), np.float32)
        outputs(x, flat, sizes, activation, hidden, found)
        for k in range(critics):
            total = f32(0)
            for row in range(rows):
                error = found[k, row, 0] - aims[row, k]
                total += error * error
                found[k, row, 0] = error / f32(rows)
            errors[part, k] = f32(0.5) * total / f32(rows)
        gradients(x, flat, sizes, activation, hidden, found, slopes)
        for i in range(len(flat)):
            slopes[i] += f32(2) * decay * flat[i]
        length = np.sqrt(sum_of_squares(slopes))
        share = f32(most / (length + 1e-6)) if length > most else f32(1)
        count += 1
        adam(flat, slopes, share, first, second, count, rate)
    return count


@kernel(fastmath=False)
def adam(flat, slopes, share, first, second, count, rate):
    """Step number `count` of Adam, down `share` times the slopes, with β₁ = 0.9, β₂ = 0.999, ε = 1e-8."""
    step = f32(rate / (1.0 - 0.9**count))
    scale = f32(np.sqrt(1.0 - 0.999**count))
    for i in range(len(flat)):
        slope = share * slopes[i]
        first[i] = f32(0.9) * first[i] + f32(0.1) * slope
        second[i] = f32(0.999) * second[i] + f32(0.001) * slope * slope
        flat[i] -= step * first[i] / (np.sqrt(second[i]) / scale + f32(1e-8))


@kernel(fastmath=False)
def sum_of_squares(values):
    """In sixteen sums beside each other, which go together."""
    lanes = np.zeros(16, np.float32)
    whole = len(values) - len(values) % 16
    for i in range(0, whole, 16):
        for lane in range(16):
            lanes[lane] += values[i + lane] * values[i + lane]
    total = 0.0
    for lane in range(16):
        total += lanes[lane]
    for i in range(whole, len(values)):
        total += values[i] * values[i]
    return total


@kernel(fastmath=False)
def parameters(flat, sizes, layer, k, count, at):
    """Weight [before, after] and bias [after] of network k in a layer that begins at `at`, and where the next layer
    begins."""
    before, after = sizes[layer], sizes[layer + 1]
    first = at + k * before * after
    weight = flat[first : first + before * after].reshape((before, after))
    at += count * before * after
    return weight, flat[at + k * after : at + (k + 1) * after], at + count * after


@kernel(fastmath=False)
def affine(x, weight, bias, into):
    """into = x weight + bias, for x [B, before] in any layout."""
    rows, before = x.shape
    after = weight.shape[1]
    whole = before - before % 4
    for row in range(rows):
        for j in range(after):
            into[row, j] = bias[j]
        for i in range(0, whole, 4):
            x0, x1, x2, x3 = x[row, i], x[row, i + 1], x[row, i + 2], x[row, i + 3]
            for j in range(after):
                low = x0 * weight[i, j] + x1 * weight[i + 1, j]
                into[row, j] += low + (x2 * weight[i + 2, j] + x3 * weight[i + 3, j])
        for i in range(whole, before):
            for j in range(after):
                into[row, j] += x[row, i] * weight[i, j]


@kernel(fastmath=False)
def activate(values, activation):
    """tanh or relu, in place."""
    for row in range(values.shape[0]):
        for j in range(values.shape[1]):
            values[row, j] = tanh(values[row, j]) if activation == TANH else max(values[row, j], f32(0))


@kernel(fastmath=False)
def through(slopes, after, activation):
    """A gradient through an activation that gave `after`, in place."""
    for row in range(slopes.shape[0]):
        for j in range(slopes.shape[1]):
            value = after[row, j]
            tanh_slope = f32(1) - value * value
            relu_slope = f32(1) if value > f32(0) else f32(0)
            slopes[row, j] *= tanh_slope if activation == TANH else relu_slope


@kernel(fastmath=False, inlined=True)
def tanh(x):
    """Within 4e-7 of the hyperbolic tangent: a quotient of polynomials of x², fitted to least relative error. Unlike a
    library's function it vectorises."""
    x = min(max(x, -SATURATED), SATURATED)
    s = x * x
    top = s * (s * (s * f32(2.4104593e-11) - f32(1.4906096e-08)) + f32(9.939159e-06)) + f32(0.0029920954)
    top = s * (s * top + f32(0.12984909)) + f32(1)
    bottom = s * (s * (s * f32(0.00023808653) + f32(0.024053087)) + f32(0.46318227)) + f32(1)
    return x * top / bottom
