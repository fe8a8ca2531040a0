"""How does a world reach the kernels? As a `Scene`: the flat, prefiltered tables of several worlds, one after another.

Every table is made once per world; a pixel then needs only look-ups. Colours are square-root coded, eight bits a
channel, packed in one uint32 (red lowest), so that one gather fetches all of them.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import prange

from thalweg.core.jit import kernel
from thalweg.render.bake import impostors, ripples, sky
from thalweg.world.light.bake import deck_heights
from thalweg.world.record import World
from thalweg.world.species import KINDS

f32 = np.float32

PAINT_LEVELS = 8
CONE_CELL = 4
"""Nodes a side of a cell of the cone map."""
CANOPY_CELL = 2
"""Nodes a side of a cell of the canopy map that reflections see."""

SUN_RADIANCE = np.array([1.0, 0.945, 0.845])
"""What a white surface that faces the sun sends out: warm white, in the units of all radiances here."""
SKY_RADIANCE = np.array([0.054, 0.066, 0.090])
"""What a white surface under the whole sky sends out; low, for the original's shadows are deep (strength 0.95)."""
SUN_R, SUN_G, SUN_B = (float(c) for c in SUN_RADIANCE)
SKY_R, SKY_G, SKY_B = (float(c) for c in SKY_RADIANCE)
PAINT_RANGE = 1.25
"""Radiances up to this are kept in the paint."""

# Columns of Scene.place: where each world's tables begin, and their sizes.
GX, GY, MAP_AT, CONE_X, CONE_AT, PAINT_X, PAINT_Y, CANOPY_X, CANOPY_Y, CANOPY_AT = range(10)
PLANT_FROM, PLANT_TO, BRIDGE_FROM, BRIDGE_TO, SKY_AT, ATLAS_AT, SHADE_AT = range(10, 17)
PAINT_AT = 17
PLACES = PAINT_AT + PAINT_LEVELS
# Columns of Scene.number.
ORIGIN_X, ORIGIN_Y, INV_CELL, TOP_MAX, SUN_X, SUN_Y, SUN_Z, FOG_R, FOG_G, FOG_B, SUN_EAST, SUN_NORTH = range(12)
NUMBERS = 12
# Columns of Scene.plants.
P_X, P_Y, P_Z, P_HEIGHT, P_HALF, P_KIND, P_R, P_G, P_B, P_LOW, P_HIGH, P_RANK = range(12)
PLANT_COLUMNS = 12
# Columns of Scene.bridges.
B_X, B_Y, B_COS, B_SIN, B_HALF_LENGTH, B_HALF_WIDTH, B_SPAN, B_SPRING, B_RISE, B_DECK, B_HUMP, B_PARAPET = range(12)
BRIDGE_COLUMNS = 12


class Scene(NamedTuple):
    """Tables of W worlds, each flat, a world's part after another's."""

    place: np.ndarray
    """[W, PLACES] int64."""
    number: np.ndarray
    """[W, NUMBERS] float32."""
    top: np.ndarray
    """[nodes] float32, height of the upper surface: water or ground."""
    depth: np.ndarray
    """[nodes] float32, water's surface minus ground; positive where wet."""
    cone: np.ndarray
    """[2 * cells] float32, height and slope by turns, since both are read together: no surface within a cell or its
    eight neighbours is higher than the height, and none at a horizontal distance d higher than height + slope * d."""
    paint: np.ndarray
    """[texels] uint32, radiance of the lit ground and, in the top byte, the share of sun; all levels."""
    canopy: np.ndarray
    """[cells] float32, tops of plants and bridges, the ground elsewhere; `NO_CANOPY_M` over open water."""
    canopy_paint: np.ndarray
    """[cells] uint32, radiance of what a reflection meets there."""
    plants: np.ndarray
    """[M, PLANT_COLUMNS] float32."""
    bridges: np.ndarray
    """[B, BRIDGE_COLUMNS] float32."""
    sky: np.ndarray
    """[W * sky.ROWS * sky.COLUMNS] uint32, square-root coded over sky.CODE_RANGE."""
    ripples: np.ndarray
    """[texels] uint32, see `thalweg.render.bake.ripples`."""
    atlas: np.ndarray
    """[texels] uint32, impostors for each distinct height of the sun."""
    atlas_level: np.ndarray
    """[levels] int64, where each level of an atlas begins."""
    shade: np.ndarray
    """[kinds * views, 3] float32, see `thalweg.render.bake.impostors.Atlas.shade`."""
    autumn: np.ndarray
    """[kinds, 3] float32, factors on a plant's colour in full autumn."""


def blank_scene() -> Scene:
    """Tables of no world, of the types that those of every world have: for compiling before there is a world."""
    kinds = {"place": (np.int64, 2), "number": (f32, 2), "plants": (f32, 2), "bridges": (f32, 2), "shade": (f32, 2),
             "autumn": (f32, 2), "atlas_level": (np.int64, 1), "paint": (np.uint32, 1), "canopy_paint": (np.uint32, 1),
             "sky": (np.uint32, 1), "ripples": (np.uint32, 1), "atlas": (np.uint32, 1)}  # fmt: skip
    blank = {name: np.zeros((1,) * rank, kind) for name, (kind, rank) in kinds.items()}
    blank["atlas_level"].setflags(write=False)
    return Scene(**{name: blank.get(name, np.zeros(1, f32)) for name in Scene._fields})


def sun_vector(world: World) -> np.ndarray:
    """Unit vector [3] to the sun."""
    level = np.cos(world.sun_elevation)
    return np.array([level * np.cos(world.sun_azimuth), level * np.sin(world.sun_azimuth), np.sin(world.sun_elevation)])


def build_scene(worlds: Sequence[World]) -> Scene:
    """The tables of the worlds, in their order."""
    place = np.zeros((len(worlds), PLACES), np.int64)
    number = np.zeros((len(worlds), NUMBERS), np.float32)
    tables: dict[str, list[np.ndarray]] = {
        name: [] for name in ("top", "depth", "cone", "paint", "canopy", "canopy_paint", "plants",
                              "bridges", "sky", "atlas", "shade")
    }  # fmt: skip
    begin = dict.fromkeys(tables, 0)
    atlases: dict[int, tuple[int, int]] = {}

    def add(name: str, table: np.ndarray) -> int:
        at = begin[name]
        tables[name].append(table)
        begin[name] += len(table)
        return at

    atlas_level = np.zeros(0, np.int64)
    for w, world in enumerate(worlds):
        sun = sun_vector(world)
        top = np.maximum(world.ground_m, world.water_m)
        gy, gx = top.shape
        place[w, [GX, GY]] = gx, gy
        place[w, MAP_AT] = add("top", top.ravel())
        add("depth", (world.water_m - world.ground_m).astype(np.float32).ravel())

        height, slope = cone_map(top, world.grid.cell_m)
        place[w, CONE_X] = height.shape[1]
        place[w, CONE_AT] = add("cone", np.stack([height, slope], axis=-1).ravel())

        lit = ground_radiance(world, sun)
        levels = paint_levels(lit, world.sun)
        place[w, PAINT_Y], place[w, PAINT_X] = levels[0].shape
        for k, level in enumerate(levels):
            place[w, PAINT_AT + k] = add("paint", level.ravel())

        canopy, colour = canopy_map(world, lit)
        place[w, CANOPY_Y], place[w, CANOPY_X] = canopy.shape
        place[w, CANOPY_AT] = add("canopy", canopy.ravel())
        add("canopy_paint", colour.ravel())

        rows = plant_rows(world)
        place[w, PLANT_FROM] = add("plants", rows)
        place[w, PLANT_TO] = begin["plants"]
        place[w, BRIDGE_FROM] = add("bridges", bridge_rows(world))
        place[w, BRIDGE_TO] = begin["bridges"]
        place[w, SKY_AT] = add("sky", pack_colour(sky.sky_map(sun, world.seed), sky.CODE_RANGE).ravel())

        book = impostors.atlas(world.sun_elevation)
        if id(book) not in atlases:
            atlas_level = book.offset
            atlases[id(book)] = add("atlas", book.packed), add("shade", book.shade.reshape(-1, 3))
        place[w, ATLAS_AT], place[w, SHADE_AT] = atlases[id(book)]

        number[w, [ORIGIN_X, ORIGIN_Y, INV_CELL]] = world.grid.origin_x_m, world.grid.origin_y_m, 1 / world.grid.cell_m
        number[w, TOP_MAX] = top.max()
        number[w, [SUN_X, SUN_Y, SUN_Z]] = sun
        number[w, [FOG_R, FOG_G, FOG_B]] = sky.haze(sun)
        number[w, [SUN_EAST, SUN_NORTH]] = np.cos(world.sun_azimuth), np.sin(world.sun_azimuth)

    joined = {name: np.ascontiguousarray(np.concatenate(parts)) for name, parts in tables.items()}
    return Scene(
        place=place,
        number=number,
        ripples=ripples.packed(ripples.tile()),
        atlas_level=atlas_level,
        autumn=autumn(),
        **joined,
    )


def pack_colour(radiance: np.ndarray, scale: float, fourth: np.ndarray | None = None) -> np.ndarray:
    """Radiance [..., 3] square-root coded over 0..scale, with a fourth byte [...] uint8, as uint32 [...]."""
    coded = np.rint(np.sqrt(np.clip(radiance / scale, 0.0, 1.0)) * 255).astype(np.uint32)
    packed = coded[..., 0] | coded[..., 1] << 8 | coded[..., 2] << 16
    return packed if fourth is None else packed | fourth.astype(np.uint32) << 24


def ground_radiance(world: World, sun: np.ndarray) -> np.ndarray:
    """What the ground (or the bed, as seen without water) sends out under its baked light [GY, GX, 3]."""
    slope_y, slope_x = np.gradient(world.ground_m.astype(np.float64), world.grid.cell_m)
    facing = (-slope_x * sun[0] - slope_y * sun[1] + sun[2]) / np.sqrt(1 + slope_x**2 + slope_y**2)
    direct = np.maximum(facing, 0.0) * (world.sun / 255.0)
    light = direct[..., None] * SUN_RADIANCE + (world.sky / 255.0)[..., None] * SKY_RADIANCE
    return (world.albedo / 255.0) ** 2 * light


def paint_levels(lit: np.ndarray, sun_share: np.ndarray) -> list[np.ndarray]:
    """The packed paint at each level, uint32: box-filtered in linear light, the first padded to a multiple of 128."""
    block = 1 << (PAINT_LEVELS - 1)
    pad = [(0, -lit.shape[0] % block), (0, -lit.shape[1] % block)]
    colour = np.pad(lit, [*pad, (0, 0)], mode="edge").astype(np.float32)
    share = np.pad(sun_share, pad, mode="edge").astype(np.float32)
    levels = []
    for k in range(PAINT_LEVELS):
        if k:
            colour = colour.reshape(colour.shape[0] // 2, 2, colour.shape[1] // 2, 2, 3).mean(axis=(1, 3))
            share = share.reshape(share.shape[0] // 2, 2, share.shape[1] // 2, 2).mean(axis=(1, 3))
        levels.append(pack_colour(colour, PAINT_RANGE, np.rint(share).astype(np.uint8)))
    return levels


FOLIAGE_RADIANCE = np.array([0.040, 0.050, 0.018])
"""Mean radiance of the side of a wood in the sun."""
STONE_RADIANCE = np.array([0.135, 0.120, 0.092])
"""Mean radiance of the sides of a bridge, one in the sun and one in the shade."""
NO_CANOPY_M = -1e6
"""Height of the canopy where there is only open water."""


def canopy_map(world: World, lit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tops of plants and bridges [Y, X] float32, `NO_CANOPY_M` over open water, and what a reflection sees there [Y, X]
    packed, in cells of `CANOPY_CELL` nodes."""
    top = np.maximum(world.ground_m, world.water_m)
    rows, columns = (s // CANOPY_CELL * CANOPY_CELL for s in top.shape)

    def blocks(a: np.ndarray) -> np.ndarray:
        return a[:rows, :columns].reshape(rows // CANOPY_CELL, CANOPY_CELL, columns // CANOPY_CELL, CANOPY_CELL, -1)

    canopy = blocks(world.canopy_m).max(axis=(1, 3))[..., 0]
    # Sloping water does not mirror itself: open water is put where no mirrored ray gets to.
    closed = (world.water_m <= world.ground_m) | (world.canopy_m > world.water_m + 0.01)
    canopy[blocks(closed).max(axis=(1, 3))[..., 0] == 0] = NO_CANOPY_M
    ground = blocks(lit).mean(axis=(1, 3))
    wooded = np.clip(blocks(world.canopy_m - top).max(axis=(1, 3)) - 0.5, 0.0, 1.0)
    shade = 0.35 + 0.65 * blocks(world.sun / 255.0).mean(axis=(1, 3))
    colour = ground * (1 - wooded) + FOLIAGE_RADIANCE * shade * wooded
    for bridge in world.bridges:
        on, _ = deck_heights(world.grid, top.shape, bridge)
        colour[blocks(on).max(axis=(1, 3))[..., 0] > 0] = STONE_RADIANCE
    return canopy.astype(np.float32), pack_colour(colour, PAINT_RANGE)


def plant_rows(world: World) -> np.ndarray:
    """[M, PLANT_COLUMNS] float32."""
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


def plant_ranks(count: int) -> np.ndarray:
    """[count] in 0..1: multiples of the golden ratio, so that any share of the plants is spread evenly over them."""
    return np.arange(count) * ((np.sqrt(5) - 1) / 2) % 1.0


AUTUMN = {
    "oak": (2.6, 1.15, 0.55),
    "birch": (3.4, 1.85, 0.40),
    "bush": (2.9, 1.05, 0.70),
    "reed": (1.7, 1.25, 0.80),
    "grass": (1.9, 1.35, 0.75),
    "pine": (1.10, 1.0, 0.95),
}
"""Factors on the colour of a species in full autumn; what is not named keeps its own."""


def autumn() -> np.ndarray:
    """[kinds, 3] float32."""
    return np.array([AUTUMN.get(kind.species, (1.0, 1.0, 1.0)) for kind in KINDS], np.float32)


def bridge_rows(world: World) -> np.ndarray:
    """[B, BRIDGE_COLUMNS] float32."""
    rows = np.empty((len(world.bridges), BRIDGE_COLUMNS), np.float32)
    for row, (x, y, angle, length, width, span, spring, rise, deck, hump, parapet) in zip(
        rows, world.bridges, strict=True
    ):
        row[:] = x, y, np.cos(angle), np.sin(angle), length / 2, width / 2, span / 2, spring, rise, deck, hump, parapet
    return rows


def cone_map(top: np.ndarray, cell_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Height and slope [CY, CX] float32 of the cone above each cell that no surface of `top` [GY, GX] pierces.

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
    slope = _cone_slope(highest, height, np.ascontiguousarray(coarse), f32(cell_m * CONE_CELL))
    return height.astype(np.float32), slope


@kernel(parallel=True, fastmath=False)
def _cone_slope(highest, height, coarse, cell):
    rows, columns = highest.shape
    slope = np.zeros((rows, columns), np.float32)
    near = 12
    reach = 24
    summit = coarse.max()
    for r in prange(rows):
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
    return slope
