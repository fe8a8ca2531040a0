"""Tests of the costs and rewards of tasks on random flights, against an independent computation."""

import numpy as np
import pytest

from tests.env.task.priced import reference
from tests.env.task.priced.flights import PRICED, flown, made, rivers
from thalweg.env import DoneReason

RIVERS = ("ring", "hairpin", "canal", "Hard")


@pytest.mark.parametrize("name", RIVERS)
def test_a_fast_step_near_a_swimmer_or_kayak_costs_one(name: str):
    world = rivers()[name]
    env = made("Swimmers", world)
    costs, fast = [], 0
    for _, action, told, before in flown(env, 150):
        places = reference.swimmers(
            world.river, env.courses.haunt, int(env.courses.swimmers[0]), int(before["scene"]), int(before["steps"]) + 1
        )
        near = np.hypot(*(places - told["pose"][:2]).T).min() <= 10.0
        costs.append(told["costs"][2])
        fast += action[2] == 2
        assert costs[-1] == float(near and action[2] == 2)
    assert sum(costs) > 0 and (name == "ring" or sum(costs) < fast)


@pytest.mark.parametrize("name", RIVERS)
def test_a_low_step_in_a_reserve_costs_one_and_the_reward_falls_with_height(name: str):
    world = rivers()[name]
    env = made("Nests", world, max_steps=60)
    costs, shares = [], []
    for _, _, told, before in flown(env, 120):
        x, y, z, _ = told["pose"]
        arc, past, level = reference.nearest(world.river, x, y)
        if past > 0 or told["done_reason"] >= 0:
            continue  # beyond the bank another arm may be nearer than the one that is flown along
        inside = ((env.courses.reserve[:, 0] <= arc) & (arc <= env.courses.reserve[:, 1])).any()
        costs.append(told["costs"][2])
        assert costs[-1] == float(inside and z - level < 8.0 - 1e-9)
        paid = 10 * (told["progress"] - before["visited_count"] / world.river.segments)
        if paid > 0:
            shares.append(told["reward"] / paid)
            assert shares[-1] == pytest.approx(min(1.0, (2.5 / (z - level)) ** 2))
    assert 0 < np.mean(costs) < 0.6 and min(shares) < 0.3 and max(shares) > 0.5


@pytest.mark.parametrize("name", RIVERS)
def test_the_cost_of_clearance_falls_with_the_distance_from_bank_island_and_stone(name: str):
    world = rivers()[name]
    env = made("RacingLine", world, 3 if name == "Hard" else 6)
    costs = []
    for _, _, told, _ in flown(env, 60 if name == "Hard" else 120):
        costs.append(told["costs"][2])
        wanted = 1 - min(reference.clearance(world, told["pose"], 0.5), 2.5) / 2.5
        if told["done_reason"] < 0:
            assert costs[-1] == pytest.approx(wanted, abs=1e-5)
    assert 0.02 < np.mean(np.array(costs) > 0) < 0.98 and len(np.unique(costs)) > 20


@pytest.mark.parametrize("name", RIVERS)
def test_a_step_over_land_costs_one_and_progress_to_the_station_is_paid(name: str):
    world = rivers()[name]
    river = world.river
    env = made("Portage", world, max_steps=80)
    greatest = river.length_m / 2 if river.closed else river.length_m
    costs, same, reached = [], [], 0
    for _, _, told, before in flown(env, 120):
        x, y, z, _ = told["pose"]
        arc, _, level = reference.nearest(river, x, y)
        apart = abs(arc - before["station"])
        left = min(apart, river.length_m - apart) if river.closed else apart
        land = reference.over_land(world, x, y)
        costs.append(told["costs"][2])
        assert costs[-1] == float(land)
        left = 0.0 if left <= 3.0 and not land else left
        gained = 10 * (before["way"] - left) / greatest
        same.append(
            abs(told["reward"] - gained) < 1e-9 and abs(told["progress"] - max(0.0, 1 - left / greatest)) < 1e-9
        )
        if land:
            low_or_high = not 0.5 - 1e-9 <= z - level <= 15 + 1e-9
            assert (told["done_reason"] == DoneReason.OUT_OF_VOLUME_VERTICAL) == low_or_high or len(world.bridges)
            assert told["done_reason"] not in (DoneReason.OUT_OF_VOLUME_HORIZONTAL, DoneReason.YAW_OVER_DEVIATION)
        reached += told["done_reason"] == DoneReason.SUCCESS
    # On the inside of a bend two points of the course may be locally nearest, of which the last one's neighbour counts.
    assert np.mean(same) > (0.95 if name == "Hard" else 0.9999)
    assert 0.1 < np.mean(costs) < 0.95 and (reached > 0 or name == "Hard")


@pytest.mark.parametrize("task", PRICED)
def test_cost_is_the_sum_of_its_kinds_those_of_an_ending_included(task: str):
    endings = 0.0
    for _, _, told, _ in flown(made(task, rivers()["ring"], max_steps=40), 120, seed=1):
        assert told["cost"] == told["costs"].sum() and len(told["costs"]) == 3
        tight = told["done_reason"] in (0, 1, 2)
        # A deadline is no violation: reason 5 has no cost of its own in these tasks.
        loose = told["done_reason"] in (3, 4)
        assert tuple(told["costs"][:2]) == (float(tight), 0.2 * loose)
        endings += told["costs"][:2].sum()
        ended = told["terminated"], told["truncated"]
        assert ended == (told["done_reason"] >= 0, False)  # a deadline is a part of its task
    assert endings > 0 or task != "Portage"


def test_the_first_outputs_of_the_independent_hash_are_those_of_its_authors():
    # See tests/env/test_torch_env.py.
    assert reference._hash(0) == 0xE220A8397B1DCDAF and 0 <= reference._uniform(7, 2, 3) < 1
