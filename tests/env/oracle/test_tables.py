"""Tests of the oracle's tables against plain recursion and distances worked by hand."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy.ndimage

from tests.env.handmade import canal, hairpin, ring
from thalweg.env import EnvConfig
from thalweg.env.oracle.oracle import Oracle
from thalweg.env.oracle.overland import LandGrid
from thalweg.env.oracle.speeds import fill_speeds
from thalweg.env.task.course_arrays import pack_courses
from thalweg.env.tasks import TASKS

METRE = 0.1


def best_by_recursion(near: np.ndarray, completed: float, price: float) -> float:
    """The most that any sequence of moves of 0, 1 or 2 metres returns less its priced cost."""

    @cache
    def best(steps: int, ahead: int) -> float:
        if steps == len(near) - 1 or ahead >= completed:
            return 0.0
        totals = []
        for forward in range(3):
            reached = min(ahead + forward, near.shape[1] - 1)
            cost = price * near[steps + 1, reached] * (forward == 2)
            totals.append(METRE * (min(reached, completed) - ahead) - cost + best(steps + 1, reached))
        return max(totals)

    return best(0, 0)


@pytest.mark.parametrize("price", [0.0, 0.05, 0.15, 10.0])
def test_speeds_are_worth_what_the_best_of_all_moves_is(price: float):
    near = (np.random.default_rng(2).random((9, 16)) < 0.4).astype(np.uint8)
    value, speed = np.zeros(near.shape, np.float32), np.zeros(near.shape, np.int8)
    fill_speeds(near, np.zeros(16), 12.0, 2, METRE, price, value, speed)
    assert value[0, 0] == pytest.approx(best_by_recursion(near, 12.0, price), abs=1e-5)


def test_at_a_high_price_no_move_costs_anything():
    near = np.ones((9, 16), np.uint8)
    value, speed = np.zeros(near.shape, np.float32), np.zeros(near.shape, np.int8)
    fill_speeds(near, np.zeros(16), 30.0, 2, METRE, 10.0, value, speed)
    assert value[0, 0] == pytest.approx(8 * METRE, abs=1e-5) and speed[0, 0] == 1


def test_speeds_pay_for_the_lane_however_fast_it_is_flown():
    # Three metres at a cost of 0.5 each step: two steps of 2 m end there if hurried, three of 1 m if not.
    near, along = np.zeros((9, 16), np.uint8), np.zeros(16)
    along[4:7] = 0.5
    value, speed = np.zeros(near.shape, np.float32), np.zeros(near.shape, np.int8)
    fill_speeds(near, along, 10.0, 2, METRE, 0.1, value, speed)
    # 0 -> 1 -> 3 -> 5 -> 7 -> 9 -> 10: one step ends in the narrows, where it costs 0.5.
    assert value[0, 0] == pytest.approx(10.0 * METRE - 0.1 * 0.5, abs=1e-5)
    fill_speeds(near, along, 10.0, 2, METRE, 10.0, value, speed)
    assert value[0, 0] == pytest.approx(3.0 * METRE, abs=1e-5)  # it waits before them


def planned(task: str, world, price: float, pose: tuple[float, ...]):
    """The plan of one flight from a pose."""
    from tests.env.task.priced.flights import made

    env = made(task, world, 1)
    env.reset(seed=0, options={"pose": np.array(pose)})
    oracle = Oracle(env.courses, env.config, price)
    plan, _ = oracle.plan(env.state)
    return plan, oracle


def test_a_fast_step_of_a_plug_in_is_planned_with_its_own_length(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(TASKS, "Swimmers", replace(TASKS["Swimmers"], fast_step_m=3.0))
    plan, oracle = planned("Swimmers", canal(width_m=8.0), 0.0, (1.0, 0.0, 2.0, 0.0))
    assert plan.speed_value[0, -5, 10] == pytest.approx(4 * 3.0 * oracle._step_worth)  # in the last four steps


def test_low_over_a_canal_without_reserves_every_metre_is_worth_its_share():
    world = canal(width_m=8.0)
    plan, oracle = planned("Nests", world, 0.0, (1.0, 0.0, 2.0, 0.0))
    index = round((2.0 - oracle.limits.min_height) / 0.5)
    left = plan.completed_m[0] - 10.0
    assert plan.climb_value[0, 10, index] == pytest.approx(10.0 / 60.0 * np.ceil(left), rel=0.02)


def test_reserves_are_climbed_over_at_a_high_price_only():
    world = canal(length_m=120.0, width_m=8.0)
    free, oracle = planned("Nests", world, 0.0, (1.0, 0.0, 2.0, 0.0))
    dear, _ = planned("Nests", world, 1.0, (1.0, 0.0, 2.0, 0.0))
    begin, end = oracle.courses.reserve[0]
    inside = int(0.5 * (begin + end))
    low, high = (round((height - oracle.limits.min_height) / 0.5) for height in (2.0, 9.0))
    assert free.climb_value[0, inside, low] > free.climb_value[0, inside, high]
    assert dear.climb_value[0, inside, low] < dear.climb_value[0, inside, high]


def test_ways_over_open_ground_are_as_long_as_the_straight_line():
    courses = pack_courses([canal(width_m=8.0)], EnvConfig(observation="none", task="Portage"))
    steps, _ = LandGrid(courses, 0).ways_to(55.0, 0.5, 0.0, 1.0, 10.0, 1)
    grid = LandGrid(courses, 0)
    column, row = np.round(np.array([10.0, 0.0]) - grid.origin).astype(int)
    # 16 directions are at most 2.8 % longer than the straight line; the goal is half a metre nearer.
    assert 44.4 <= steps[row, column] <= 45.5 * 1.028


def test_a_dear_way_stays_over_water_and_a_free_one_crosses_the_neck():
    courses = pack_courses([hairpin()], EnvConfig(observation="none", task="Portage"))
    grid = LandGrid(courses, 0)
    across = 45.7 + 15.0  # metres along the course of the place beside the start, on the other arm

    def way(price_steps: float) -> np.ndarray:
        _, onward = grid.ways_to(across, 1.5, price_steps, 1.0, 15.0, 1)
        column, row = np.round(courses.position[15] - grid.origin).astype(int)
        cells = [row * grid.ashore.shape[1] + column]
        while onward.ravel()[cells[-1]] != cells[-1]:
            cells.append(onward.ravel()[cells[-1]])
        return grid.ashore.ravel()[cells]

    assert way(0.0).sum() > 0
    assert way(1000.0).sum() == 0
    assert len(way(1000.0)) > 2 * len(way(0.0))


def test_a_way_over_water_leaves_the_cells_beside_the_bank():
    courses = pack_courses([canal(length_m=60.0, width_m=8.0)], EnvConfig(observation="none", task="Portage"))
    grid = LandGrid(courses, 0)
    beside = scipy.ndimage.binary_dilation(grid.ashore, np.ones((3, 3))) & (grid.ashore == 0)

    def way(price_steps: float) -> np.ndarray:
        _, onward = grid.ways_to(55.0, 1.5, price_steps, 1.0, 5.0, 1)
        column, row = np.round(np.array([5.0, 3.6]) - grid.origin).astype(int)
        cells = [row * grid.ashore.shape[1] + column]
        while onward.ravel()[cells[-1]] != cells[-1]:
            cells.append(onward.ravel()[cells[-1]])
        return beside.ravel()[cells]

    assert way(0.0).sum() > 40  # straight on along the bank
    assert way(1000.0).sum() < 4


@pytest.mark.parametrize(("travel", "ahead"), [(1, 0.6), (-1, 0.4)])
def test_a_way_over_water_does_not_turn_back_where_that_is_shorter(travel: int, ahead: float):
    """The station is six tenths of a loop ahead, so that four tenths would do against the direction of travel."""
    courses = pack_courses([ring()], EnvConfig(observation="none", task="Portage"))
    grid, length = LandGrid(courses, 0), float(courses.length[0])
    _, onward = grid.ways_to(ahead * length, 1.5, 1000.0, 1.0, 0.0, travel)
    column, row = np.round(courses.position[0] - grid.origin).astype(int)
    cells = [row * grid.ashore.shape[1] + column]
    while onward.ravel()[cells[-1]] != cells[-1]:
        cells.append(onward.ravel()[cells[-1]])
    gone = (travel * grid.arc.ravel()[cells]) % length
    assert grid.ashore.ravel()[cells].sum() == 0 and gone[-1] == pytest.approx(0.6 * length, abs=3.0)
    assert abs(gone[len(gone) // 2] - 0.3 * length) < 0.05 * length
