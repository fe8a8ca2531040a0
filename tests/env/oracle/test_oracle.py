"""Tests of the oracle's flights against exact dynamic programming and in worlds whose best flight is known."""

from dataclasses import replace

import numpy as np
import pytest

from tests.env.handmade import canal, hairpin
from tests.env.task.priced.flights import made
from thalweg.env import ConfigError, DoneReason, EnvConfig, RiverVectorEnv
from thalweg.env.oracle.oracle import Oracle
from thalweg.env.spaces import from_unit_actions
from thalweg.env.task.course_arrays import pack_courses
from thalweg.env.tasks import TASKS
from thalweg.world.bridges import bridge_across


def flight(env: RiverVectorEnv, price: float, pose: tuple[float, ...] | None = None, seed: int = 0):
    """Return (returns [N], costs [N], plan) of flights at a price."""
    return ended(env, price, pose, seed)[:3]


def ended(env: RiverVectorEnv, price: float, pose: tuple[float, ...] | None = None, seed: int = 0):
    """Return (returns [N], costs [N], plan, codes [N] of why they ended) of flights at a price."""
    env.reset(seed=seed, options=None if pose is None else {"pose": np.array(pose)})
    oracle = Oracle(env.courses, env.config, price)
    plan, ahead = oracle.plan(env.state)
    returns, costs, flying = np.zeros(env.num_envs), np.zeros(env.num_envs), np.ones(env.num_envs, bool)
    reasons = np.full(env.num_envs, -1)
    while flying.any():
        actions = from_unit_actions("multidiscrete", oracle.actions(plan, env.state, ahead, flying))
        _, reward, terminated, truncated, info = env.step(actions)
        returns[flying] += reward[flying]
        costs[flying] += info["cost"][flying]
        reasons[flying] = info["done_reason"][flying]
        flying &= ~(terminated | truncated)
    return returns, costs, plan, reasons


@pytest.mark.parametrize("price", [0.0, 0.05, 1.0])
def test_hurrying_past_swimmers_is_nearly_as_good_as_the_exact_optimum(price: float):
    env = made("Swimmers", canal(length_m=200.0, width_m=8.0), 4)
    returns, costs, plan = flight(env, price, (2.0, 0.0, 7.0, 0.0))
    exact = plan.speed_value[:, 0, 0]
    assert (returns - price * costs > exact - 0.4).all()
    # A move aside makes a step of 1 m longer by 12 %, which the tables leave out.
    assert (returns - price * costs < 1.12 * exact + 0.2).all()


def test_a_dear_flight_past_swimmers_costs_nothing_and_returns_less():
    env = made("Swimmers", canal(length_m=200.0, width_m=8.0), 4)
    free, dear = (flight(env, price, (2.0, 0.0, 7.0, 0.0)) for price in (0.0, 5.0))
    assert (dear[1] == 0.0).all() and (free[1] > 5).all()
    assert (dear[0] < free[0] - 1.0).all()


@pytest.mark.parametrize("price", [0.0, 1.0])
def test_climbing_over_reserves_is_nearly_as_good_as_the_exact_optimum(price: float):
    env = made("Nests", canal(length_m=200.0, width_m=8.0), 2)
    returns, costs, plan = flight(env, price, (2.0, 0.0, 2.0, 0.0))
    index = round((2.0 - env.limits.min_height) / 0.5)
    exact = plan.climb_value[:, 0, index]
    assert (returns - price * costs > exact - 0.4).all()


BRIDGE = bridge_across(np.array([60.0, 0.0]), np.array([1.0, 0.0]), 8.0, 0.0, np.random.default_rng(1))[None]


@pytest.mark.parametrize("price", [0.0, 0.3, 10.0])
def test_no_flight_waits_before_a_bridge_or_a_reserve_until_it_ends(price: float):
    world = canal(length_m=120.0, width_m=8.0, bridges=BRIDGE)
    for height in np.arange(0.6, 3.6, 0.4):
        env = made("Nests", world, 1)
        _, costs, _, reasons = ended(env, price, (2.0, 0.0, height, 0.0))
        assert reasons.tolist() == [DoneReason.SUCCESS], height
        assert price < 0.1 or costs[0] == 0.0


@pytest.mark.parametrize("price", [0.05, 0.3])
def test_a_course_with_a_narrow_stretch_is_flown_through_where_that_pays(price: float):
    width = np.full(201, 12.0)
    width[90:110] = 3.0
    env = made("RacingLine", canal(length_m=200.0, width_m=width), 1)
    returns, costs, plan = flight(env, price, (2.0, 3.0, 7.0, 1.3))
    assert returns[0] - price * costs[0] > plan.speed_value[0, 0, 0] - 0.6
    assert returns[0] > 9.0 - 20.0 * 0.05  # ten steps at most through the narrows, and a few to turn


def test_a_free_portage_crosses_the_neck_and_a_dear_one_stays_over_water():
    env = made("Portage", hairpin(), 1)
    x, y = env.courses.position[2]
    course = np.arctan2(env.courses.tangent[2, 1], env.courses.tangent[2, 0])
    free, dear = (flight(env, price, (x, y, 7.0, course)) for price in (0.0, 10.0))
    assert free[0][0] > 9.0 and free[1][0] > 3
    assert dear[1][0] == 0.0 and dear[0][0] < free[0][0]


def test_a_wide_canal_costs_no_clearance():
    env = made("RacingLine", canal(length_m=100.0, width_m=12.0), 2)
    returns, costs, _ = flight(env, 1.0, (2.0, 0.0, 7.0, 0.0))
    assert (costs == 0.0).all() and (returns > 9.0).all()


@pytest.mark.parametrize(
    ("task", "worlds", "price", "message"),
    [
        ("River", 1, 0.0, "the task River has no price"),
        ("Nests", 2, 0.0, "in one river, not in 2"),
        ("Nests", 1, -1.0, "price must be a finite number of 0 or more, not -1.0"),
        ("Nests", 1, float("nan"), "price must be a finite number of 0 or more, not nan"),
        ("Nests", 1, float("inf"), "price must be a finite number of 0 or more, not inf"),
    ],
)
def test_what_an_oracle_cannot_fly_is_refused(task, worlds, price, message):
    config = EnvConfig(observation="none", task=task)
    with pytest.raises(ConfigError, match=message):
        Oracle(pack_courses([canal()] * worlds, config), config, price)


@pytest.mark.parametrize(
    ("fast_m", "step_m", "message"),
    [
        (2.5, 1.0, "fast_step_m of Swimmers must be whole, not 2.5"),
        (2.0, 0.5, "forward_step_m must be 1 in the task Swimmers, not 0.5"),
    ],
)
def test_steps_that_its_tables_do_not_have_are_refused(fast_m, step_m, message, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(TASKS, "Swimmers", replace(TASKS["Swimmers"], fast_step_m=fast_m))
    config = EnvConfig(observation="none", task="Swimmers", forward_step_m=step_m)
    with pytest.raises(ConfigError, match=message):
        Oracle(pack_courses([canal()], config), config, 0.0)
