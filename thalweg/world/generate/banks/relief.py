"""The shape of banks that are not forest: the low lip of a meadow, the marsh under reeds, the wall of a quay.

Each kind has a profile of heights over the distance from the water's edge, at which all of them are 0, so that the map
and the rules agree on where the water ends. Further out it blends into the valley as it was.
"""

from dataclasses import replace

import numpy as np

from thalweg.world.banks import QUAY_FALL, QUAY_TOE_M, QUAY_TOE_SLOPE, QUAY_WALL_M, quay_run_m, quay_slope
from thalweg.world.generate.banks.zones import Zones
from thalweg.world.generate.terrain import Terrain, axes, raise_causeway
from thalweg.world.noise import fractal, smooth_step

f4 = np.float32

LIP_M, LIP_SLOPE = 0.62, 0.95
"""Height that the bank of a meadow rises to, and its slope at the water."""
MARSH_M, MARSH_SLOPE = 0.32, 0.20
"""The same under reeds."""
MEADOW_TO_M = (8.0, 45.0)
"""Distances between which a meadow rises to the hills."""
MARSH_TO_M = (3.5, 12.0)
"""Distances between which the marsh rises to the forest."""
BUMPS_M = 0.05
"""Standard deviation of the unevenness of a meadow."""
MEADOW_BED = 0.55
"""Slope of the bed at a meadow's bank; it goes on for `MEADOW_BED_M`."""
MEADOW_BED_M = 0.7
FOOT_M = 0.95
"""Depth of the water at the foot of the wall, and the distances from it between which that blends into the bed."""
FOOT_TO_M = (1.0, 3.2)
ROUND_M = 0.25
"""Half width of the rounding of the wall's edge and foot."""
QUAY_TO_M = (7.5, 24.0)
"""Distances between which the land behind a quay blends into the valley."""
ISLAND_FREE_M = (0.4, 2.0)
"""Distances from an island between which a bank's bed begins."""


def shaped(terrain: Terrain, zones: Zones, bridge_rows: np.ndarray, rng: np.random.Generator) -> Terrain:
    """Return the terrain with the ground of its banks; bridges [B, 11] keep their causeways."""
    height = terrain.ground_m - terrain.water_m
    land, bed = zones.bank_m > 0, (zones.bank_m <= 0) & (zones.island_m > 0)
    d = np.maximum(zones.bank_m, f4(0))
    under = np.maximum(-zones.bank_m, f4(0))
    depth = np.maximum(-height, f4(0))
    free = smooth_step(*ISLAND_FREE_M, zones.island_m)
    new = height.copy()
    for kind, share in zones.share.items():
        target = LAND[kind](d, height, terrain.grid.cell_m, rng)
        deeper = np.maximum(depth, BED[kind](under, terrain.grid.cell_m) * free)
        new += np.where(land, share * (target - height), f4(0))
        new -= np.where(bed, share * (deeper - depth), f4(0))
    ground = (terrain.water_m + new).astype(np.float32)
    x, y = (values.astype(np.float32) for values in axes(terrain.grid, ground.shape))
    clear = terrain.keep_clear.copy()
    for row in bridge_rows:
        raise_causeway(ground, terrain.water_m, zones.bank_m, clear, x, y, row)
    return replace(terrain, ground_m=ground)


def _saturated(d: np.ndarray, slope: float, most: float) -> np.ndarray:
    """Return heights that begin with a slope and level off, P (1 - exp(-m x / P)), as the land of the valley does."""
    return f4(most) * (f4(1) - np.exp(f4(-slope / most) * d))


def _meadow(d: np.ndarray, height: np.ndarray, cell_m: float, rng: np.random.Generator) -> np.ndarray:
    lip = _saturated(d, LIP_SLOPE, LIP_M)
    bumps = f4(BUMPS_M) * fractal(d.shape, cell_m, 6.0, 3, rng, gain=0.6) * smooth_step(0.3, 3.0, d)
    return _rejoined(lip + bumps, d, height, MEADOW_TO_M)


def _reeds(d: np.ndarray, height: np.ndarray, cell_m: float, rng: np.random.Generator) -> np.ndarray:
    return _rejoined(_saturated(d, MARSH_SLOPE, MARSH_M), d, height, MARSH_TO_M)


def _quay(d: np.ndarray, height: np.ndarray, cell_m: float, rng: np.random.Generator) -> np.ndarray:
    top = f4(QUAY_WALL_M) + f4(QUAY_FALL) * np.clip(d - f4(quay_run_m(cell_m)), 0.0, QUAY_TO_M[1])
    return _rejoined(_wall(d, top, cell_m), d, height, QUAY_TO_M)


def _wall(d: np.ndarray, top: np.ndarray, cell_m: float) -> np.ndarray:
    """Return the heights of a quay at distances from the water's edge, or its depths: a low toe, then the wall to
    `top`."""
    slope = quay_slope(cell_m)
    soft = slope * max(ROUND_M, cell_m)
    toe, wall = f4(QUAY_TOE_SLOPE) * d, f4(slope) * (d - f4(QUAY_TOE_M))
    # The higher of two is the negative of the lower of their negatives; less round, so that it is 0 at the edge.
    return _lower(-_lower(-toe, -wall, min(0.75 * soft, slope * QUAY_TOE_M)), top, soft)


def _lower(one: np.ndarray, other: np.ndarray, soft_m: float) -> np.ndarray:
    """Return the lower of two heights, rounded where they are less than `soft_m` apart: nodes can't hold a sharp
    edge."""
    near = np.maximum(f4(soft_m) - np.abs(one - other), f4(0))
    return np.minimum(one, other) - near * near / f4(4.0 * soft_m)


def _rejoined(target: np.ndarray, d: np.ndarray, height: np.ndarray, between_m: tuple[float, float]) -> np.ndarray:
    """Return heights that go from those of a bank to those of the valley between two distances."""
    return target + smooth_step(*between_m, d) * (height - target)


def _meadow_bed(under: np.ndarray, cell_m: float) -> np.ndarray:
    return f4(MEADOW_BED) * np.minimum(under, f4(MEADOW_BED_M)) * (f4(1) - smooth_step(0.8, 2.0, under))


def _reed_bed(under: np.ndarray, cell_m: float) -> np.ndarray:
    return np.zeros_like(under)


def _quay_bed(under: np.ndarray, cell_m: float) -> np.ndarray:
    foot = _wall(under, np.full_like(under, FOOT_M), cell_m)
    return foot * (f4(1) - smooth_step(*FOOT_TO_M, under))


LAND = {"meadow": _meadow, "reeds": _reeds, "quay": _quay}
"""Height of the land above the water at a distance from its edge."""
BED = {"meadow": _meadow_bed, "reeds": _reed_bed, "quay": _quay_bed}
"""Least depth of the water at a distance from its edge."""
