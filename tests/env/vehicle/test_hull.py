"""Depths under the hull, what it hits, and the cost of shallow water, by hand and beside SciPy and slow polygons."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy

from tests.env.vehicle.basins import arch_at, basin
from tests.env.vehicle.polygons import distance, gap, rectangle
from thalweg.env import EnvConfig
from thalweg.env.task.course_arrays import pack_courses
from thalweg.env.task.motion import Pose
from thalweg.env.vehicle.boat import Boat
from thalweg.env.vehicle.hull import (
    AGROUND,
    CLEAR,
    SOLID,
    depth_at,
    first_hit,
    least_depth,
    shallow_cost,
    touches_solid,
)
from thalweg.env.vehicle.soundings import half_opening
from thalweg.world.bridges import Bridge
from thalweg.world.record import World

CONFIG = EnvConfig(vehicle="asv")
LIMITS = CONFIG.limits


def plane(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.8 + 0.01 * x + 0.05 * y


def test_the_depth_under_a_hull_is_the_least_under_any_of_its_corners_over_a_plane():
    courses = pack_courses([basin(plane)], CONFIG)
    assert depth_at(courses, 0, 20.1, 1.3) == pytest.approx(0.8 + 0.201 + 0.065, abs=1e-6)
    # Heading east: the stern is 1 m west, the starboard side 0.54 m south, where the water is least deep.
    assert least_depth(courses, 0, 20.0, 1.0, 0.0, LIMITS) == pytest.approx(0.8 + 0.19 + 0.05 * 0.46, abs=1e-6)
    # Heading north: the port side is 0.54 m west, the stern 1 m south.
    north = least_depth(courses, 0, 20.0, 1.0, math.pi / 2, LIMITS)
    assert north == pytest.approx(0.8 + 0.01 * 19.46 + 0.0, abs=1e-6)


def test_depths_are_those_of_the_map_linear_between_its_nodes():
    rng = np.random.default_rng(0)
    world = basin(lambda x, y: 1.0 + 0.2 * np.sin(3 * x) * np.cos(2 * y))
    courses = pack_courses([world], CONFIG)
    points = np.column_stack([rng.uniform(0, 60, 300), rng.uniform(-6, 6, 300)])
    column, row = (points - [world.grid.origin_x_m, world.grid.origin_y_m]).T / world.grid.cell_m
    depth = world.water_m.astype(float) - world.ground_m
    expected = scipy.ndimage.map_coordinates(depth, [row, column], order=1)
    found = [depth_at(courses, 0, x, y) for x, y in points]
    assert found == pytest.approx(expected, abs=1e-6)
    assert min(found) < 0 < max(found)
    assert depth_at(courses, 0, -1000.0, 0.0) == depth_at(courses, 0, 30.0, math.nan) == -1.0


@pytest.mark.parametrize(("depth", "cost"), [(0.52, 0.0), (0.42, 0.0), (0.395, 0.25), (0.37, 0.5), (0.33, 0.9)])
def test_shallow_water_costs_the_missing_share_of_the_margin(depth: float, cost: float):
    flat = basin(lambda x, y: np.full(x.shape, depth))
    courses = pack_courses([flat], CONFIG)
    pose = Pose(30.0, 0.0, 1.2, 0.3)
    assert shallow_cost(courses, 0, LIMITS, pose) == pytest.approx(cost, abs=1e-5)
    dear = replace(CONFIG, boat=Boat(shallow_cost=3.0)).limits
    assert shallow_cost(courses, 0, dear, pose) == pytest.approx(3.0 * cost, abs=3e-5)


def test_rocks_are_hit_as_slow_polygons_hit_them():
    world = basin(rocks=((20.0, 1.0, 0.7), (22.0, -1.5, 1.2), (30.0, 0.0, 0.3)))
    courses = pack_courses([world], CONFIG)
    # A stone is widest a fifth up, 0.3 m below the water, above the keels.
    assert courses.rock[:, 2] == pytest.approx([0.7, 1.2, 0.3])
    rng = np.random.default_rng(2)
    hits = 0
    for _ in range(1000):
        x, y, yaw = rng.uniform(17, 33), rng.uniform(-3, 3), rng.uniform(-4, 4)
        hull = rectangle(x, y, yaw, 1.0, 0.54)
        apart = min(distance(hull, rock[:2]) - rock[2] for rock in courses.rock)
        if abs(apart) > 1e-6:
            assert touches_solid(courses, 0, x, y, yaw, LIMITS, 0.0) == (apart < 0)
            hits += apart < 0
    assert 100 < hits < 900


@pytest.mark.parametrize("width_m", [4.0, 10.0])
def test_piers_and_arches_are_hit_as_slow_polygons_hit_them(width_m: float):
    world = basin(width_m=width_m, bridges=arch_at(30.0, width_m))
    courses = pack_courses([world], CONFIG)
    bridge = Bridge(*world.bridges[0])
    open_hull, open_mast = half_opening(bridge, 0.75), half_opening(bridge, 1.2)
    pier = 0.5 * (bridge.length / 2 - open_hull)
    piers = [rectangle(30.0, side * (open_hull + pier), math.pi / 2, pier, bridge.width / 2) for side in (1, -1)]
    rng = np.random.default_rng(3)
    hits = 0
    for _ in range(1000):
        x, y, yaw = 30.0 + rng.uniform(-4, 4), rng.uniform(-1, 1) * width_m / 2, rng.uniform(-4, 4)
        hull = rectangle(x, y, yaw, 1.0, 0.54)
        apart = min(gap(hull, polygon) for polygon in piers)
        under = abs(x - 30.0) <= bridge.width / 2 and open_mast <= abs(y)
        if apart == 0.0 or apart > 1e-6:
            assert touches_solid(courses, 0, x, y, yaw, LIMITS, 0.0) == (apart == 0.0 or under)
            hits += apart == 0.0 or under
    assert 100 < hits < 900


def test_the_opening_of_an_arch_is_that_of_an_ellipse():
    bridge = Bridge(*arch_at(0.0, 6.4)[0])  # span 6 m, springing 0.1 m above the water, 1.65 m high
    assert (bridge.span, bridge.spring_z, bridge.rise) == pytest.approx((6.0, 0.1, 1.65))
    assert half_opening(bridge, 0.1) == half_opening(bridge, -0.5) == pytest.approx(3.0)
    assert half_opening(bridge, 0.1 + 0.6 * 1.65) == pytest.approx(3.0 * 0.8)
    assert half_opening(bridge, 1.75) == pytest.approx(0.0, abs=1e-6) and half_opening(bridge, 9.0) == 0.0


def test_a_hull_is_checked_along_its_way_and_turns_before_it_moves():
    bar = basin(lambda x, y: np.where(np.abs(x - 30.0) < 0.6, 0.1, 1.5))
    courses = pack_all_the_same(bar)
    start = Pose(26.0, 0.0, 1.2, 0.0)
    assert first_hit(courses, 0, LIMITS, start, Pose(27.9, 0.0, 1.2, 0.0)) == CLEAR
    # A bar that lies between the ends of a long move.
    assert first_hit(courses, 0, LIMITS, start, Pose(34.0, 0.0, 1.2, 0.0)) == AGROUND
    rock = pack_courses([basin(rocks=((30.0, 1.2, 0.3),))], CONFIG)
    assert first_hit(rock, 0, LIMITS, Pose(30.0, 0.0, 1.2, 0.0), Pose(30.0, 0.0, 1.2, 0.0)) == CLEAR
    assert first_hit(rock, 0, LIMITS, Pose(30.0, 0.0, 1.2, 0.0), Pose(30.0, 0.0, 1.2, math.pi / 2)) == SOLID


def test_a_hull_that_turns_and_moves_also_hits_what_the_turn_alone_would():
    rock = pack_courses([basin(rocks=((29.1, -0.66, 0.05),))], CONFIG)
    turn = math.radians(10.0)
    start, turned = Pose(30.0, 0.0, 1.2, 0.0), Pose(30.0, 0.0, 1.2, turn)
    ahead = Pose(30.0 + math.cos(turn), math.sin(turn), 1.2, turn)
    assert first_hit(rock, 0, LIMITS, start, turned) == SOLID  # its stern swings to starboard
    assert first_hit(rock, 0, LIMITS, start, ahead) == SOLID
    assert first_hit(rock, 0, LIMITS, turned, ahead) == CLEAR


def pack_all_the_same(world: World):
    """The courses of a river through which there is no way, which packing alone refuses."""
    from thalweg.env.vehicle.soundings import take_soundings

    deep = pack_courses([basin()], CONFIG)
    return deep._replace(**take_soundings([world], CONFIG.boat))
