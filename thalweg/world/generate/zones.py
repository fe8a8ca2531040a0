"""Where does the sand end, and where does the forest begin? Two wavy distances from the water that paint and
plants share.

Both the colour of the ground and the places of the plants follow them, so that litter lies under the trees and
nowhere else. They depend on the map's size alone, never on a seed, so that the two callers agree without sharing
state.
"""

import numpy as np

from thalweg.world.noise import fractal, smooth_step
from thalweg.world.record import Grid

SAND_M = (2.4, 5.8)
"""Narrowest and widest band of sand along the water."""
FOREST_M = (4.8, 10.0)
"""Nearest and farthest distance of the forest's edge from the water, but for the places where it comes down to the
shore."""
SHORE_FOREST_M = 2.6
"""Distance of the forest's edge where it comes down to the shore."""
_PATTERN = 7919


def sand_edge_m(grid: Grid, shape: tuple[int, int]) -> np.ndarray:
    """[GY, GX] float32: how far from the water sand gives way to grass, in metres."""
    rng = np.random.default_rng(_PATTERN)
    wave = fractal(shape, grid.cell_m, 34.0, 3, rng, gain=0.6)
    low, high = SAND_M
    return (low + (high - low) * smooth_step(-1.6, 1.6, wave)).astype(np.float32)


def forest_edge_m(grid: Grid, shape: tuple[int, int]) -> np.ndarray:
    """[GY, GX] float32: how far from the water the forest begins, in metres."""
    rng = np.random.default_rng(_PATTERN + 1)
    wave = fractal(shape, grid.cell_m, 28.0, 3, rng, gain=0.65)
    close = smooth_step(1.05, 1.45, fractal(shape, grid.cell_m, 40.0, 2, rng, gain=0.5))
    low, high = FOREST_M
    edge = low + (high - low) * smooth_step(-1.7, 1.7, wave)
    return (edge + (SHORE_FOREST_M - edge) * close).astype(np.float32)
