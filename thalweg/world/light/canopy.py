"""The canopy: the heights of crowns and bridges over each node, and the share of light that they stop from above."""

import math
from functools import partial

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.core.compute.threads import run_in_threads
from thalweg.world.light.crowns import HEIGHT, KIND, OUTLINE, RADIUS, X, Y, Z, crown_depth
from thalweg.world.light.sun_shadow import BAND_ROWS, band_count
from thalweg.world.record import PARAPET_THICKNESS_M, Grid

f4 = np.float32

TALL_M = 4.0
"""Height from which a plant hides the sky from its neighbours. A lower one shades only the ground under it, in
proportion to its height."""


def crown_roof(surface, frame, crowns, outline, roof, tile) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return three maps [GY, GX] float32: the height of all crowns' tops, that of tall plants' tops, and the cover.

    The cover is the share of light from straight above that the crowns stop. crowns: the table of plants, their boxes,
    and the starts and members of each band of rows, as for `sun_shadow.add_plant_depth`.
    """
    maps = surface.copy(), surface.copy(), np.zeros(surface.shape, np.float32)
    fill = partial(_crown_roof_bands, maps, surface, frame, crowns, outline, roof, tile)
    run_in_threads(band_count(len(surface)), fill)
    return maps


@kernel(fastmath=False)
def _crown_roof_bands(maps, surface, frame, crowns, outline, roof, tile, first, last):
    """Fill the bands of rows first to last of the three maps of `crown_roof`."""
    canopy, tall, cover = maps
    table, boxes, starts, members = crowns
    rows, columns = surface.shape
    # Straight up, with the tilt that `sun_ray` gives a sun at the zenith.
    up = np.array([f4(1e-4), f4(0.0), f4(1.0)])
    for band in range(first, last):
        # One thread writes each band, with its plants in a fixed order: the sums do not depend on the threads.
        for member in range(starts[band], starts[band + 1]):
            plant = table[members[member]]
            weight = min(plant[HEIGHT] / f4(TALL_M), f4(1.0))
            last = min(boxes[members[member], 1] + 1, min(rows, (band + 1) * BAND_ROWS))
            for i in range(max(boxes[members[member], 0], band * BAND_ROWS), last):
                dy = frame[1] + f4(i) * frame[2] - plant[Y]
                for j in range(boxes[members[member], 2], boxes[members[member], 3] + 1):
                    dx = frame[0] + f4(j) * frame[2] - plant[X]
                    share = math.sqrt(dx * dx + dy * dy) / plant[RADIUS]
                    if share <= f4(1.0):
                        level = roof[int(plant[KIND]), int(share * f4(OUTLINE - 1) + f4(0.5))]
                        top = plant[Z] + level * plant[HEIGHT]
                        canopy[i, j] = max(canopy[i, j], top)
                        tall[i, j] = max(tall[i, j], top if plant[HEIGHT] >= f4(TALL_M) else tall[i, j])
                        # Low plants hide less: their weight is their height over TALL_M.
                        z = surface[i, j] - plant[Z]
                        cover[i, j] += weight * crown_depth(plant, dx, dy, z, up, outline, tile, members[member])
        # From optical depth to the stopped share (Beer-Lambert).
        for i in range(band * BAND_ROWS, min(rows, (band + 1) * BAND_ROWS)):
            for j in range(columns):
                cover[i, j] = f4(1.0) - math.exp(-cover[i, j])


def deck_heights(grid: Grid, shape: tuple[int, int], bridge: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return whether a node lies under a bridge [11], and the height of deck or parapet over it; both [GY, GX]."""
    x = grid.origin_x_m + grid.cell_m * np.arange(shape[1])[None, :]
    y = grid.origin_y_m + grid.cell_m * np.arange(shape[0])[:, None]
    cos, sin = math.cos(bridge[2]), math.sin(bridge[2])
    u = (x - bridge[0]) * cos + (y - bridge[1]) * sin
    v = (y - bridge[1]) * cos - (x - bridge[0]) * sin
    on = (np.abs(u) <= 0.5 * bridge[3]) & (np.abs(v) <= 0.5 * bridge[4])
    top = bridge[8] - bridge[9] * (2.0 * u / bridge[3]) ** 2
    return on, top + np.where(np.abs(v) > 0.5 * bridge[4] - PARAPET_THICKNESS_M, bridge[10], 0.0)


def raise_bridges(canopy: np.ndarray, tall: np.ndarray, cover: np.ndarray, grid: Grid, bridges: np.ndarray) -> None:
    """Raise canopy and tall [GY, GX] to the tops of the bridges [B, 11] and set cover [GY, GX] to 1 under them.

    All three are changed in place.
    """
    for bridge in bridges:
        on, top = deck_heights(grid, canopy.shape, bridge)
        for tops in (canopy, tall):
            tops[on] = np.maximum(tops[on], top[on])
        cover[on] = 1.0
