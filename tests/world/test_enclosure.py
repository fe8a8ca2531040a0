"""Tests of what a point of a world lies in."""

import numpy as np
import pytest

from thalweg.world import World
from thalweg.world.bridges import Bridge
from thalweg.world.enclosure import enclosure_of
from thalweg.world.species import KINDS


def test_points_below_the_ground_and_the_water_name_the_height_of_the_surface(easy_world: World):
    x, y = easy_world.river.position_m[0]
    level = easy_world.river.level_m[0]
    under_ground, under_water = enclosure_of(easy_world, x, y, level - 9), enclosure_of(easy_world, x, y, level - 0.05)
    assert under_ground is not None
    assert under_water is not None
    assert (under_ground.name, under_water.name) == ("under the ground", "under water")
    assert (under_ground.top_m, under_water.top_m) == pytest.approx((level, level), abs=0.02)
    assert enclosure_of(easy_world, x, y, level + 2.0) is None


def test_a_point_in_the_stone_of_a_bridge_is_inside_and_one_under_its_arch_is_not(easy_world: World):
    row = easy_world.bridges[0]
    bridge = Bridge(*row)
    inside = enclosure_of(easy_world, bridge.x, bridge.y, bridge.deck_z - 0.1)
    assert inside == ("inside a bridge", pytest.approx(bridge.deck_z))
    assert enclosure_of(easy_world, bridge.x, bridge.y, bridge.deck_z + 0.1) is None
    assert enclosure_of(easy_world, bridge.x, bridge.y, bridge.spring_z + 0.5 * bridge.rise) is None


def test_a_point_in_a_crown_names_the_plant(easy_world: World):
    plants = easy_world.plants
    index = int(np.argmax(plants.height_m))
    kind = KINDS[plants.kind[index]]
    x, y, foot = plants.position_m[index].astype(float)
    top = foot + float(plants.height_m[index])
    inside = enclosure_of(easy_world, x, y, foot + 0.7 * (top - foot))
    assert inside is not None
    assert inside.name == f"inside a plant or rock ({kind.name})"
    assert inside.top_m == pytest.approx(top)
    assert enclosure_of(easy_world, x, y, top + 0.1) is None


def test_a_parapet_is_stone_above_the_edge_of_the_deck_and_nowhere_else(easy_world: World):
    row = easy_world.bridges[0]
    bridge = Bridge(*row)
    across = np.array([-np.sin(bridge.angle), np.cos(bridge.angle)])
    for aside, top in ((0.15, bridge.deck_z + bridge.parapet), (0.45, None), (-0.15, None)):
        x, y = (bridge.x, bridge.y) + across * (bridge.width / 2 - aside)
        found = enclosure_of(easy_world, x, y, bridge.deck_z + 0.5 * bridge.parapet)
        assert found == (None if top is None else ("inside a bridge", pytest.approx(top)))
