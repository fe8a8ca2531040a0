"""The maps of a world that take long to bake: cones, canopy and clouds, kept in the cache folder.

A file's name holds hashes of the code, of the libraries, and of all that a world consists of, so that a file of another
version is never read. The oldest files are removed once there are many.
"""

from typing import NamedTuple

import numpy as np

from thalweg.core.cache import cache_dir
from thalweg.core.compute.jit import kernel_cache_dir
from thalweg.render.bake import clouds, impostors
from thalweg.render.bake.array_files import digest_of, store, stored
from thalweg.render.bake.canopy import canopy_map
from thalweg.render.bake.cone_map import cone_map
from thalweg.world.record import World

MOST_BYTES = 8_000_000_000
"""Size of the files that are kept, of some 4 MB each, one for each sun of a river. If fewer than a training has rivers
were kept, all would be removed before they are used again."""


class BakedMaps(NamedTuple):
    """Maps of one world."""

    cone: np.ndarray
    """[CY, CX, 2] float32, of `cone_map`: height and slope."""
    canopy: np.ndarray
    """[Y, X] uint32, of `canopy_map`: heights, and below colours."""
    canopy_paint: np.ndarray
    clouds: np.ndarray
    """[SIDE * SIDE] uint32, of `clouds.packed`."""


def baked_maps(world: World, sun: np.ndarray, top_m: np.ndarray, lit: np.ndarray) -> BakedMaps:
    """Return the maps of a world, from the disk if they are there.

    sun: unit vector [3] towards the sun; top_m: heights of the upper surface [GY, GX]; lit: radiance of the ground
    [GY, GX, 3]. All three are part of the file's name.
    """
    # Its name is a hash of the kernels' code, these maps' included, and of what compiled it.
    version = kernel_cache_dir()
    if version is None:
        return bake(world, sun, top_m, lit)
    path = cache_dir() / "baked" / f"{version.name}-{np.__version__}-{digest_of(world, sun, top_m, lit)}.npz"
    found = stored(path, BakedMaps._fields)
    if found is not None:
        return BakedMaps(*found)
    maps = bake(world, sun, top_m, lit)
    store(maps, path, MOST_BYTES)
    return maps


def bake(world: World, sun: np.ndarray, top_m: np.ndarray, lit: np.ndarray) -> BakedMaps:
    """Bake the maps of a world; arguments as of `baked_maps`."""
    height, slope = cone_map(top_m, world.grid.cell_m)
    canopy, paint = canopy_map(world, lit, impostors.atlas(world.sun_elevation), sun)
    sky = clouds.packed(clouds.cloud_map(sun, world.seed))
    return BakedMaps(np.stack([height, slope], axis=-1), canopy, paint, sky)
