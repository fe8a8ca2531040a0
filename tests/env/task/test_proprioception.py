"""Tests of proprioception: single steps worked by hand, and random flights against complex numbers."""

import cmath
import math

import numpy as np
import pytest

from tests.env.flights import BACKWARD, DOWN, FORWARD, HOVER, LEFT, RIGHT, TURN_LEFT, TURN_RIGHT, UP
from tests.env.handmade import canal, ring
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.physics.wind import Wind
from thalweg.env.task.proprioception import PROPRIOCEPTION

FELT = EnvConfig(observation=("proprioception",))
TURN = math.radians(10) / 0.25
"""Radians per second of a turn of ten degrees in a quarter of a second."""


def flown(world, pose, actions, **options) -> list[np.ndarray]:
    """What one environment feels at a pose [4], and after each action."""
    env = RiverVectorEnv(world, 1, FELT.with_options(**options), autoreset_mode="DISABLED")
    first, _ = env.reset(seed=0, options={"pose": pose})
    return [first["proprioception"][0], *(env.step(np.array([action]))[0]["proprioception"][0] for action in actions)]


@pytest.mark.parametrize(
    ("action", "felt"),
    [
        (HOVER, (2.25, 0, 0, 0, 0, 0, 0, 0, 0)),
        (UP, (3.25, 0, 0, 4, 0, 1, 0, 0, 0)),
        (DOWN, (1.25, 0, 0, -4, 0, -1, 0, 0, 0)),
        (TURN_LEFT, (2.25, 0, 0, 0, TURN, 0, 1, 0, 0)),
        (TURN_RIGHT, (2.25, 0, 0, 0, -TURN, 0, -1, 0, 0)),
        (FORWARD, (2.25, 4, 0, 0, 0, 0, 0, 1, 0)),
        (LEFT, (2.25, 0, 2, 0, 0, 0, 0, 0, 1)),
        (RIGHT, (2.25, 0, -2, 0, 0, 0, 0, 0, -1)),
        (BACKWARD, (2.25, 0, 0, 0, 0, 0, 0, -1, 0)),  # without effect, but it was commanded
        ((0, 2, 0, 0), (3.25, 4, 2, 4, -TURN, 1, -1, 1, 1)),
    ],
)
def test_a_step_is_felt_in_metres_and_radians_per_second_in_the_frame_of_the_body(action, felt):
    start, after = flown(canal(level_m=0.75), [20.0, 0.5, 3.0, 0.3], [action])
    assert start.tolist() == [2.25, 0, 0, 0, 0, 0, 0, 0, 0]
    assert after.dtype == np.float32 and after.shape == (len(PROPRIOCEPTION),)
    np.testing.assert_allclose(after, felt, atol=1e-6)


@pytest.mark.parametrize(
    ("kind", "told"),
    [
        ("continuous", {1.0: -1.0, 0.75: -0.75, 0.5: 1.0, 0.25: 0.5, -1.0: 0.0}),
        ("multidiscrete", {0: 1.0, 1: 0.0, 2: -1.0}),
    ],
)
def test_the_last_forward_of_a_task_with_a_fast_step_is_told_as_the_page_says(kind: str, told: dict[float, float]):
    rest = 0 if kind == "continuous" else 1
    actions = [(rest, rest, forward, rest) for forward in told]
    felt = flown(canal(), [5.0, 0.0, 3.0, 0.0], actions, task="Swimmers", action=kind)
    assert [after[7] for after in felt[1:]] == list(told.values())


def test_height_is_measured_from_the_water_under_the_vehicle():
    levels = np.linspace(0.0, 3.0, 61)
    start, after = flown(canal(level_m=levels), [20.0, 0.0, 4.0, 0.0], [FORWARD])
    assert (start[0], after[0]) == pytest.approx((4.0 - 1.0, 4.0 - 1.05))


def test_backward_motion_is_felt_where_it_is_possible():
    _, after = flown(canal(), [20.0, 0.0, 3.0, 0.2], [BACKWARD], allow_backward=True)
    np.testing.assert_allclose(after[[1, 2, 7]], [-4, 0, -1], atol=1e-6)


def test_a_turn_through_west_is_as_fast_as_any_other():
    _, after = flown(ring(), [0.0, 20.0, 3.0, math.pi - 0.01], [TURN_LEFT])
    assert after[4] == pytest.approx(TURN)


def test_continuous_actions_are_felt_as_they_were_given():
    given = np.array([0.5, -0.25, 1.0, -0.75], np.float32)
    _, after = flown(canal(), [20.0, 0.0, 3.0, 0.0], [given], action="continuous")
    assert after[5:].tolist() == given.tolist()
    np.testing.assert_allclose(after[1:5], [4, -1.5, 2, -0.25 * TURN], rtol=1e-6)


def test_velocities_are_per_second():
    _, after = flown(canal(), [20.0, 0.0, 3.0, 0.0], [FORWARD], step_s=0.5)
    assert after[1] == pytest.approx(2.0)


@pytest.mark.parametrize(
    "pushed", [{}, {"action": "continuous", "dynamics": "inertial", "wind": Wind()}], ids=["still", "pushed"]
)
def test_what_is_felt_in_random_flights_follows_from_the_poses(pushed: dict):
    config = FELT.with_options(**pushed)
    env = RiverVectorEnv([ring(level_m=1.5), canal(level_m=0.5)], 6, config, autoreset_mode="NEXT_STEP")
    _, info = env.reset(seed=1)
    random, poses, steps = np.random.default_rng(2), info["pose"], 0
    for _ in range(150):
        actions = random.uniform(-1, 1, (6, 4)) if pushed else random.integers(0, 3, (6, 4))
        obs, _, _, _, info = env.step(actions)
        for row in range(6):
            x, y, z, yaw = info["pose"][row]
            height = z - (1.5, 0.5)[row % 2]
            if env.state.steps[row] == 0:
                expected = [height, *[0.0] * 8]
            else:
                was = poses[row]
                moved = complex(x - was[0], y - was[1]) * cmath.exp(-1j * yaw) / 0.25
                turned = cmath.phase(cmath.exp(1j * (yaw - was[3]))) / 0.25
                expected = [
                    height,
                    moved.real,
                    moved.imag,
                    (z - was[2]) / 0.25,
                    turned,
                    *(actions[row] if pushed else 1 - actions[row]),
                ]
                steps += 1
            np.testing.assert_allclose(obs["proprioception"][row], expected, atol=1e-5)
        poses = info["pose"]
    assert 300 < steps < 900  # among them many resets
