"""CUDA kernel of `thalweg.env.device.step`: one thread per environment, in float64."""

from numba import cuda, float64

from thalweg.env.device.step import advance_one
from thalweg.env.initial_poses import DRAWS

THREADS = 64
"""Threads of a block: few, so that a few thousand environments are spread over the whole GPU."""


def advance(actions, courses, limits, reset, state, outcome, ended):
    """As `step.advance_all`."""
    row = cuda.grid(1)
    if row >= len(ended):
        return
    draws = cuda.local.array(DRAWS, float64)
    advance_one(row, actions, courses, limits, reset, state, outcome, ended, draws)
