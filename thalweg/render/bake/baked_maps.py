"""The maps of a world that take long to bake: cones, canopy and clouds, kept in the cache folder.

A file's name holds hashes of the code, of the libraries, and of all that a world consists of, so that a file of another
version is never read. The oldest files are removed once there are many.
"""

import contextlib
import hashlib
import os
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from thalweg.core.atomic_io import atomic_path
from thalweg.core.cache import cache_dir, keep_most_recent
from thalweg.core.compute.jit import kernel_cache_dir
from thalweg.render.bake import clouds, impostors
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
    maps = stored(path)
    if maps is None:
        maps = bake(world, sun, top_m, lit)
        store(maps, path)
    return maps


def bake(world: World, sun: np.ndarray, top_m: np.ndarray, lit: np.ndarray) -> BakedMaps:
    """Bake the maps of a world; arguments as of `baked_maps`."""
    height, slope = cone_map(top_m, world.grid.cell_m)
    canopy, paint = canopy_map(world, lit, impostors.atlas(world.sun_elevation), sun)
    sky = clouds.packed(clouds.cloud_map(sun, world.seed))
    return BakedMaps(np.stack([height, slope], axis=-1), canopy, paint, sky)


def digest_of(*values: Any) -> str:
    """Return a hash of records, arrays and numbers, of all that they consist of: 32 hexadecimal digits."""
    digest = hashlib.sha256()
    for value in values:
        for chunk in _chunks(value):
            digest.update(chunk)
    return digest.hexdigest()[:32]


def _chunks(value: Any) -> Iterator[Any]:
    """Yield the bytes of a record's fields, each field after its type and shape."""
    if is_dataclass(value):
        for field in fields(value):
            yield from _chunks(getattr(value, field.name))
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype.str}{value.shape}".encode()
        yield np.ascontiguousarray(value).data.cast("B") if value.size else b""
    else:
        yield f"{value!r};".encode()


def store(maps: BakedMaps, path: Path) -> None:
    """Write maps atomically, and remove the least recently used files of a full folder.

    If the folder is not writable, nothing is stored.
    """
    with contextlib.suppress(OSError):
        with atomic_path(path) as draft, draft.open("wb") as file:
            # Not compressed, which would take longer to read.
            np.savez(file, **maps._asdict())
        keep_most_recent(path.parent, MOST_BYTES)


def stored(path: Path) -> BakedMaps | None:
    """Return the maps in a file, or None if it is missing or damaged."""
    try:
        with np.load(path) as file:
            maps = BakedMaps(*(file[name] for name in BakedMaps._fields))
    except Exception:  # a damaged archive raises nearly anything
        return None
    with contextlib.suppress(OSError):
        os.utime(path)
    return maps
