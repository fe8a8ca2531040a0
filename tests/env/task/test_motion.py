"""Tests of the motion model, for discrete and continuous actions."""

import math

import numpy as np
import pytest

from tests.env.flights import BACKWARD, FORWARD, HOVER, LEFT, TURN_LEFT, TURN_RIGHT, UP, at, step
from tests.env.handmade import canal
from thalweg.env import ActionError, DoneReason
from thalweg.env.task.motion import wrap_angle

START = (10.0, 0.0, 5.0, 0.0)
TEN = math.radians(10.0)


def pose_after(*actions, **options) -> np.ndarray:
    env = at(canal(), START, **options)
    for action in actions:
        info = step(env, action)[3]
    return info["pose"][0]


@pytest.mark.parametrize(
    ("action", "moved"),
    [
        (HOVER, (0, 0, 0, 0)),
        (UP, (0, 0, 1, 0)),
        ((2, 1, 1, 1), (0, 0, -1, 0)),
        (TURN_LEFT, (0, 0, 0, TEN)),
        (TURN_RIGHT, (0, 0, 0, -TEN)),
        (FORWARD, (1, 0, 0, 0)),
        (BACKWARD, (0, 0, 0, 0)),
        (LEFT, (0, 0.5, 0, 0)),
        ((1, 1, 1, 2), (0, -0.5, 0, 0)),
    ],
)
def test_each_branch_moves_by_its_step(action, moved):
    assert pose_after(action) == pytest.approx(np.add(START, moved), abs=1e-12)


def test_backward_moves_when_allowed():
    assert pose_after(BACKWARD, allow_backward=True) == pytest.approx((9.0, 0.0, 5.0, 0.0))


def test_branches_act_together_and_the_turn_comes_first():
    cos, sin = math.cos(TEN), math.sin(TEN)
    expected = (10 + cos - 0.5 * sin, sin + 0.5 * cos, 6.0, TEN)
    assert pose_after((0, 0, 0, 0)) == pytest.approx(expected)


def test_continuous_actions_are_shares_of_the_same_steps():
    moved = pose_after((-0.5, 0.5, 0.25, -1.0), action="continuous")
    cos, sin = math.cos(TEN / 2), math.sin(TEN / 2)
    assert moved == pytest.approx((10 + 0.25 * cos + 0.5 * sin, 0.25 * sin - 0.5 * cos, 4.5, TEN / 2))


def test_continuous_backward_has_no_effect():
    assert pose_after((0.0, 0.0, -1.0, 0.0), action="continuous") == pytest.approx(START)


def test_a_full_turn_comes_back_to_the_same_yaw():
    pose = pose_after(*[TURN_LEFT] * 36, max_yaw_deviation_deg=180.0)
    assert pose[3] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("angle", [-7.0, -math.pi, 0.0, 3.0, 4.0, 100.0])
def test_a_wrapped_angle_is_the_same_direction_within_a_half_turn(angle: float):
    assert -math.pi <= wrap_angle(angle) <= math.pi
    assert math.cos(wrap_angle(angle)) == pytest.approx(math.cos(angle))
    assert math.sin(wrap_angle(angle)) == pytest.approx(math.sin(angle), abs=1e-12)


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        ([[0, 1, 1, 3]], r"action 3 of environment 0 \(lateral\) is out of range 0..2"),
        ([[0, -1, 1, 1]], r"\(yaw\) is out of range"),
        ([[0.0, 1.0, 1.0, 1.0]], "type float64.*integers"),
        ([[True, True, True, True]], "type bool"),
        ([0, 1, 1, 1], r"shape \(4,\); needed: \(1, 4\)"),
        ([[0, 1, 1]], r"shape \(1, 3\)"),
    ],
)
def test_a_bad_discrete_action_is_refused_before_anything_changes(actions, message):
    env = at(canal(), START)
    before = env.get_state()
    with pytest.raises(ActionError, match=message):
        env.step(np.array(actions))
    assert all(np.array_equal(value, before[key]) for key, value in env.get_state().items())


@pytest.mark.parametrize("actions", [[[1.5, 0, 0, 0]], [[math.nan, 0, 0, 0]], [["up", "a", "b", "c"]]])
def test_a_bad_continuous_action_is_refused(actions):
    env = at(canal(), START, action="continuous")
    with pytest.raises(ActionError):
        env.step(np.array(actions))
    assert step(env, (0.0, 0.0, 0.0, 0.0))[2] is DoneReason.RUNNING
