"""Compiled evaluation of a categorical policy: the network and the choice of options in one call, for small batches.

PyTorch needs about twenty calls for the same. Both take the same random numbers from the generator. It is part of the
fast path, see `fast_path`.

Letters: N environments, D numbers of an observation, A branches, K options of a branch.
"""

from typing import NamedTuple

import numpy as np

from thalweg.algos.policy import mlp_numba
from thalweg.core.compute.jit import kernel

f32 = np.float32
MAX_ROWS = 256
"""Largest number of observations for which the compiled loops are faster than PyTorch."""


class Scaling(NamedTuple):
    """How observations are normalised: (x - shift) * scale, clipped to ± clip."""

    shift: np.ndarray
    """[D] float32."""
    scale: np.ndarray
    """[D] float32."""
    clip: np.float32


@kernel(fastmath=False)
def draw_options(obs, scaling, network, sizes, uniform, chosen):
    """Fill `chosen` [N, A] int64 with options for raw observations [N, D].

    `sizes` [A] holds K of each branch. `uniform` [N, A] in [0, 1) is what they are drawn with, as in
    `thalweg.algos.maths.categorical.drawn`; if it has no rows, the most probable options are taken.
    """
    logits = _logits(obs, scaling, network)
    for row in range(len(chosen)):
        first = 0
        for branch in range(len(sizes)):
            weights = logits[row, first : first + sizes[branch]]
            first += sizes[branch]
            top = np.argmax(weights)
            if len(uniform) == 0:
                chosen[row, branch] = top
                continue
            largest, total = weights[top], f32(0)
            for k in range(len(weights)):
                total += np.exp(weights[k] - largest)
                weights[k] = total  # from here on the sum up to this option
            option = 0
            while option < len(weights) - 1 and uniform[row, branch] * total >= weights[option]:
                option += 1
            chosen[row, branch] = option


@kernel(fastmath=False)
def _logits(obs, scaling, network):
    """Return the logits [N, Σ K] of a network of one perceptron."""
    rows, layer_sizes = len(obs), network.sizes
    x = np.empty(obs.shape, np.float32)
    for row in range(rows):
        for j in range(obs.shape[1]):
            value = (obs[row, j] - scaling.shift[j]) * scaling.scale[j]
            x[row, j] = min(max(value, -scaling.clip), scaling.clip)
    hidden = np.empty((1, rows * np.sum(layer_sizes[1:-1])), np.float32)
    result = np.empty((1, rows, layer_sizes[-1]), np.float32)
    mlp_numba.outputs(x, network, hidden, result)
    return result[0]
