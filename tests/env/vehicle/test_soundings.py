"""Soundings: rocks at the height of the hull, and rivers with their bed alone, beside whole worlds."""

import numpy as np
import pytest

from tests.env.vehicle.basins import basin
from thalweg.env import EnvConfig
from thalweg.env.rivers.courses import join_courses
from thalweg.env.rivers.sounded_river import load_or_sound, sound, sounded_path
from thalweg.env.task.course_arrays import pack_courses
from thalweg.env.vehicle.boat import Boat
from thalweg.env.vehicle.soundings import take_soundings, widest
from thalweg.world import LEVELS, World
from thalweg.world.species import KINDS

CONFIG = EnvConfig(vehicle="asv")
STONE = next(kind for kind in KINDS if kind.group == "rock")


def test_a_stone_is_as_wide_as_its_outline_between_keels_and_deck():
    # The outline of stones: 0.95 at the foot, 1.0 at a fifth, 0.87 at a half, 0.65 at three quarters, 0.15 at the top.
    assert widest(STONE, 0.0, 1.0) == pytest.approx(1.0)
    assert widest(STONE, 0.5, 1.0) == pytest.approx(0.87)
    assert widest(STONE, 0.0, 0.1) == pytest.approx(0.975)
    assert widest(STONE, -3.0, 0.0) == pytest.approx(0.95)
    assert widest(STONE, 1.1, 2.0) == widest(STONE, -2.0, -0.1) == 0.0


def test_a_rock_below_the_keels_or_far_from_the_water_is_left_out():
    world = basin(rocks=((20.0, 1.0, 0.7), (30.0, 13.0, 0.7)))
    assert take_soundings([world], CONFIG.boat)["rock"][:, 0].tolist() == [20.0]
    # Its foot is half a metre below the water and its top half a metre above it: at the height of a hull of 0.1 m
    # draught and 0.1 m height it is widest at the keels, 0.4 m above its foot, where the outline has 1 - 2/3 * 0.13.
    flat = take_soundings([world], Boat(draught_m=0.1, hull_height_m=0.1))["rock"]
    assert flat[:, 2] == pytest.approx([0.7 * (1.0 - 0.13 * 2 / 3)])


def test_a_vehicle_that_flies_has_no_soundings():
    courses = pack_courses([basin()], EnvConfig())
    for name in ("first_depth", "depth_layout", "depth", "first_rock", "rock", "arch", "through"):
        assert getattr(courses, name).size == 0
    joined = join_courses([courses, courses])
    assert joined.depth.size == joined.first_depth.size == 0


def test_joined_courses_of_boats_equal_those_that_are_packed_together():
    worlds = [basin(rocks=((20.0, 1.0, 0.7),)), basin(length_m=40.0), basin(lambda x, y: 1.0 + 0.001 * x)]
    joined = join_courses([pack_courses([world], CONFIG) for world in worlds])
    for name, expected in pack_courses(worlds, CONFIG)._asdict().items():
        assert np.array_equal(getattr(joined, name), expected), name


def test_a_sounded_river_is_that_of_the_whole_world(easy_world: World):
    alone = sound(LEVELS["Easy"], easy_world.seed)
    whole, bed = (pack_courses([world], CONFIG) for world in (easy_world, alone))
    for name, expected in whole._asdict().items():
        assert np.array_equal(getattr(bed, name), expected), name
    assert len(whole.rock) > 0


def test_a_sounded_river_is_kept(easy_world: World):
    first = load_or_sound(LEVELS["Easy"], easy_world.seed)
    assert sounded_path(LEVELS["Easy"], easy_world.seed).is_file()
    again = load_or_sound(LEVELS["Easy"], easy_world.seed)
    assert np.array_equal(first.ground_m, again.ground_m) and np.array_equal(first.plants.kind, again.plants.kind)
