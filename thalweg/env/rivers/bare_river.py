"""Rivers without land: the course, islands and bridges of a level and a seed, which are all that the rules need.

They are planned in a fraction of the time of a whole world, and kept beside those in the cache folder, in small files.
"""

from pathlib import Path

import numpy as np

from thalweg.core.cache import code_hash
from thalweg.world import Level
from thalweg.world.generate.plan import plan
from thalweg.world.record import Grid, Plants, World
from thalweg.world.store.world_cache import cache_path, load_or_make

BUILT_BY = code_hash([Path(__file__)])[:8]
"""Hash of the code that makes these rivers out of what `thalweg.world` plans, on import as
`world_cache.GENERATOR_HASH`."""


def load_or_plan(level: Level, seed: int) -> World:
    """Return the river of a level and a seed without its land, from the cache folder if it was planned before.

    A damaged file in the cache is replaced. A cache folder that cannot be written costs time, not the river.
    """
    return load_or_make(bare_path(level, seed), lambda: plan_bare(level, seed))


def bare_path(level: Level, seed: int) -> Path:
    """Return the path of a cached river without land."""
    whole = cache_path(level, seed)
    return whole.with_name(f"bare-{BUILT_BY}-{whole.name}")


def plan_bare(level: Level, seed: int) -> World:
    """Return the river of a level and a seed with blank land: a flat map of four nodes that covers the course."""
    planned = plan(level, seed)
    position = planned.river.position_m
    corner, size = position.min(axis=0), float(np.ptp(position, axis=0).max())
    heights, codes, none = np.zeros((2, 2), np.float32), np.zeros((2, 2), np.uint8), np.zeros(0, np.float32)
    three, two = np.zeros((0, 3), np.float32), np.zeros((0, 2), np.float32)
    return World(
        name=level.name,
        seed=seed,
        river=planned.river,
        islands=planned.islands,
        bridges=planned.bridges,
        grid=Grid(float(corner[0]), float(corner[1]), size),
        ground_m=heights,
        water_m=heights,
        albedo=np.zeros((2, 2, 3), np.uint8),
        sun=codes,
        sky=codes,
        canopy_m=heights,
        plants=Plants(three, none, none, none.astype(np.int16), none, three, two),
        sun_azimuth=0.0,
        sun_elevation=1.0,
        banks=level.banks,
    )
