"""Baking of the tables of a `Scene`: maps, prefiltered paint, canopies, plants and bridges of each world.

Tables are built once per world, so that shading a pixel only needs look-ups.
"""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from thalweg.render.bake import impostors, outlines, ripples, sky
from thalweg.render.bake.baked_maps import baked_maps
from thalweg.render.bake.quay_mask import quay_mask
from thalweg.render.bake.texels import pack_colour
from thalweg.render.records.layout import (
    ATLAS_AT,
    BRIDGE_COLUMNS,
    BRIDGE_FROM,
    BRIDGE_TO,
    CANOPY_AT,
    CANOPY_X,
    CANOPY_Y,
    CHUNK,
    CHUNK_AT,
    CLOUD_AT,
    CONE_AT,
    CONE_X,
    CONSTANT_COLUMNS,
    DEPTH_BASE,
    DEPTH_STEP,
    EXTENT_COLUMNS,
    FOG_B,
    FOG_G,
    FOG_R,
    GX,
    GY,
    INV_CELL,
    MAP_AT,
    ORIGIN_X,
    ORIGIN_Y,
    P_B,
    P_G,
    P_HALF,
    P_HEIGHT,
    P_HIGH,
    P_KIND,
    P_LOW,
    P_R,
    P_RANK,
    P_X,
    P_Y,
    P_Z,
    PAINT_AT,
    PAINT_LEVELS,
    PAINT_RANGE,
    PAINT_X,
    PAINT_Y,
    PLANT_COLUMNS,
    PLANT_FROM,
    PLANT_TO,
    QUAY_AT,
    QUAY_LEVEL,
    QUAY_SLOPE,
    SHADE_AT,
    SKY_AT,
    SKY_RADIANCE,
    SUN_EAST,
    SUN_NORTH,
    SUN_RADIANCE,
    SUN_X,
    SUN_Y,
    SUN_Z,
    TOP_BASE,
    TOP_MAX,
    TOP_STEP,
)
from thalweg.render.records.scene import Scene
from thalweg.world.banks import has_kind, quay_slope
from thalweg.world.record import World
from thalweg.world.species import KINDS


def sun_vector(world: World) -> np.ndarray:
    """Return the unit vector [3] towards the sun."""
    level = np.cos(world.sun_elevation)
    return np.array([level * np.cos(world.sun_azimuth), level * np.sin(world.sun_azimuth), np.sin(world.sun_elevation)])


class TableWriter:
    """Collects the tables of the worlds one after another, and the offsets at which they begin."""

    def __init__(self) -> None:
        self._tables: dict[str, list[np.ndarray]] = defaultdict(list)
        self.length: dict[str, int] = defaultdict(int)
        """Rows of each table so far."""

    def add(self, name: str, table: np.ndarray) -> int:
        """Append to a table; returns the row at which the appended part begins."""
        begin = self.length[name]
        self._tables[name].append(table)
        self.length[name] += len(table)
        return begin

    def joined(self) -> dict[str, np.ndarray]:
        """Return each table as one contiguous array."""
        return {name: np.ascontiguousarray(np.concatenate(arrays)) for name, arrays in self._tables.items()}


def build_scene(worlds: Sequence[World]) -> Scene:
    """Return the tables of the worlds, in the same order."""
    extents = np.zeros((len(worlds), EXTENT_COLUMNS), np.int32)
    constants = np.zeros((len(worlds), CONSTANT_COLUMNS), np.float32)
    tables = TableWriter()
    atlases: dict[int, tuple[int, int]] = {}
    atlas_level = np.zeros(0, np.int64)
    for world, extent, constant in zip(worlds, extents, constants, strict=True):
        sun = sun_vector(world)
        add_maps(tables, world, sun, extent, constant)
        plants = in_chunks(plant_rows(world))
        extent[PLANT_FROM] = tables.add("plants", plants)
        extent[CHUNK_AT] = tables.add("chunks", chunk_spheres(plants))
        extent[PLANT_TO] = tables.length["plants"]
        extent[BRIDGE_FROM] = tables.add("bridges", bridge_rows(world))
        extent[BRIDGE_TO] = tables.length["bridges"]
        extent[SKY_AT] = tables.add("sky", pack_colour(sky.sky_map(sun, world.seed), sky.CODE_RANGE).ravel())
        # Worlds under a sun of the same height share one atlas.
        atlas = impostors.atlas(world.sun_elevation)
        if id(atlas) not in atlases:
            # A copy of a scene is writeable, which is part of the type that kernels are compiled for.
            atlas_level = atlas.offset.copy()
            atlases[id(atlas)] = tables.add("atlas", atlas.packed), tables.add("shade", atlas.shade.reshape(-1, 3))
            tables.add("outlines", outlines.of_sun(world.sun_elevation))
        extent[ATLAS_AT], extent[SHADE_AT] = atlases[id(atlas)]
        constant[[ORIGIN_X, ORIGIN_Y, INV_CELL]] = world.grid.origin_x_m, world.grid.origin_y_m, 1 / world.grid.cell_m
        constant[[SUN_X, SUN_Y, SUN_Z]] = sun
        constant[[FOG_R, FOG_G, FOG_B]] = sky.haze(sun)
        constant[QUAY_SLOPE] = quay_slope(world.grid.cell_m) if has_kind(world.banks, "quay") else 0.0
        constant[[SUN_EAST, SUN_NORTH]] = np.cos(world.sun_azimuth), np.sin(world.sun_azimuth)
    return Scene(
        extents=extents,
        constants=constants,
        ripples=ripples.packed_tile().copy(),  # a copy is writeable
        atlas_level=atlas_level,
        autumn=autumn(),
        **tables.joined(),
    )


def add_maps(tables: TableWriter, world: World, sun: np.ndarray, extent: np.ndarray, constant: np.ndarray) -> None:
    """Append the maps of a world's surface, cones, paint, canopy and clouds.

    Their offsets and sizes are noted in `extent`, and the units of heights in `constant`.
    """
    top, constant[TOP_BASE], constant[TOP_STEP] = pack_heights(np.maximum(world.ground_m, world.water_m))
    depth, constant[DEPTH_BASE], constant[DEPTH_STEP] = pack_heights(world.water_m - world.ground_m)
    extent[GY], extent[GX] = top.shape
    extent[MAP_AT] = tables.add("top", top.ravel())
    tables.add("depth", depth.ravel())
    # Cones and summit are those of the rounded heights that rays will meet.
    met_m = constant[TOP_BASE] + constant[TOP_STEP] * (top & 0xFFFF).astype(np.float32)
    constant[TOP_MAX] = met_m.max()

    lit = ground_radiance(world, sun)
    baked = baked_maps(world, sun, met_m, lit)
    extent[CONE_X] = baked.cone.shape[1]
    extent[CONE_AT] = tables.add("cone", baked.cone.ravel())

    levels = paint_levels(lit, world.sun)
    extent[PAINT_Y], extent[PAINT_X] = levels[0].shape
    for k, level in enumerate(levels):
        extent[PAINT_AT + k] = tables.add("paint", level.ravel())
    if has_kind(world.banks, "quay"):
        extent[QUAY_AT] = tables.add("paint", quay_mask(world, levels[QUAY_LEVEL].shape).ravel())

    extent[CANOPY_Y], extent[CANOPY_X] = baked.canopy.shape
    extent[CANOPY_AT] = tables.add("canopy", baked.canopy.ravel())
    tables.add("canopy_paint", baked.canopy_paint.ravel())
    extent[CLOUD_AT] = tables.add("clouds", baked.clouds)


def pack_heights(heights_m: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Return heights [Y, X] as `Scene.top` holds them, the metres of code 0, and those from one code to the next.

    A map that spans 16 m is rounded to quarters of a millimetre.
    """
    base, span = float(heights_m.min()), float(np.ptp(heights_m))
    step = max(span, 1e-3) / 65535
    code = np.rint((heights_m.astype(np.float64) - base) / step).astype(np.uint32)
    # The last row has no next one; no point lies beyond it.
    return code | np.concatenate([code[1:], code[-1:]]) << 16, base, step


def ground_radiance(world: World, sun: np.ndarray) -> np.ndarray:
    """Return the radiance [GY, GX, 3] of the ground (the bed, where there is water) under its baked light."""
    slope_y, slope_x = np.gradient(world.ground_m.astype(np.float64), world.grid.cell_m)
    facing = (-slope_x * sun[0] - slope_y * sun[1] + sun[2]) / np.sqrt(1 + slope_x**2 + slope_y**2)
    direct = np.maximum(facing, 0.0) * (world.sun / 255.0)
    light = direct[..., None] * SUN_RADIANCE + (world.sky / 255.0)[..., None] * SKY_RADIANCE
    return (world.albedo / 255.0) ** 2 * light


def paint_levels(lit: np.ndarray, sun_share: np.ndarray) -> list[np.ndarray]:
    """Return the packed paint at each level, uint32: box-filtered in linear light, padded to a multiple of 128."""
    block = 1 << (PAINT_LEVELS - 1)
    pad = [(0, -lit.shape[0] % block), (0, -lit.shape[1] % block)]
    colour = np.pad(lit, [*pad, (0, 0)], mode="edge").astype(np.float32)
    share = np.pad(sun_share, pad, mode="edge").astype(np.float32)
    levels = []
    for k in range(PAINT_LEVELS):
        if k:
            colour, share = _halved(colour), _halved(share)
        levels.append(pack_colour(colour, PAINT_RANGE, np.rint(share).astype(np.uint8)))
    return levels


def _halved(fine: np.ndarray) -> np.ndarray:
    """Return the means of squares of two by two nodes of a map [2 Y, 2 X, ...], twice as fast as by `mean`."""
    total = fine[::2, ::2] + fine[::2, 1::2]
    total += fine[1::2, ::2]
    total += fine[1::2, 1::2]
    total *= np.float32(0.25)
    return total


def plant_rows(world: World) -> np.ndarray:
    """Return the plants as rows [M, PLANT_COLUMNS] float32."""
    plants = world.plants
    rows = np.empty((len(plants.kind), PLANT_COLUMNS), np.float32)
    rows[:, [P_X, P_Y, P_Z]] = plants.position_m
    rows[:, P_HEIGHT] = plants.height_m
    rows[:, P_HALF] = plants.width_m / 2
    rows[:, P_KIND] = plants.kind
    rows[:, [P_R, P_G, P_B]] = plants.tint
    rows[:, [P_LOW, P_HIGH]] = plants.light
    rows[:, P_RANK] = plant_ranks(len(rows))
    return rows


def in_chunks(rows: np.ndarray) -> np.ndarray:
    """Return plants [M, PLANT_COLUMNS] in an order in which those that stand close together are close together.

    The order is that of a Morton curve (Morton 1966) over squares of two metres.
    """
    cell = np.floor((rows[:, [P_X, P_Y]] - rows[:, [P_X, P_Y]].min(0, initial=np.inf)) / 2.0).astype(np.uint64)
    code = np.zeros(len(rows), np.uint64)
    for bit in range(16):
        for axis in range(2):
            code |= (cell[:, axis] >> np.uint64(bit) & np.uint64(1)) << np.uint64(2 * bit + axis)
    return rows[np.argsort(code, kind="stable")]


def chunk_spheres(rows: np.ndarray) -> np.ndarray:
    """Return a sphere around each chunk of plants [M, PLANT_COLUMNS]: middle and radius in metres [C, 4] float32.

    It holds the spheres around its plants that `kernels.plants.draw.distance_in_view` looks at.
    """
    spheres = np.empty((-(-len(rows) // CHUNK), 4), np.float32)
    for sphere, first in zip(spheres, range(0, len(rows), CHUNK), strict=True):
        part = rows[first : first + CHUNK].astype(np.float64)
        centre = part[:, [P_X, P_Y, P_Z]] + [0.0, 0.0, 0.5] * part[:, [P_HEIGHT]]
        radius = part[:, P_HEIGHT] / 2 + part[:, P_HALF]
        middle = ((centre - radius[:, None]).min(0) + (centre + radius[:, None]).max(0)) / 2
        # A centimetre more than all rounding in single precision.
        reach = (np.linalg.norm(centre - middle, axis=1) + radius).max() + 0.01
        sphere[:] = *middle, reach
    return spheres


def plant_ranks(count: int) -> np.ndarray:
    """Return ranks [count] in 0..1, multiples of the golden ratio: any share of the plants is spread evenly."""
    return np.arange(count) * ((np.sqrt(5) - 1) / 2) % 1.0


AUTUMN = {
    "oak": (2.6, 1.15, 0.55),
    "birch": (3.4, 1.85, 0.40),
    "bush": (2.9, 1.05, 0.70),
    "reed": (1.7, 1.25, 0.80),
    "grass": (1.9, 1.35, 0.75),
    "pine": (1.10, 1.0, 0.95),
}
"""Factors on the colour of a species in full autumn; other species do not change."""


def autumn() -> np.ndarray:
    """Return the colour factors [kinds, 3] float32 of full autumn."""
    return np.array([AUTUMN.get(kind.species, (1.0, 1.0, 1.0)) for kind in KINDS], np.float32)


def bridge_rows(world: World) -> np.ndarray:
    """Return the bridges as rows [B, BRIDGE_COLUMNS] float32."""
    rows = np.empty((len(world.bridges), BRIDGE_COLUMNS), np.float32)
    for row, (x, y, angle, length, width, span, spring, rise, deck, hump, parapet) in zip(
        rows, world.bridges, strict=True
    ):
        row[:] = x, y, np.cos(angle), np.sin(angle), length / 2, width / 2, span / 2, spring, rise, deck, hump, parapet
    return rows
