"""The canopy that water mirrors: heights of single crowns, banks and bridges above the water, and their colours.

Crowns have the heights of `World.canopy_m`, roughened by clumps of leaves. A crown has the mean colour of its kind in
the atlas of impostors, times its own tint, its share of the sun, and how far it faces the sun.
"""

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.render.bake import ripples
from thalweg.render.bake.impostors import VIEWS, Atlas
from thalweg.render.bake.texels import pack_colour
from thalweg.render.records.layout import CANOPY_CELL, CANOPY_RANGE_M, PAINT_RANGE
from thalweg.world.light.canopy import deck_heights
from thalweg.world.record import World
from thalweg.world.species import KINDS

STONE_RADIANCE = np.array([0.135, 0.120, 0.092])
"""Mean radiance of the sides of a bridge, one in the sun and one in the shade."""
ATLAS_LEVEL = 3
"""Mip level of the atlas from which the mean colours of kinds are taken."""
RAGGED = 0.16
"""Depth of the gaps between clumps of leaves at the top of a crown, as a share of its height, per unit of grain."""
RAGGED_M = 0.9
"""Limit of that depth."""
CLUMPS_M = 19.0
"""Side of the tile of grain that shapes the clumps."""
WET = 0.4
"""Factor on the radiance of ground at the water's edge, which is wet."""
DRY_M = 1.2
"""Height above the water from which ground is dry."""
FACING = (0.50, 1.40)
"""Factors on the colour of a crown's side that faces away from the sun, and of one that faces it."""
SHADED = 0.40
"""Share of a plant's radiance that is left where no direct sun reaches it."""
STEP = 12
"""Difference of two height codes from which the lower cell shows the side of the higher one."""


def canopy_map(world: World, lit: np.ndarray, atlas: Atlas, sun: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the heights and colours of all that water mirrors below the sky, both [Y, X] uint32.

    A cell is `CANOPY_CELL` nodes wide. Heights are above the local water's surface: the bytes of a texel are those of a
    cell, the next one in x, in y, and in both, so that one look-up fetches all that interpolation needs; a byte is the
    root of the height's share of `CANOPY_RANGE_M`. Colours are packed radiance; their fourth byte is the height of the
    plant that they belong to, coded alike, or 0 for ground and stone.

    lit: radiance of the ground [GY, GX, 3]; sun: unit vector [3] towards the sun.
    """
    surface = np.maximum(world.ground_m, world.water_m)
    crown = np.maximum(world.canopy_m - surface, 0.0)
    stone = np.zeros(surface.shape, bool)
    for bridge in world.bridges:
        stone |= deck_heights(world.grid, surface.shape, bridge)[0]
    gaps = np.clip(RAGGED * clumps(surface.shape, world.grid.cell_m) * crown, 0.0, RAGGED_M)
    rise = surface - world.water_m + crown - np.where(stone, 0.0, gaps)
    tops = coded_height(blocks(rise).max(axis=(1, 3)))
    stony = blocks(stone).any(axis=(1, 3))

    plants = crown_colours(world, atlas)
    owner = owners(world, tops.shape)
    green = (owner >= 0) & (blocks(crown).max(axis=(1, 3)) > 0.1) & ~stony
    # Rays low over the water see the wet edge, which the map of the ground has not.
    dry = np.clip(blocks(rise).mean(axis=(1, 3)) / DRY_M, 0.0, 1.0)[..., None]
    colour = blocks(lit).mean(axis=(1, 3)) * (WET + (1 - WET) * dry)
    leaves = plants[np.where(green, owner, 0)] if len(plants) else np.zeros_like(colour)
    facing = sunward(blocks(rise).mean(axis=(1, 3)), world.grid.cell_m * CANOPY_CELL, sun)
    colour = np.where(green[..., None], leaves * facing[..., None], colour)
    colour[stony] = STONE_RADIANCE
    tall = np.where(green, tops, 0).astype(np.uint32)
    colour, tall = spread_over_walls(tops, colour, tall)
    return quads(tops), pack_colour(colour, PAINT_RANGE, tall)


def blocks(a: np.ndarray) -> np.ndarray:
    """Return a map [GY, GX, ...] as [Y, CANOPY_CELL, X, CANOPY_CELL, ...], without the nodes beyond whole cells."""
    rows, columns = (s // CANOPY_CELL for s in a.shape[:2])
    whole = a[: rows * CANOPY_CELL, : columns * CANOPY_CELL]
    return whole.reshape(rows, CANOPY_CELL, columns, CANOPY_CELL, *a.shape[2:])


def clumps(shape: tuple[int, int], cell_m: float) -> np.ndarray:
    """Return grain of unit deviation about 0 at each node [GY, GX], interpolated in the tile of ripples."""
    tile = ripples.tile()[1][..., 3]
    y, x = (np.arange(s) * cell_m * len(tile) / CLUMPS_M for s in shape)
    row, column = (axis.astype(int) % len(tile) for axis in (y, x))
    v, u = (y % 1)[:, None], (x % 1)[None, :]
    next_row, next_column = (row + 1) % len(tile), (column + 1) % len(tile)
    low = tile[np.ix_(row, column)] * (1 - u) + tile[np.ix_(row, next_column)] * u
    high = tile[np.ix_(next_row, column)] * (1 - u) + tile[np.ix_(next_row, next_column)] * u
    return (low * (1 - v) + high * v - 0.5) / ripples.GRAIN_SPREAD


def coded_height(rise: np.ndarray) -> np.ndarray:
    """Return heights [...] in metres as bytes [...] uint32, which are finest near the water."""
    return np.rint(255 * np.sqrt(np.clip(rise / CANOPY_RANGE_M, 0.0, 1.0))).astype(np.uint32)


def quads(tops: np.ndarray) -> np.ndarray:
    """Return bytes [Y, X] packed with those of the next cells in x, in y and in both; the border is continued."""
    wide = np.pad(tops, ((0, 1), (0, 1)), mode="edge")
    return wide[:-1, :-1] | wide[:-1, 1:] << 8 | wide[1:, :-1] << 16 | wide[1:, 1:] << 24


def crown_colours(world: World, atlas: Atlas) -> np.ndarray:
    """Return the mean radiance [M, 3] of the crown of each plant."""
    kinds = np.empty((len(KINDS), 3))
    for kind in range(len(KINDS)):
        views = np.stack([atlas.picture(kind, view, ATLAS_LEVEL) for view in range(VIEWS)]) / 255.0
        cover = views[..., 3:]
        kinds[kind] = (views[..., :3] ** 2 * cover).sum((0, 1, 2)) / max(cover.sum(), 1e-6)
    plants = world.plants
    # The upper half of a crown is what shows above its neighbours.
    sun = (0.3 * plants.light[:, 0] + 0.7 * plants.light[:, 1])[:, None]
    return kinds[plants.kind] * plants.tint * (SHADED + (1 - SHADED) * sun)


def owners(world: World, shape: tuple[int, int]) -> np.ndarray:
    """Return the number of the plant that is highest over each cell [Y, X] int32; -1 where there is none."""
    cell = world.grid.cell_m * CANOPY_CELL
    # The middle of a cell lies between its nodes.
    middle = 0.5 * (CANOPY_CELL - 1) * world.grid.cell_m
    x = (world.plants.position_m[:, 0] - world.grid.origin_x_m - middle) / cell
    y = (world.plants.position_m[:, 1] - world.grid.origin_y_m - middle) / cell
    top = world.plants.position_m[:, 2] + world.plants.height_m
    table = np.stack([x, y, top, world.plants.height_m, world.plants.width_m / (2 * cell)], axis=1)
    owner, highest = np.full(shape, -1, np.int32), np.full(shape, -np.inf, np.float32)
    fill_owners(np.ascontiguousarray(table, np.float32), owner, highest)
    return owner


@kernel(fastmath=False, allocates=False)
def fill_owners(table, owner, highest):
    """Set owner [Y, X] to the row of the table [M, 5] (x, y, top, height, radius; cells) highest there.

    highest [Y, X]: height found so far.
    """
    rows, columns = owner.shape
    for m in range(len(table)):
        x, y, top, height, radius = table[m, 0], table[m, 1], table[m, 2], table[m, 3], table[m, 4]
        reach = radius + np.float32(0.7)
        for r in range(max(int(y - reach), 0), min(int(y + reach) + 2, rows)):
            for c in range(max(int(x - reach), 0), min(int(x + reach) + 2, columns)):
                apart = ((np.float32(c) - x) ** 2 + (np.float32(r) - y) ** 2) / (reach * reach)
                # A paraboloid stands for the crown: only which of two crowns is the higher one matters here.
                level = top - np.float32(0.5) * height * apart
                if apart < np.float32(1) and level > highest[r, c]:
                    highest[r, c] = level
                    owner[r, c] = m


def sunward(rise: np.ndarray, cell_m: float, sun: np.ndarray) -> np.ndarray:
    """Return the factor [Y, X] on the colour of crowns of heights `rise` [Y, X] by how far they face the sun."""
    slope_y, slope_x = np.gradient(rise.astype(np.float64), cell_m)
    facing = (sun[2] - slope_x * sun[0] - slope_y * sun[1]) / np.sqrt(1 + slope_x**2 + slope_y**2)
    return FACING[0] + (FACING[1] - FACING[0]) * np.clip(facing, 0.0, 1.0)


def spread_over_walls(tops: np.ndarray, colour: np.ndarray, tall: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return colour [Y, X, 3] and plant heights [Y, X], taken from a neighbour where that is much higher.

    Heights are interpolated between cells, so that the side of a crown lies over the cell beside it.
    """
    best, new_colour, new_tall = tops.astype(np.int64) + STEP, colour.copy(), tall.copy()
    wide = np.pad(tops, 1, mode="edge").astype(np.int64)
    wide_colour = np.pad(colour, ((1, 1), (1, 1), (0, 0)), mode="edge")
    wide_tall = np.pad(tall, 1, mode="edge")
    rows, columns = tops.shape
    for r in range(3):
        for c in range(3):
            beside = slice(r, r + rows), slice(c, c + columns)
            higher = wide[beside] > best
            best = np.where(higher, wide[beside], best)
            new_colour = np.where(higher[..., None], wide_colour[beside], new_colour)
            new_tall = np.where(higher, wide_tall[beside], new_tall)
    return new_colour, new_tall
