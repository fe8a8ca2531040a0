"""Worlds under other suns, whose light is kept in the cache folder.

How much sun reaches each node and plant takes seconds to compute, and rivers under varied suns are loaded again and
again, each under the same ones. A file's name holds hashes of the code and the libraries that compute light, and
of the sun, the ground, the water, the plants and the bridges.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from thalweg.core.cache import cache_dir
from thalweg.render.bake.array_files import digest_of, store, stored
from thalweg.world.record import World
from thalweg.world.store.world_cache import GENERATOR_HASH

MOST_BYTES = 4_000_000_000
"""Size of the files that are kept, of some 1 MB each, one for each sun of a river."""


class Sunlight(NamedTuple):
    """What of a world depends on its sun."""

    sun: np.ndarray
    """[GY, GX] uint8, as `World.sun`."""
    plants: np.ndarray
    """[M, 2] float32, as `Plants.light`."""


def relit(world: World, azimuth: float, elevation: float) -> World:
    """Return what `World.relit` does for angles in radians, with the light from the disk if it is there.

    Raises `ValueError` for the same suns, those lower than 5 degrees or beyond the zenith.
    """
    lit_up = world.grid, world.ground_m, world.water_m, world.plants, world.bridges
    name = f"{GENERATOR_HASH}-{digest_of(*lit_up, float(azimuth), float(elevation))}.npz"
    path = cache_dir() / "sunlight" / name
    found = stored(path, Sunlight._fields)
    if found is None:
        made = world.relit(azimuth, elevation)
        store(Sunlight(made.sun, made.plants.light), path, MOST_BYTES)
        return made
    light = Sunlight(*found)
    plants = replace(world.plants, light=light.plants)
    angles = {"sun_azimuth": float(azimuth), "sun_elevation": float(elevation)}
    return replace(world, sun=light.sun, plants=plants, **angles)
