"""The proof that the task can be done: the scripted pilot reaches Success from any start."""

import math

import numpy as np
import pytest

from tests.env.flights import at
from tests.env.handmade import canal, hairpin, ring
from tests.env.winding import river
from thalweg.env import DoneReason, EnvConfig, RiverVectorEnv, sample_starts
from thalweg.env.pilot.route import plan_route
from thalweg.env.task.course_arrays import pack_courses
from thalweg.env.task.progress import track_projection
from thalweg.env.task.termination import island_at, metres_past_bank
from thalweg.world.bridges import bridge_across

LEVELS = ("Easy", "Medium", "Hard")
STEPS = 450
"""Fewer than the 500 of the step limit, so that every river takes fewer than 500 perfect steps with room to spare."""


def fly_all(worlds, per_world: int, seed: int, **options) -> tuple[np.ndarray, np.ndarray]:
    """(done reasons, steps) of one episode in each of per_world environments per world."""
    config = EnvConfig(observation="none", **options)
    env = RiverVectorEnv(worlds, per_world * len(worlds), config)
    env.reset(seed=seed)
    reasons = np.full(env.num_envs, -1)
    steps = np.zeros(env.num_envs, dtype=int)
    for step in range(1, 501):
        _, _, _, _, info = env.step(env.pilot_actions())
        new = (reasons < 0) & (info["done_reason"] >= 0)
        reasons[new], steps[new] = info["done_reason"][new], step
        if (reasons >= 0).all():
            break
    return reasons, steps


@pytest.mark.parametrize("level", LEVELS)
def test_the_pilot_finishes_every_level_from_random_starts(level: str):
    reasons, steps = fly_all([river(level, 1)], 12, seed=0)
    assert set(reasons) == {DoneReason.SUCCESS}
    assert steps.max() < STEPS


@pytest.mark.slow
@pytest.mark.parametrize("level", LEVELS)
def test_the_pilot_finishes_fifty_other_rivers_of_each_level(level: str):
    reasons, steps = fly_all([river(level, seed) for seed in range(2, 52)], 2, seed=100)
    assert set(reasons) == {DoneReason.SUCCESS}
    assert steps.max() < STEPS


@pytest.mark.parametrize(
    "pose",
    [
        (-19.9, 0.0, 0.6, math.radians(-90.0 + 80.0)),
        (22.4, 0.0, 14.9, math.radians(90.0 - 80.0)),
        (17.6, 0.0, 0.6, math.radians(-90.0 - 80.0)),
    ],
)
def test_the_pilot_recovers_from_a_start_at_the_bank_that_looks_ashore(pose):
    env = at(ring(radius_m=20.0, count=96, width_m=5.0), pose, mode="SAME_STEP")
    reasons = []
    while not reasons:
        info = env.step(env.pilot_actions())[4]
        reasons += [reason for reason in info["done_reason"] if reason >= 0]
    assert reasons == [DoneReason.SUCCESS]


@pytest.mark.parametrize("x", [12.0, 17.5])
def test_the_pilot_climbs_before_a_bridge(x: float):
    bridge = bridge_across(np.array([20.0, 0.0]), np.array([1.0, 0.0]), 6.0, 0.0, np.random.default_rng(1))[None]
    env = at(canal(bridges=bridge), (x, 0.0, 0.6, 0.0))
    reason = -1
    while reason < 0:
        reason = env.step(env.pilot_actions())[4]["done_reason"][0]
    assert reason == DoneReason.SUCCESS


def test_the_line_keeps_off_banks_and_islands():
    world = river("Hard", 1)
    courses = pack_courses([world], EnvConfig())
    line = plan_route(courses, EnvConfig()).line
    for sample, (x, y) in enumerate(line):
        _, projection = track_projection(courses, 0, sample, x, y)
        assert metres_past_bank(courses, 0, projection) < -0.3
        assert island_at(courses, 0, x, y) < 0


def test_the_line_is_shorter_than_the_course():
    world = river("Hard", 1)
    line = plan_route(pack_courses([world], EnvConfig()), EnvConfig()).line
    length = np.linalg.norm(np.roll(line, -1, axis=0) - line, axis=1).sum()
    assert 0.8 * world.river.length_m < length < world.river.length_m


def test_the_pilot_flies_an_open_course_either_way():
    world = canal(80.0, width_m=8.0, islands=[[40.0, 0.0, 4.0, 1.2, 0.0]], level_m=np.linspace(4.0, 0.0, 81))
    starts = sample_starts(world, 20, seed=0)
    env = RiverVectorEnv(world, 20, EnvConfig(observation="none"))
    env.reset(seed=0, options={"pose": starts})
    reasons = np.full(20, -1)
    for _ in range(120):
        info = env.step(env.pilot_actions())[4]
        reasons = np.where(reasons < 0, info["done_reason"], reasons)
    assert set(reasons) == {DoneReason.SUCCESS}
    assert {-1, 1} == set(np.sign(np.cos(starts[:, 3])).astype(int))


def test_the_pilot_speaks_the_language_of_the_action_space():
    shares = {}
    for action in ("multidiscrete", "continuous"):
        env = at(hairpin(), (10.5, 0.0, 9.0, 0.3), action=action)
        actions = env.pilot_actions()
        assert actions in env.action_space
        shares[action] = actions
    assert np.array_equal(1 - shares["multidiscrete"], shares["continuous"])


def test_the_pilot_depends_on_nothing_but_the_state():
    env = RiverVectorEnv([ring(), hairpin()], 6, EnvConfig(observation="none"))
    env.reset(seed=0)
    first = env.pilot_actions()
    assert np.array_equal(first, env.pilot_actions())
    env.step(first)
    state = env.get_state()
    other = RiverVectorEnv([ring(), hairpin()], 6, EnvConfig(observation="none"))
    other.set_state(state)
    assert np.array_equal(env.pilot_actions(), other.pilot_actions())
