"""One step of every environment on a GPU: a thread each, from the CPU's function of one environment, in float64."""

from numba import cuda, float64

from thalweg.env.device.episode import advance_one
from thalweg.env.initial_poses import DRAWS

THREADS = 64
"""A block's: few, so that a few thousand environments are spread over the whole card."""


def advance(units, courses, limits, begins, state, outcome, ended):
    """As `beginning.advance_rows`."""
    row = cuda.grid(1)
    if row >= len(ended):
        return
    draws = cuda.local.array(DRAWS, float64)
    advance_one(row, units, courses, limits, begins, state, outcome, ended, draws)
