"""Generation of a world from a level and a seed: the steps in order, each with its own stream of random numbers."""

import operator
from collections.abc import Sequence

import numpy as np

from thalweg.world.banks import Banks
from thalweg.world.errors import WorldError
from thalweg.world.generate import plants, surface
from thalweg.world.generate.banks.lay import Valley, lay
from thalweg.world.generate.memory import check_memory
from thalweg.world.generate.plan import plan, random_stream
from thalweg.world.generate.terrain import Relief, Terrain, build_terrain
from thalweg.world.levels import Level, level_named
from thalweg.world.light import bake as light
from thalweg.world.record import Plants, River, World

SUN_ELEVATION = np.radians(55.0)
"""Elevation of the sun in the original environment; the azimuth depends on the seed."""
TERRAIN, PAINT, PLANTS, SUN, BANKS = 0, 1, 2, 3, 4
"""Numbers of the random streams of the steps after the plan."""


def resolve_level(level: Level | str, seed: int | None) -> tuple[Level, int]:
    """Return the level and the seed, with the level's default for a seed of None.

    Raises `WorldError` for an unknown level and for a seed that is not an integer of at least 0.
    """
    known = level if isinstance(level, Level) else level_named(level)
    try:
        chosen = known.default_seed if seed is None else operator.index(seed)
    except TypeError:
        raise WorldError(f"a seed is a whole number, not {seed!r}") from None
    if chosen < 0:
        raise WorldError(f"a seed is 0 or more, not {chosen}")
    return known, chosen


def build(level: Level | str, seed: int | None = None) -> World:
    """Return the world of a level (or its name) and a seed; the same arguments give the same bytes.

    Raises `WorldError` for an unknown level, an invalid seed, or a custom level that cannot be met or needs too much
    memory.
    """
    level, seed = resolve_level(level, seed)
    planned = plan(level, seed)
    check_memory(planned.river.position_m, level.plant_density)
    relief = Relief(hills_m=level.hills_m, cut_banks=level.cut_banks)
    terrain = build_terrain(
        planned.river, planned.islands, planned.bridges, planned.branches, relief, random_stream(level, seed, TERRAIN)
    )
    return finish_world(
        name=level.name,
        seed=seed,
        river=planned.river,
        islands=planned.islands,
        bridges=planned.bridges,
        terrain=terrain,
        plant_density=level.plant_density,
        streams=[random_stream(level, seed, purpose) for purpose in (PAINT, PLANTS, SUN, BANKS)],
        banks=level.banks,
    )


def finish_world(
    *,
    name: str,
    seed: int,
    river: River,
    islands: np.ndarray,
    bridges: np.ndarray,
    terrain: Terrain,
    plant_density: float,
    streams: Sequence[np.random.Generator],
    banks: Banks = (),
) -> World:
    """Return the world on a bare terrain: adds paint, plants, banks and light, from four streams of random numbers."""
    paint_rng, plants_rng, sun_rng, banks_rng = streams
    maps = terrain.grid, terrain.ground_m, terrain.water_m
    albedo = surface.paint(*maps, terrain.shore_m, paint_rng)
    scattered = plants.scatter(*maps, terrain.shore_m, terrain.keep_clear, plant_density, plants_rng)
    if banks:
        valley = Valley(terrain, albedo, scattered)
        terrain, albedo, scattered = lay(valley, river, bridges, banks, plant_density, banks_rng)
        maps = terrain.grid, terrain.ground_m, terrain.water_m
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
        banks=banks,
    )
