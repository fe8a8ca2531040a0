"""Filters of the Dryden model: gusts of unit variance from white noise, exact at the times of the steps.

A longitudinal gust has the spectrum of 1 / (1 + T s), a lateral or vertical one that of (1 + sqrt(3) T s) / (1 + T s)^2
(MIL-F-8785C, section 3.7.2), where T is the length of the gusts over the speed at which they pass. Their
autocorrelations are exp(-t / T) and (1 - t / 2T) exp(-t / T).

The second filter is a chain of two lags, x1' = -x1 / T + noise and x2' = (x1 - x2) / T, whose stationary covariance is
P = [[1, 1/2], [1/2, 1/2]]; the gust is (sqrt(3) x1 + (1 - sqrt(3)) x2) / sqrt(2). Over a step the chain moves by
F = exp(-h) [[1, 0], [h, 1]] with h = step / T, and gains noise of covariance P - F P F^T, as any stationary
Gauss-Markov process does: the values at the steps are distributed as those of the continuous filter, whatever the step.
"""

import math

from thalweg.core.compute.jit import kernel

ROOT_3 = math.sqrt(3.0)


@kernel(fastmath=False, allocates=False)
def step_single(x, h, noise):
    """Return the state of the longitudinal filter after a step of `h` time constants; noise is standard normal."""
    decay = math.exp(-h)
    return decay * x + math.sqrt(1.0 - decay * decay) * noise


@kernel(fastmath=False, allocates=False)
def step_chain(x1, x2, h, noise_1, noise_2):
    """Return both states of the lateral filter after a step of `h` time constants; the noises are standard normal."""
    decay = math.exp(-h)
    squared = decay * decay
    # Covariance of the noise, and its Cholesky factor [[a, 0], [b, c]].
    q11 = 1.0 - squared
    q12 = 0.5 - squared * (h + 0.5)
    q22 = 0.5 - squared * (h * h + h + 0.5)
    a = math.sqrt(q11)
    b = q12 / a if a > 0.0 else 0.0
    c = math.sqrt(max(q22 - b * b, 0.0))  # rounding may leave a number below zero for steps of nearly no time
    return decay * x1 + a * noise_1, decay * (h * x1 + x2) + b * noise_1 + c * noise_2


@kernel(fastmath=False, allocates=False)
def first_chain(noise_1, noise_2):
    """Return both states of the lateral filter from its stationary distribution; the noises are standard normal."""
    return noise_1, 0.5 * (noise_1 + noise_2)


@kernel(fastmath=False, allocates=False)
def chain_output(x1, x2):
    """Return the gust, of unit variance, of the lateral filter."""
    return (ROOT_3 * x1 + (1.0 - ROOT_3) * x2) * math.sqrt(0.5)
