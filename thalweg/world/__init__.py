"""A river valley from a seed, a line or a file: see `build`, `World.from_centerline` and `World.load`."""

from thalweg.world.build import build
from thalweg.world.errors import WorldError, WorldFileError
from thalweg.world.levels import LEVELS, Level, level_named
from thalweg.world.reach import Reach
from thalweg.world.record import Grid, Plants, River, World
from thalweg.world.store import load_or_build

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
