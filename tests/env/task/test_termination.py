"""Tests of the volume a flight must stay in: the banks and the band of heights."""

import itertools
import math

import numpy as np
import pytest
from scipy.optimize import linprog

from tests.env.flights import FORWARD, HOVER, UP, at, fly, step
from tests.env.handmade import canal, ring
from thalweg.env import DoneReason, EnvConfig
from thalweg.env.task.course_arrays import grown_hull, pack_courses
from thalweg.env.task.progress import Projection, interpolate
from thalweg.env.task.termination import first_bridge_hit, metres_past_bank, yaw_deviation
from thalweg.world.bridges import bridge_across, hull_planes

RIGHT = (1, 1, 1, 2)
LEFT = (1, 1, 1, 0)
DOWN = (2, 1, 1, 1)
SLIGHTLY = 1e-6


def bridge_at(x: float, width: float = 6.0) -> np.ndarray:
    """A bridge across a canal."""
    return bridge_across(np.array([x, 0.0]), np.array([1.0, 0.0]), width, 0.0, np.random.default_rng(1))[None]


@pytest.mark.parametrize(("y", "reason"), [(2.5 - SLIGHTLY, DoneReason.RUNNING), (2.5 + SLIGHTLY, 1)])
@pytest.mark.parametrize("side", [1, -1])
def test_the_bank_is_half_the_width_from_the_line(y: float, reason: int, side: int):
    env = at(canal(width_m=6.0), (10.0, side * y, 5.0, 0.0))
    assert step(env, LEFT if side > 0 else RIGHT)[2] == reason


def test_the_width_between_samples_is_linear():
    env = at(canal(20.0, spacing_m=10.0, width_m=[4.0, 8.0, 8.0]), (5.0, 2.5 - SLIGHTLY, 5.0, 0.0))
    assert step(env, LEFT)[2] is DoneReason.RUNNING
    assert step(env, LEFT)[2] is DoneReason.OUT_OF_VOLUME_HORIZONTAL


def test_metres_past_the_bank_are_positive_on_land():
    courses = pack_courses([canal(20.0, spacing_m=10.0, width_m=[4.0, 8.0, 8.0])], EnvConfig())
    assert metres_past_bank(courses, 0, Projection(0, 0.25, 3.0)) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("z", "action", "reason"),
    [
        (1.5 + 0.5, DOWN, DoneReason.RUNNING),
        (1.5 + 0.5 - SLIGHTLY, DOWN, DoneReason.OUT_OF_VOLUME_VERTICAL),
        (14.0 + 0.5, UP, DoneReason.RUNNING),
        (14.0 + 0.5 + SLIGHTLY, UP, DoneReason.OUT_OF_VOLUME_VERTICAL),
    ],
)
def test_height_counts_from_the_local_water_level(z: float, action, reason: DoneReason):
    env = at(canal(level_m=0.5), (10.0, 0.0, z, 0.0))
    assert step(env, action)[2] is reason


@pytest.mark.parametrize("level", [0.1 * tenth for tenth in range(40)])
def test_rounding_does_not_decide_at_the_edge_of_the_band(level: float):
    env = at(canal(level_m=level), (10.0, 0.0, level + 1.5, 0.0))
    assert step(env, DOWN)[2] is DoneReason.RUNNING


def test_the_level_between_samples_is_linear():
    world = canal(20.0, spacing_m=10.0, level_m=[0.0, 2.0, 2.0])
    assert interpolate(
        pack_courses([world], EnvConfig()), 0, Projection(0, 0.3, 0.0), world.river.level_m
    ) == pytest.approx(0.6)
    env = at(world, (4.9, 0.0, 1.5, 0.0))
    assert step(env, FORWARD)[2] is DoneReason.OUT_OF_VOLUME_VERTICAL


@pytest.mark.parametrize(("turns", "reason"), [(9, DoneReason.RUNNING), (10, DoneReason.YAW_OVER_DEVIATION)])
@pytest.mark.parametrize("branch", [0, 2])
@pytest.mark.parametrize("heading", [0.0, math.pi])
def test_nine_turns_of_ten_degrees_are_allowed_and_a_tenth_is_not(turns, reason, branch, heading):
    env = at(canal(), (10.5, 0.0, 5.0, heading))
    flown = fly(env, [(1, branch, 1, 1)] * turns)
    assert (len(flown), flown[-1][2]) == (turns, reason)


def test_the_heading_counts_from_the_direction_of_travel_chosen_at_the_start():
    env = at(canal(), (10.5, 0.0, 5.0, math.radians(100.0)))
    assert env.state.travel[0] == -1
    flown = fly(env, [(1, 2, 1, 1)] * 3)
    assert [reason for _, _, reason in flown] == [DoneReason.RUNNING, DoneReason.YAW_OVER_DEVIATION]


def test_the_course_turns_under_a_fixed_heading():
    courses = pack_courses([ring(radius_m=20.0, count=96)], EnvConfig())
    assert yaw_deviation(courses, 0, Projection(24, 0.0, 0.0), math.pi / 2, 1) == pytest.approx(math.pi / 2)
    assert yaw_deviation(courses, 0, Projection(24, 0.0, 0.0), math.pi / 2, -1) == pytest.approx(math.pi / 2)
    assert yaw_deviation(courses, 0, Projection(24, 0.5, 0.0), math.pi, 1) == pytest.approx(math.pi / 96)


@pytest.mark.parametrize(("x", "reason"), [(7.0 - SLIGHTLY, DoneReason.RUNNING), (7.0 + SLIGHTLY, 1)])
def test_an_island_is_land(x: float, reason: int):
    env = at(canal(islands=[[10.0, 0.0, 2.0, 1.0, 0.0]]), (x, 0.0, 5.0, 0.0))
    assert step(env, FORWARD)[2] == reason


def test_an_island_may_lie_askew():
    world = canal(width_m=12.0, islands=[[10.0, 0.0, 3.0, 0.5, math.pi / 4]])
    env = at(world, (9.5, 2.5, 5.0, -math.pi / 4))
    assert step(env, FORWARD)[2] is DoneReason.RUNNING
    assert step(env, FORWARD)[2] is DoneReason.OUT_OF_VOLUME_HORIZONTAL
    env = at(world, (11.0, -1.0, 5.0, 0.0))
    assert step(env, HOVER)[2] is DoneReason.RUNNING


def test_under_the_arch_is_a_collision_and_over_the_parapets_is_not():
    world = canal(bridges=bridge_at(20.0))
    assert fly(at(world, (15.0, 0.0, 1.0, 0.0)), [FORWARD] * 9)[-1][2] is DoneReason.COLLISION
    assert fly(at(world, (15.0, 0.0, 4.0, 0.0)), [FORWARD] * 9)[-1][2] is DoneReason.RUNNING


def test_the_body_collides_before_its_centre_does():
    """The cube's near face is half its edge ahead of the centre."""
    bridge = bridge_at(20.0)
    face = 20.0 - bridge[0][4] / 2.0
    for body, gap, reason in (
        (0.5, 0.25 + SLIGHTLY, DoneReason.RUNNING),
        (0.5, 0.25 - SLIGHTLY, DoneReason.COLLISION),
        (1.0, 0.5 + SLIGHTLY, DoneReason.RUNNING),
        (1.0, 0.5 - SLIGHTLY, DoneReason.COLLISION),
    ):
        env = at(canal(bridges=bridge), (face - gap - 1.0, 0.0, 1.0, 0.0), body_m=body)
        assert step(env, FORWARD)[2] is reason


def test_nothing_is_tunnelled_through_by_a_long_step():
    env = at(canal(bridges=bridge_at(20.0)), (10.0, 0.0, 1.0, 0.0), forward_step_m=20.0)
    assert step(env, FORWARD)[2] is DoneReason.COLLISION


def touches(planes: np.ndarray, a: np.ndarray, b: np.ndarray, half: float) -> bool:
    """Whether a cube that moves from a to b touches the solid: is there a point q of it and a time t with |q - p(t)|
    <= half?"""
    move = b - a
    box = [
        (np.concatenate([sign * axis, [-sign * axis @ move]]), half + sign * axis @ a)
        for axis, sign in itertools.product(np.eye(3), (1.0, -1.0))
    ]
    rows = np.array([row for row, _ in box])
    solid = np.column_stack([planes[:, :3], np.zeros(len(planes))])
    found = linprog(
        np.zeros(4),
        A_ub=np.concatenate([solid, rows]),
        b_ub=np.concatenate([planes[:, 3], [bound for _, bound in box]]),
        bounds=[(None, None)] * 3 + [(0.0, 1.0)],
    )
    return found.status == 0


def test_collisions_agree_with_linear_programming():
    rng = np.random.default_rng(0)
    tangent = np.array([math.cos(0.7), math.sin(0.7)])
    row = bridge_across(np.array([20.0, 1.0]), tangent, 6.0, 0.0, rng)
    courses = pack_courses([canal(bridges=row[None])], EnvConfig())
    planes, (_, vertices) = hull_planes(row), grown_hull(row, 0.5)
    low, high = vertices.min(axis=0) - 0.7, vertices.max(axis=0) + 0.7
    found = []
    for _ in range(400):
        a = rng.uniform(low, high)
        b = a + rng.normal(size=3) * rng.choice([0.0, 1.0])
        expected = touches(planes, a, b, 0.25)
        found.append(expected)
        assert (first_bridge_hit(courses, 0, *a, *b) >= 0) == expected, (a, b)
    assert 80 < sum(found) < 320


def test_the_grown_hull_is_smaller_than_its_planes_pushed_out():
    """At the edges of an oblique hull the cube's support alone would add too much."""
    row = bridge_across(
        np.array([20.0, 1.0]), np.array([math.cos(0.7), math.sin(0.7)]), 6.0, 0.0, np.random.default_rng(0)
    )
    planes = hull_planes(row)
    pushed = planes[:, 3] + 0.25 * np.abs(planes[:, :3]).sum(axis=1)
    grown, _ = grown_hull(row, 0.5)
    rng = np.random.default_rng(2)
    points = np.array([20.0, 1.0, 1.0]) + rng.uniform(-7, 7, size=(200_000, 3))
    inside_pushed = np.all(points @ planes[:, :3].T <= pushed, axis=1)
    inside_grown = np.all(points @ grown[:, :3].T <= grown[:, 3], axis=1)
    assert not np.any(inside_grown & ~inside_pushed)
    assert np.any(inside_pushed & ~inside_grown)


def test_the_bridges_of_another_world_are_not_hit():
    courses = pack_courses([canal(bridges=bridge_at(20.0)), canal(), canal(bridges=bridge_at(30.0))], EnvConfig())
    way = (19.0, 0.0, 1.0, 31.0, 0.0, 1.0)
    assert [first_bridge_hit(courses, world, *way) for world in range(3)] == [0, -1, 0]
    assert first_bridge_hit(courses, 2, 19.0, 0.0, 1.0, 21.0, 0.0, 1.0) == -1
