"""A small winding valley for the tests of paint, plants and light, made without the generator."""

import numpy as np
from scipy.ndimage import distance_transform_edt

from thalweg.world.record import Grid


def valley(size: int = 320, cell_m: float = 0.25, half_width_m: float = 4.0):
    """A channel that winds from west to east: (grid, ground_m, water_m, shore_m, keep_clear), maps [size, size]."""
    grid = Grid(origin_x_m=-0.5 * size * cell_m, origin_y_m=-0.5 * size * cell_m, cell_m=cell_m)
    x = grid.origin_x_m + cell_m * np.arange(size)[None, :]
    y = grid.origin_y_m + cell_m * np.arange(size)[:, None]
    span = size * cell_m
    middle = 0.12 * span * np.sin(2.0 * np.pi * x / (0.6 * span))
    slope = 0.12 * span * 2.0 * np.pi / (0.6 * span) * np.cos(2.0 * np.pi * x / (0.6 * span))
    land = np.abs(y - middle) / np.sqrt(1.0 + slope**2) > half_width_m
    inward, outward = np.asarray(distance_transform_edt(land)), np.asarray(distance_transform_edt(~land))
    shore = np.where(land, inward - 0.5, 0.5 - outward) * cell_m
    ground = np.where(shore < 0.0, np.maximum(shore * 0.5, -1.3), 0.16 * shore + 0.002 * shore**2)
    ground += np.where(
        shore > 12.0, 0.6 * np.sin(x / 9.0) * np.cos(y / 7.0) * np.clip((shore - 12.0) / 10.0, 0, 1), 0.0
    )
    as_map = lambda a: np.ascontiguousarray(np.broadcast_to(a, (size, size)), dtype=np.float32)  # noqa: E731
    return grid, as_map(ground), np.zeros((size, size), np.float32), as_map(shore), np.zeros((size, size), bool)
