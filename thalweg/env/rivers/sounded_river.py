"""Rivers with their bed and without light: the course, the heights of the ground and the rocks, which a boat needs.

They take about half the time to build of a whole world, and are kept beside those in the cache folder. Plants other
than rocks, and all colours, are left out, and so is the land further from the water than `SHORE_M`.
"""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from thalweg.core.cache import code_hash
from thalweg.env.rivers import bare_river
from thalweg.env.rivers.bare_river import plan_bare
from thalweg.world import Level
from thalweg.world.generate import plants
from thalweg.world.generate.banks.lay import Valley, lay
from thalweg.world.generate.build import BANKS, PLANTS, TERRAIN
from thalweg.world.generate.plan import plan, random_stream
from thalweg.world.generate.terrain import Relief, Terrain, build_terrain
from thalweg.world.record import Grid, Plants, World
from thalweg.world.species import kinds_of
from thalweg.world.store.world_cache import cache_path, load_or_make

SHORE_M = 8.0
"""Land that is kept around the channel."""
BUILT_BY = code_hash([Path(bare_river.__file__), Path(__file__)])[:8]
"""Hash of the code that makes these rivers out of what `thalweg.world` plans and builds, on import as
`world_cache.GENERATOR_HASH`."""


def load_or_sound(level: Level, seed: int) -> World:
    """Return the river of a level and a seed with its bed, from the cache folder if it was built before.

    A damaged file in the cache is replaced. A cache folder that cannot be written costs time, not the river.
    """
    return load_or_make(sounded_path(level, seed), lambda: sound(level, seed))


def sounded_path(level: Level, seed: int) -> Path:
    """Return the path of a cached river with its bed."""
    whole = cache_path(level, seed)
    return whole.with_name(f"sounded-{BUILT_BY}-{whole.name}")


def sound(level: Level, seed: int) -> World:
    """Return the river of a level and a seed with the bed and the rocks of the whole world."""
    planned = plan(level, seed)
    relief = Relief(hills_m=level.hills_m, cut_banks=level.cut_banks)
    terrain = build_terrain(
        planned.river, planned.islands, planned.bridges, planned.branches, relief, random_stream(level, seed, TERRAIN)
    )
    scattered = plants.scatter(
        terrain.grid, terrain.ground_m, terrain.water_m, terrain.shore_m, terrain.keep_clear, level.plant_density,
        random_stream(level, seed, PLANTS),
    )  # fmt: skip
    if level.banks:
        unpainted = Valley(terrain, np.zeros((0, 0, 3), np.uint8), scattered)
        terrain, _, scattered = lay(
            unpainted, planned.river, planned.bridges, level.banks, level.plant_density,
            random_stream(level, seed, BANKS),
        )  # fmt: skip
    return _with_bed(plan_bare(level, seed), terrain, scattered)


def _with_bed(bare: World, terrain: Terrain, scattered: Plants) -> World:
    """Return a river without land with the bed around its channel, and the rocks there."""
    cell, half = terrain.grid.cell_m, 0.5 * bare.river.width_m[:, None]
    origin = np.array([terrain.grid.origin_x_m, terrain.grid.origin_y_m])
    first = np.floor(((bare.river.position_m - half).min(axis=0) - SHORE_M - origin) / cell).astype(int)
    last = np.ceil(((bare.river.position_m + half).max(axis=0) + SHORE_M - origin) / cell).astype(int)
    (left, low), (right, high) = np.maximum(first, 0), last
    window = slice(low, high + 1), slice(left, right + 1)
    ground, water = terrain.ground_m[window].copy(), terrain.water_m[window].copy()
    corner = origin + cell * np.array([left, low])
    end = corner + cell * (np.array(ground.shape[::-1]) - 1)
    foot = scattered.position_m[:, :2]
    kept = np.isin(scattered.kind, kinds_of("rock")) & (foot >= corner).all(axis=1) & (foot <= end).all(axis=1)
    codes = np.zeros(ground.shape, np.uint8)
    return replace(
        bare,
        grid=Grid(float(corner[0]), float(corner[1]), cell),
        ground_m=ground,
        water_m=water,
        albedo=np.zeros((*ground.shape, 3), np.uint8),
        sun=codes,
        sky=codes,
        canopy_m=ground,
        plants=Plants(**{each.name: getattr(scattered, each.name)[kept] for each in fields(Plants)}),
    )
