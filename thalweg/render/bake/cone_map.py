"""The cone map: over each cell of the height field, a cone that no surface pierces."""

from functools import partial

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.core.compute.threads import run_in_threads
from thalweg.render.records.layout import CONE_CELL

f32 = np.float32


def cone_map(top: np.ndarray, cell_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the height and slope [CY, CX] float32 of the cone above each cell that no surface of `top` [GY, GX]
    pierces.

    Source: cone step mapping (Dummer 2006), here per cell instead of per node: conservative between nodes too.
    """
    rows, columns = (-(-s // CONE_CELL) for s in top.shape)
    padded = np.pad(
        top, [(0, rows * CONE_CELL - top.shape[0] + 1), (0, columns * CONE_CELL - top.shape[1] + 1)], mode="edge"
    )
    highest = np.full((rows, columns), -np.inf, np.float32)
    for dy in range(CONE_CELL + 1):
        for dx in range(CONE_CELL + 1):
            corner = padded[dy : dy + rows * CONE_CELL : CONE_CELL, dx : dx + columns * CONE_CELL : CONE_CELL]
            highest = np.maximum(highest, corner[:rows, :columns])
    ring = np.pad(highest, 1, mode="edge")
    height = np.max([ring[y : y + rows, x : x + columns] for y in range(3) for x in range(3)], axis=0)
    far = np.pad(highest, [(0, -rows % 4), (0, -columns % 4)], mode="edge")
    coarse = far.reshape(far.shape[0] // 4, 4, far.shape[1] // 4, 4).max(axis=(1, 3))
    slope = np.zeros((rows, columns), np.float32)
    cell = f32(cell_m * CONE_CELL)
    run_in_threads(rows, partial(_cone_slope, slope, highest, height, np.ascontiguousarray(coarse), cell))
    return height.astype(np.float32), slope


@kernel(fastmath=False)
def _cone_slope(slope, highest, height, coarse, cell, first, last):
    """Fill the rows first to last of slope [CY, CX]."""
    rows, columns = highest.shape
    near = 12
    reach = 24
    summit = coarse.max()
    for r in range(first, last):
        for c in range(columns):
            base = height[r, c]
            best = max(f32(0.02), (summit - base) / (f32(4 * reach - 4) * cell))
            for y in range(max(r - near, 0), min(r + near + 1, rows)):
                gap_y = f32(max(abs(y - r) - 1, 0))
                for x in range(max(c - near, 0), min(c + near + 1, columns)):
                    gap_x = f32(max(abs(x - c) - 1, 0))
                    apart = np.sqrt(gap_x * gap_x + gap_y * gap_y) * cell
                    rise = highest[y, x] - base
                    best = max(best, rise / apart if apart > f32(0) else f32(0))
            for y in range(max(r // 4 - reach, 0), min(r // 4 + reach + 1, coarse.shape[0])):
                gap_y = f32(max(max(y * 4 - r, r - y * 4 - 3) - 1, 0))
                for x in range(max(c // 4 - reach, 0), min(c // 4 + reach + 1, coarse.shape[1])):
                    gap_x = f32(max(max(x * 4 - c, c - x * 4 - 3) - 1, 0))
                    apart = np.sqrt(gap_x * gap_x + gap_y * gap_y)
                    rise = coarse[y, x] - base
                    best = max(best, rise / (apart * cell) if apart > f32(near - 5) else f32(0))
            slope[r, c] = best
