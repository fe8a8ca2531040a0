"""Tests of the reasons for which an episode ends, their order and their cost."""

import math

import numpy as np
import pytest

from tests.env.flights import FORWARD, HOVER, LEFT, at, fly, step
from tests.env.handmade import canal, ring, world_of
from thalweg.env import DoneReason, EnvConfig
from thalweg.env.task.course_arrays import pack_courses
from thalweg.env.task.reward_cost import step_costs
from thalweg.env.task.termination import done_reason
from thalweg.world.bridges import bridge_across

BRIDGE = bridge_across(np.array([20.0, 0.0]), np.array([1.0, 0.0]), 6.0, 0.0, np.random.default_rng(1))[None]


@pytest.mark.parametrize(
    ("idle_limit", "hovers"),
    [(50, 51), (3, 4)],
)
def test_idle_ends_after_so_many_steps_without_a_new_segment(idle_limit: int, hovers: int):
    flown = fly(at(canal(), (10.5, 0.0, 5.0, 0.0), max_idle_steps=idle_limit), [HOVER] * 99)
    assert (len(flown), flown[-1]) == (hovers, (0.0, 0.2, DoneReason.IDLE))


def test_a_new_segment_begins_the_idle_count_again():
    flown = fly(at(canal(), (10.5, 0.0, 5.0, 0.0), max_idle_steps=3), [HOVER] * 3 + [FORWARD] + [HOVER] * 9)
    assert len(flown) == 7


@pytest.mark.parametrize("limit", [1, 7])
def test_the_step_limit_truncates(limit: int):
    env = at(canal(), (10.5, 0.0, 5.0, 0.0), max_steps=limit)
    for _ in range(limit - 1):
        assert step(env, FORWARD)[2] is DoneReason.RUNNING
    _, _, terminated, truncated, info = env.step([FORWARD])
    assert (terminated[0], truncated[0], info["done_reason"][0]) == (False, True, DoneReason.MAX_STEP_REACHED)
    assert info["cost"][0] == 0.2


def test_the_levels_have_500_steps_and_other_worlds_as_many_as_their_length_asks_for():
    def square(side_m: float, name: str = "handmade"):
        return world_of([[0, 0], [side_m, 0], [side_m, side_m], [0, side_m]], name=name)

    worlds = [square(93.5, "medium"), square(95.0, "Medium"), canal(99.0)]
    assert pack_courses(worlds, EnvConfig()).max_steps.tolist() == [500, 500, 134]
    others = [square(93.5), square(93.5, "Easy"), square(96.0, "Medium")]
    assert pack_courses(others, EnvConfig()).max_steps.tolist() == [505, 505, 519]
    assert pack_courses(worlds, EnvConfig(max_steps=77)).max_steps.tolist() == [77, 77, 77]


CASES = {
    DoneReason.COLLISION: ((17.0, 0.0, 1.0, 0.0), [FORWARD] * 3, 1.0, 0.0),
    DoneReason.OUT_OF_VOLUME_HORIZONTAL: ((10.0, 2.8, 5.0, 0.0), [LEFT], 1.0, 0.0),
    DoneReason.OUT_OF_VOLUME_VERTICAL: ((10.0, 0.0, 0.7, 0.0), [(2, 1, 1, 1)], 1.0, 0.0),
    DoneReason.YAW_OVER_DEVIATION: ((10.0, 0.0, 5.0, 1.5), [(1, 0, 1, 1)], 0.0, 0.2),
    DoneReason.IDLE: ((10.0, 0.0, 5.0, 0.0), [HOVER] * 51, 0.0, 0.2),
    DoneReason.MAX_STEP_REACHED: ((10.0, 0.0, 5.0, 0.0), [HOVER, FORWARD] * 99, 0.0, 0.2),
    DoneReason.SUCCESS: ((50.5, 0.0, 5.0, 0.0), [FORWARD] * 9, 0.0, 0.0),
}


@pytest.mark.parametrize("scheme", ["paper", "package"])
@pytest.mark.parametrize("reason", CASES, ids=lambda reason: reason.label)
def test_each_reason_has_its_cost_once_at_the_end(reason: DoneReason, scheme: str):
    pose, actions, tight, loose = CASES[reason]
    env = at(canal(bridges=BRIDGE), pose, max_steps=60 if reason == 5 else 500, reward_scheme=scheme)
    loose *= 1.0 if scheme == "paper" else 2.5
    for action in actions:
        _, _, terminated, truncated, info = env.step([action])
        if info["done_reason"][0] >= 0:
            break
        assert not info["costs"].any()
        assert not (terminated[0] or truncated[0])
    assert info["done_reason"][0] == reason
    assert info["costs"][0] == pytest.approx([tight, loose])
    assert info["cost"][0] == pytest.approx(tight + loose)
    assert (terminated[0], truncated[0]) == (reason != 5, reason == 5)


def test_reasons_are_checked_in_the_order_of_their_codes():
    """One flight into a bridge over the bank below the water, turned too far, at the last idle step."""
    limits = EnvConfig().limits
    assert done_reason(0, 50, 500, True, limits, 500) == 0
    assert done_reason(3, 50, 500, True, limits, 500) == 3
    assert done_reason(-1, 50, 500, True, limits, 500) == 4
    assert done_reason(-1, 49, 500, True, limits, 500) == 5
    assert done_reason(-1, 49, 499, True, limits, 500) == 6
    assert done_reason(-1, 49, 499, False, limits, 500) == -1


def test_of_several_dangers_the_first_is_reported():
    world = canal(bridges=BRIDGE, width_m=6.0)
    down_left_turned = (2, 0, 1, 0)
    assert step(at(world, (20.0, 2.9, 4.0, 1.5), vertical_step_m=6.0), down_left_turned)[2] == 0
    assert step(at(world, (10.0, 2.9, 4.0, 1.5), vertical_step_m=6.0), (2, 0, 0, 1))[2] == 1
    assert step(at(world, (10.0, 0.0, 4.0, 1.5), vertical_step_m=6.0), down_left_turned)[2] == 2
    assert step(at(world, (10.0, 0.0, 4.0, 1.5)), down_left_turned)[2] == 3


@pytest.mark.parametrize("code", range(-1, 7))
def test_at_most_one_cost_is_charged(code: int):
    expected = {0: (1, 0), 1: (1, 0), 2: (1, 0), 3: (0, 0.2), 4: (0, 0.2), 5: (0, 0.2)}.get(code, (0, 0))
    assert step_costs(code, EnvConfig().limits) == pytest.approx(expected)


def test_a_loop_is_no_success_before_its_last_segment():
    env = at(ring(radius_m=20.0, count=96), (20.0, 0.5, 5.0, math.pi / 2))
    env.state.visited[0, 2:95] = 1
    env.state.visited_count[0] = 93
    assert step(env, HOVER)[2] is DoneReason.RUNNING
    env.state.visited[0, 95] = 1
    env.state.visited_count[0] += 1
    assert step(env, FORWARD)[2] is DoneReason.SUCCESS
