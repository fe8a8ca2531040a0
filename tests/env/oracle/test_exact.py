"""Flights of the oracle beside exact dynamic programming over the rules themselves, on small rivers.

The programme here shares no code with the oracle. It knows costs and rewards by `tests.env.task.priced.reference`, and
tries all moves whose places lie on a lattice: in a canal all that do not turn, on a hairpin those along both axes and
turns on the spot. What it finds can be flown, so that the oracle, which may also turn as it flies, must not be worse by
more than its tables are coarse.
"""

from collections.abc import Callable

import numpy as np
import pytest

from tests.env.handmade import canal, hairpin
from tests.env.oracle.test_oracle import flight
from tests.env.task.priced import reference
from tests.env.task.priced.flights import made
from thalweg.env import RiverVectorEnv
from thalweg.world import World

LENGTH, START = 60, 2.5
"""Metres of the canals, and of the starts in them."""
LAST = 57
"""Metres ahead of the start, rounded up, at which the last segment begins and the course is completed."""
METRE = 10.0 / LENGTH
"""Return of a segment of a metre. The segment of the start is paid with the first step."""
SLACK = 0.15
"""Return by which a flight may be worse than the exact optimum."""
PRICES = (0.0, 0.05, 0.3, 2.0)
SIDES = np.arange(-9, 10)
"""Places across a canal, half a metre apart."""

Cost = Callable[[int, int], np.ndarray]
"""Cost of a step by the number of steps after it and its metres forward, [X, J] by metres ahead and place."""


def optimum(steps: int, moves: list[tuple[int, int]], price: float, cost: Cost, open_: np.ndarray, paid: np.ndarray):
    """Most that can be had by so many steps from a start, [J] by its place across, or its height.

    moves: metres forward and places aside, or heights up, of a step. open_ [X, J]: whether a step may end there. paid
    [J]: share of a metre's worth that is paid to who is there.
    """
    value = np.zeros(open_.shape)
    ahead, places = np.arange(open_.shape[0]), np.arange(open_.shape[1])
    for step in range(steps, 0, -1):
        best = np.full(open_.shape, -np.inf)
        for forward, aside in moves:
            to, there = np.minimum(ahead + forward, LAST), places + aside
            inside = (there >= 0) & (there < len(places))
            at = np.ix_(to, np.clip(there, 0, len(places) - 1))
            gained = METRE * np.outer(to - ahead, paid[at[1][0]]) - price * cost(step, forward)[at] + value[at]
            best = np.maximum(best, np.where(open_[at] & inside, gained, -np.inf))
        value = best
        value[LAST] = 0.0
    return value[0] + METRE * paid


def places_of(y: float) -> int:
    """Number of a place across."""
    return int(np.flatnonzero(2 * y == SIDES)[0])


def worth(env: RiverVectorEnv, price: float, pose: tuple[float, ...]) -> np.ndarray:
    """Return less priced cost [N] of the oracle's flights from a pose."""
    returns, costs, _ = flight(env, price, pose)
    return returns - price * costs


@pytest.mark.parametrize("price", PRICES)
def test_flights_past_swimmers(price: float):
    world = canal(LENGTH, width_m=8.0)
    env = made("Swimmers", world, 3)
    found = worth(env, price, (START, 0.0, 7.0, 0.0))
    moves = [(forward, aside) for forward in range(3) for aside in (-1, 0, 1)]
    x = START + np.arange(LAST + 1)
    open_ = np.broadcast_to(np.abs(SIDES) <= 8, (LAST + 1, len(SIDES)))
    env.reset(seed=0, options={"pose": np.array((START, 0.0, 7.0, 0.0))})
    for row, scene in enumerate(env.state.scene):

        def near(step: int, forward: int, scene: int = int(scene)) -> np.ndarray:
            swum = reference.swimmers(world.river, env.courses.haunt, int(env.courses.swimmers[0]), scene, step)
            apart = np.hypot(x[:, None, None] - swum[:, 0], SIDES[:, None] / 2 - swum[:, 1])
            return (apart.min(axis=-1) <= 10.0) * float(forward == 2)

        exact = optimum(36, moves, price, near, open_, np.ones(len(SIDES)))
        assert found[row] >= exact[places_of(0.0)] - SLACK


@pytest.mark.parametrize("price", PRICES)
def test_racing_lines(price: float):
    width = np.full(LENGTH + 1, 9.0)
    width[20:26] = 4.0
    width[40:44] = 5.0
    world = canal(LENGTH, width_m=width)
    x = START + np.arange(LAST + 1)
    to_bank = np.array([[-reference.nearest(world.river, float(each), y / 2)[1] for y in SIDES] for each in x])
    costs = np.clip(1.0 - to_bank / 2.5, 0.0, 1.0)
    moves = [(forward, aside) for forward in range(3) for aside in (-1, 0, 1)]
    exact = optimum(27, moves, price, lambda step, forward: costs, to_bank >= 0.0, np.ones(len(SIDES)))
    for y in (0.0, 2.0):
        found = worth(made("RacingLine", world, 1), price, (START, y, 7.0, 0.0))
        assert found[0] >= exact[places_of(y)] - SLACK


@pytest.mark.parametrize("price", PRICES)
def test_flights_over_reserves(price: float):
    world = canal(LENGTH, width_m=8.0)
    env = made("Nests", world, 1)
    x, heights = START + np.arange(LAST + 1), np.arange(1.0, 15.0)
    reserved = ((env.courses.reserve[:, :1] <= x) & (x <= env.courses.reserve[:, 1:])).any(axis=0)
    costs = np.outer(reserved, heights < 8.0).astype(float)
    moves = [(forward, up) for forward in range(2) for up in (-1, 0, 1)]
    quality = np.minimum(1.0, (2.5 / heights) ** 2)
    exact = optimum(81, moves, price, lambda step, forward: costs, np.ones(costs.shape, bool), quality)
    for height in (2.0, 6.0):
        found = worth(made("Nests", world, 1), price, (START, 0.0, height, 0.0))
        assert found[0] >= exact[int(height) - 1] - SLACK


@pytest.mark.parametrize("price", [0.0, 0.1, 0.5, 5.0])
def test_portages(price: float):
    world, start = hairpin(), (10.0, 0.0, 7.0, 0.0)
    env = made("Portage", world, 1)
    env.reset(seed=0, options={"pose": np.array(start)})
    exact = exact_portage(world, float(env.state.station[0]), int(env.courses.max_steps[0]), price, start)
    # The oracle plans ways over land by cells of a metre, so that half a step over land more is to be expected.
    assert worth(env, price, start)[0] >= exact - SLACK - 0.5 * min(price, 1.0)


def exact_portage(world: World, station: float, steps: int, price: float, start: tuple[float, ...]) -> float:
    """Most that can be had by a portage from a start that looks along x, of so many steps.

    States are places half a metre apart and 36 headings; only from those along an axis a step leads forward and aside.
    """
    river = world.river
    x, y = np.arange(-8.0, 40.0, 0.5), np.arange(-5.0, 15.5, 0.5)
    left, land = np.empty((len(x), len(y))), np.empty((len(x), len(y)), bool)
    for i, px in enumerate(x):
        for j, py in enumerate(y):
            apart = abs(reference.nearest(river, float(px), float(py))[0] - station)
            left[i, j] = min(apart, river.length_m - apart)
            land[i, j] = reference.over_land(world, float(px), float(py))
    reached = (left <= 3.0) & ~land
    left[reached] = 0.0
    value = np.broadcast_to(-20.0 * left / river.length_m, (36, *left.shape)).copy()
    for _ in range(steps):
        best = np.full(value.shape, -np.inf)
        for turn in (-1, 0, 1):
            best = np.maximum(best, np.roll(value, -turn, axis=0) - price * land)
        for quarter, (ax, ay) in enumerate(((2, 0), (0, 2), (-2, 0), (0, -2))):
            for aside in (-1, 0, 1):
                dx, dy = ax - aside * ay // 2, ay + aside * ax // 2
                moved = np.pad(value[9 * quarter] - price * land, 2, constant_values=-np.inf)
                moved = moved[2 + dx : 2 + dx + len(x), 2 + dy : 2 + dy + len(y)]
                best[9 * quarter] = np.maximum(best[9 * quarter], moved)
        best[:, reached] = 0.0
        value = best
    i, j = int(np.flatnonzero(x == start[0])[0]), int(np.flatnonzero(y == start[1])[0])
    return float(value[0, i, j] + 20.0 * left[i, j] / river.length_m)
