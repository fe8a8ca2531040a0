"""River valleys as frozen records of arrays: see `build`, `World.from_centerline` and `World.load`."""

from thalweg.world.errors import WorldError, WorldFileError
from thalweg.world.generate.build import build
from thalweg.world.levels import LEVELS, Level, level_named
from thalweg.world.light.bake import relit
from thalweg.world.real.centerline import from_centerline
from thalweg.world.real.file_river import from_file
from thalweg.world.real.reach import Reach
from thalweg.world.record import Grid, Plants, River, World
from thalweg.world.store.npz import load, save
from thalweg.world.store.world_cache import load_or_build

# Bound here, so that the record imports no module that builds, lights or stores worlds.
World.from_centerline = staticmethod(from_centerline)
World.from_file = World.from_geojson = staticmethod(from_file)
World.load = staticmethod(load)
World.save = save
World.relit = relit

__all__ = [
    "LEVELS",
    "Grid",
    "Level",
    "Plants",
    "Reach",
    "River",
    "World",
    "WorldError",
    "WorldFileError",
    "build",
    "level_named",
    "load_or_build",
]
