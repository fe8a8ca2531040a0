"""Rivers of the levels for the tests of the rules: courses, islands and bridges as generated, without ground, plants
or light."""

import dataclasses
from functools import cache

from tests.env.handmade import world_of
from thalweg.world.generate.plan import plan
from thalweg.world.levels import level_named
from thalweg.world.record import World


@cache
def river(level: str, seed: int) -> World:
    """What the rules read of the world of a level and a seed; much quicker than building it."""
    drawn = plan(level_named(level), seed)
    bare = world_of([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]], name=level_named(level).name)
    return dataclasses.replace(bare, seed=seed, river=drawn.river, islands=drawn.islands, bridges=drawn.bridges)
