"""The optical depth of plants: crowns as leafy bodies of revolution with the outlines of their kinds, and trunks.

A crown is intersected at a few heights, as flat whorls of leaf clumps with gaps between them. This gives the ragged
outlines and light flecks of a real shadow, which a homogeneous body would not. The clumps come from one tile of noise,
shifted by plant and whorl.
"""

import math

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.world.noise import smooth_step
from thalweg.world.record import Plants
from thalweg.world.species import KINDS

f4 = np.float32

LEVELS = 7
"""Number of whorls at which a ray meets a crown."""
TILE = 128
"""Nodes along a side of the repeating tile of clumps."""
TILE_CELL_M = 0.14
"""Size of a node of the tile."""
OUTLINE = 33
"""Samples of a crown's outline from the foot of the plant to its top."""
STONE = f4(20.0)
"""Extinction per metre above which a body is solid, without gaps."""

X, Y, Z, HEIGHT, RADIUS, BASE, EXTINCTION, TRUNK, KIND = range(9)
"""Columns of the table of plants."""


def plant_table(plants: Plants) -> np.ndarray:
    """Return [M, 9] float32 what the kernels need of each plant: columns X to KIND, in metres and 1/m."""
    kinds = [KINDS[k] for k in plants.kind]
    table = np.zeros((len(plants.kind), 9), np.float32)
    table[:, X : Z + 1] = plants.position_m
    table[:, HEIGHT] = plants.height_m
    table[:, RADIUS] = 0.5 * plants.width_m
    table[:, BASE] = [kind.clear_trunk for kind in kinds]
    table[:, EXTINCTION] = [kind.density_per_m for kind in kinds]
    table[:, TRUNK] = plants.height_m * np.array([kind.trunk_radius for kind in kinds], np.float32)
    table[:, KIND] = plants.kind
    return table


def outlines() -> np.ndarray:
    """Return [K, OUTLINE] float32 the crown radius of each kind from foot to top, as a share of the half width."""
    shares = np.linspace(0.0, 1.0, OUTLINE)
    return np.array([kind.crown_radius(shares) for kind in KINDS], np.float32)


def clump_tile(seed: int = 20) -> np.ndarray:
    """Return [TILE, TILE] float32 of mean 1: leaf clumps about a metre across with gaps between them; it repeats."""
    rng = np.random.default_rng(seed)
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(TILE, TILE_CELL_M), np.fft.fftfreq(TILE, TILE_CELL_M)))
    spectrum = np.fft.fft2(rng.standard_normal((TILE, TILE))) / (1.0 + (frequency / 0.5) ** 2) ** 1.7
    spectrum[0, 0] = 0.0  # no mean
    wave = np.real(np.fft.ifft2(spectrum))
    clumps = 0.06 + smooth_step(-0.25, 0.75, (wave / wave.std()).astype(np.float32))
    return (clumps / clumps.mean()).astype(np.float32)


def roofs() -> np.ndarray:
    """Return [K, OUTLINE] float32 the height of each kind's crown top, as a share of the plant's height.

    Samples run from the axis to the greatest radius.
    """
    shares = np.linspace(1.0, 0.0, 401)
    out = np.empty((len(KINDS), OUTLINE), np.float32)
    for k, kind in enumerate(KINDS):
        reach = np.maximum.accumulate(kind.crown_radius(shares))
        first = np.searchsorted(reach, np.linspace(0.0, reach[-1], OUTLINE))
        out[k] = shares[np.minimum(first, len(shares) - 1)]
    return out


@kernel(inlined=True, fastmath=False)
def crown_depth(plant, dx, dy, z, ray, outline, tile, salt):
    """Return the optical depth of the crown on the ray from (dx, dy) off the plant's axis, at height z above its foot.

    `ray` is the unit vector (east, north, up) towards the sun; `outline` and `tile` are those of `outlines` and
    `clump_tile`; `salt` (the plant's index) shifts the clumps.
    """
    height = plant[HEIGHT]
    foot = plant[BASE] * height
    thick = (height - foot) / f4(LEVELS)
    kind = int(plant[KIND])
    solid = plant[EXTINCTION] > STONE
    depth = f4(0.0)
    for level in range(LEVELS):
        middle = foot + (f4(level) + f4(0.5)) * thick
        # A point inside a whorl sees only the part of it above the point.
        above = min(max((middle - z) / thick + f4(0.5), f4(0.0)), f4(1.0))
        if above > f4(0.0):
            # Where the ray meets the middle of the whorl, relative to the axis.
            rise = max(middle - z, f4(0.0)) / ray[2]
            x = dx + rise * ray[0]
            y = dy + rise * ray[1]
            radius = plant[RADIUS] * outline[kind, int(middle / height * f4(OUTLINE - 1) + f4(0.5))]
            share = math.sqrt(x * x + y * y) / max(radius, f4(0.01))
            if share < f4(1.5):
                # The offset of 60 m keeps the coordinates positive, so that `int` is floor; the mask wraps the tile.
                column = (int((x + f4(60.0)) / f4(TILE_CELL_M)) + salt * 37 + level * 53) & (TILE - 1)
                row = (int((y + f4(60.0)) / f4(TILE_CELL_M)) + salt * 71 + level * 29) & (TILE - 1)
                leaf = f4(1.0) if solid else tile[row, column]
                # Dense clumps reach beyond the outline and thin ones stay inside it, with a soft edge.
                edge = f4(1.0) - share + f4(0.30) * (leaf - f4(0.8))
                inside = min(max(edge * f4(5.0), f4(0.0)), f4(1.0))
                depth += above * inside * leaf
    return depth * plant[EXTINCTION] * thick / ray[2]


@kernel(inlined=True, fastmath=False)
def trunk_depth(plant, dx, dy, z, ray, blur):
    """Return the optical depth of the trunk on the ray from (dx, dy) off the plant's axis, at height z above its foot.

    `ray` is the unit vector (east, north, up) towards the sun; `blur` is half the size of the receiver in metres.
    """
    flat = math.sqrt(ray[0] * ray[0] + ray[1] * ray[1])
    # The nearest approach of the ray to the axis, seen from above: distance along the ray and beside it.
    along = -(dx * ray[0] + dy * ray[1]) / flat
    beside = abs(dx * ray[1] - dy * ray[0]) / flat
    height = z + along * ray[2] / flat
    share = height / plant[HEIGHT]
    # The trunk tapers; a trunk thinner than the receiver covers only part of it.
    radius = plant[TRUNK] * (f4(1.0) - f4(0.75) * share)
    cover = min(max((radius + blur - beside) / (f4(2.0) * blur), f4(0.0)), min(f4(1.0), radius / blur))
    inside = along > f4(-0.1) and share > f4(0.0) and share < f4(0.85)
    return f4(4.0) * cover if inside else f4(0.0)
