"""Tests of the segments of the river that a flight is credited with."""

import math

import numpy as np
import pytest

from tests.env.flights import BACKWARD, FORWARD, HOVER, LEFT, TURN_LEFT, at, fly, step
from tests.env.handmade import canal, hairpin, ring, world_of
from thalweg.env import DoneReason, EnvConfig
from thalweg.env.initial_poses import project_anywhere
from thalweg.env.task.course_arrays import pack_courses
from thalweg.env.task.progress import track_projection

Z = 5.0


def visited(env) -> list[int]:
    return np.flatnonzero(env.state.visited[0]).tolist()


def test_the_segment_at_the_start_is_credited_on_the_first_step():
    env = at(canal(20.0), (5.5, 0.0, Z, 0.0))
    assert visited(env) == []
    assert step(env, HOVER)[0] == pytest.approx(10 / 20)
    assert visited(env) == [5]
    assert step(env, HOVER)[0] == 0.0


def test_every_segment_passed_in_one_step_is_credited():
    env = at(canal(20.0, spacing_m=0.25), (5.1, 0.0, Z, 0.0))
    reward = step(env, FORWARD)[0]
    assert visited(env) == [20, 21, 22, 23, 24]
    assert reward == pytest.approx(10 * 5 / 80)


def test_segments_are_credited_in_either_direction():
    env = at(canal(20.0), (5.5, 0.0, Z, 0.0), allow_backward=True)
    fly(env, [BACKWARD] * 3)
    assert visited(env) == [2, 3, 4, 5]


def test_a_segment_is_paid_once():
    env = at(canal(20.0), (5.5, 0.0, Z, 0.0), allow_backward=True)
    rewards = [reward for reward, _, _ in fly(env, [FORWARD, BACKWARD, FORWARD, FORWARD])]
    assert rewards == pytest.approx([1.0, 0.0, 0.0, 0.5])


def test_the_inside_of_a_bend_skips_no_segment():
    world = ring(radius_m=6.0, count=60, width_m=10.0)
    inside = 6.0 - 4.5
    env = at(world, (inside, 0.0, Z, math.pi / 2))
    fly(env, [(1, 0, 0, 1)] * 2)
    assert visited(env) == list(range(len(visited(env))))
    assert len(visited(env)) > 10


@pytest.mark.parametrize("yaw", [math.pi / 2, -math.pi / 2])
def test_a_whole_loop_pays_ten_in_either_direction(yaw: float):
    world = ring(radius_m=20.0, count=96, width_m=8.0)
    env = at(world, (20.0, 0.05, Z, yaw), max_steps=1000)
    flown = fly(env, _circling(env, 400))
    assert flown[-1][2] is DoneReason.SUCCESS
    assert sum(reward for reward, _, _ in flown) == pytest.approx(10.0, abs=1e-12)
    assert flown[-1][1] == 0.0


def _circling(env, count: int):
    """Forward all the time, turned so that the heading stays near the tangent."""
    for _ in range(count):
        x, y, _, yaw = env.state.pose[0]
        tangent = math.atan2(y, x) + env.state.travel[0] * math.pi / 2
        error = math.remainder(tangent - yaw, 2 * math.pi)
        yield (1, 0 if error > 0.09 else 2 if error < -0.09 else 1, 0, 1)


def test_closure_credits_the_last_and_the_first_segment_alike():
    world = ring(radius_m=20.0, count=96)
    angle = 2 * math.pi * 95.5 / 96
    env = at(world, (20 * math.cos(angle), 20 * math.sin(angle), Z, angle + math.pi / 2))
    fly(env, [FORWARD] * 2)
    assert visited(env) == [0, 1, 95]


def test_the_projection_never_jumps_to_the_other_arm_of_a_hairpin():
    world = hairpin(arm_m=30.0, gap_m=10.0, width_m=9.0)
    courses = pack_courses([world], EnvConfig())
    _, projection = track_projection(courses, 0, 10, 10.5, 9.0)
    assert projection.segment == 10
    assert projection.distance == pytest.approx(9.0)


def test_flying_over_to_the_other_arm_is_out_of_volume_and_credits_none_of_it():
    world = hairpin(arm_m=30.0, gap_m=4.0, width_m=3.0)
    env = at(world, (15.5, 0.0, Z, 0.0))
    flown = fly(env, [LEFT] * 8)
    assert flown[-1][2] is DoneReason.OUT_OF_VOLUME_HORIZONTAL
    assert len(flown) == 4
    assert visited(env) == [15]


def test_round_the_hairpin_the_arms_are_visited_one_after_the_other():
    world = hairpin(arm_m=30.0, gap_m=12.0, width_m=10.0)
    env = at(world, (28.5, 0.0, Z, 0.0), max_steps=1000)
    for _ in range(12):
        step(env, (1, 0, 0, 1))
    seen = visited(env)
    assert seen == list(range(seen[0], seen[-1] + 1))
    assert seen[-1] > 40


def test_a_pose_between_two_arms_is_located_in_the_water_it_is_over():
    world = hairpin(arm_m=30.0, gap_m=10.0, width_m=np.r_[np.full(46, 12.0), np.full(46, 4.0)])
    projection = project_anywhere(pack_courses([world], EnvConfig()), 0, 15.5, 5.5)
    assert projection.segment == 15
    assert projection.distance == pytest.approx(5.5)


def test_an_open_course_succeeds_at_the_end_ahead_only():
    env = at(canal(20.0), (10.5, 0.0, Z, 0.0))
    flown = fly(env, [FORWARD] * 30)
    assert (len(flown), flown[-1][2]) == (9, DoneReason.SUCCESS)
    assert sum(reward for reward, _, _ in flown) == pytest.approx(10 * 10 / 20)


def test_an_open_course_flown_the_other_way_succeeds_at_its_first_sample():
    env = at(canal(20.0), (10.5, 0.0, Z, math.pi))
    flown = fly(env, [FORWARD] * 30)
    assert (len(flown), flown[-1][2]) == (10, DoneReason.SUCCESS)


def test_the_end_behind_is_no_success():
    env = at(canal(20.0), (3.5, 0.0, Z, 0.0), allow_backward=True)
    flown = fly(env, [BACKWARD] * 30)
    assert flown[-1][2] is DoneReason.OUT_OF_VOLUME_HORIZONTAL


def test_package_scheme_pays_one_for_any_new_segment():
    env = at(canal(20.0, spacing_m=0.25), (5.1, 0.0, Z, 0.0), reward_scheme="package")
    rewards = [reward for reward, _, _ in fly(env, [HOVER, FORWARD, HOVER, TURN_LEFT, FORWARD])]
    assert rewards == [1.0, 1.0, 0.0, 0.0, 1.0]


def test_progress_is_the_share_of_segments():
    env = at(canal(20.0), (5.5, 0.0, Z, 0.0))
    assert [step(env, action)[3]["progress"][0] for action in (HOVER, FORWARD)] == pytest.approx([0.05, 0.1])


def test_corners_of_a_coarse_line_are_followed():
    world = world_of([[0, 0], [10, 0], [10, 10], [0, 10]], width_m=4.0)
    env = at(world, (8.5, 0.0, Z, 0.0), max_yaw_deviation_deg=180)
    fly(env, [FORWARD, FORWARD, *[TURN_LEFT] * 9, FORWARD])
    assert visited(env) == [0, 1]
