"""How does a level and a seed become a world? The steps in order, each with its own stream of random numbers."""

import operator
from collections.abc import Sequence

import numpy as np

from thalweg.world.errors import WorldError
from thalweg.world.generate import plants, surface
from thalweg.world.generate.memory import check_memory
from thalweg.world.generate.plan import plan, stream
from thalweg.world.generate.terrain import Relief, Terrain, build_terrain
from thalweg.world.levels import Level, level_named
from thalweg.world.light import bake as light
from thalweg.world.record import Plants, River, World

SUN_ELEVATION = np.radians(55.0)
"""The sun of the originals stands so high; its azimuth is the seed's."""
TERRAIN, PAINT, PLANTS, SUN = 0, 1, 2, 3
"""The streams of random numbers of the steps after the plan."""


def resolve(level: Level | str, seed: int | None) -> tuple[Level, int]:
    """The level and seed meant, None being the level's default; raises `WorldError` for unknown or negative ones."""
    known = level if isinstance(level, Level) else level_named(level)
    try:
        chosen = known.default_seed if seed is None else operator.index(seed)
    except TypeError:
        raise WorldError(f"a seed is a whole number, not {seed!r}") from None
    if chosen < 0:
        raise WorldError(f"a seed is 0 or more, not {chosen}")
    return known, chosen


def build(level: Level | str, seed: int | None = None) -> World:
    """The world of a level (or its name) and a seed; the same bytes for the same arguments.

    Raises `WorldError` for an unknown level, a bad seed, or a custom level that can't be met, also for want of memory.
    """
    level, seed = resolve(level, seed)
    drawn = plan(level, seed)
    check_memory(drawn.river.position_m, level.plant_density)
    relief = Relief(hills_m=level.hills_m, cut_banks=level.cut_banks)
    terrain = build_terrain(
        drawn.river, drawn.islands, drawn.bridges, drawn.branches, relief, stream(level, seed, TERRAIN)
    )
    return dress(
        name=level.name,
        seed=seed,
        river=drawn.river,
        islands=drawn.islands,
        bridges=drawn.bridges,
        terrain=terrain,
        plant_density=level.plant_density,
        streams=[stream(level, seed, purpose) for purpose in (PAINT, PLANTS, SUN)],
    )


def dress(
    *,
    name: str,
    seed: int,
    river: River,
    islands: np.ndarray,
    bridges: np.ndarray,
    terrain: Terrain,
    plant_density: float,
    streams: Sequence[np.random.Generator],
) -> World:
    """The world on a bare terrain: paint, plants and light, from three streams of random numbers."""
    paint_rng, plants_rng, sun_rng = streams
    maps = terrain.grid, terrain.ground_m, terrain.water_m
    albedo = surface.paint(*maps, terrain.shore_m, paint_rng)
    scattered = plants.scatter(*maps, terrain.shore_m, terrain.keep_clear, plant_density, plants_rng)
    azimuth = float(sun_rng.uniform(0, 2 * np.pi))
    baked = light.bake(*maps, scattered, bridges, azimuth, SUN_ELEVATION)
    lit = Plants(
        scattered.position_m,
        scattered.height_m,
        scattered.width_m,
        scattered.kind,
        scattered.turn,
        scattered.tint,
        baked.plant_light,
    )
    return World(
        name=name,
        seed=seed,
        river=river,
        islands=islands,
        bridges=bridges,
        grid=terrain.grid,
        ground_m=terrain.ground_m,
        water_m=terrain.water_m,
        albedo=albedo,
        sun=baked.sun,
        sky=baked.sky,
        canopy_m=baked.canopy_m,
        plants=lit,
        sun_azimuth=azimuth,
        sun_elevation=float(SUN_ELEVATION),
    )
