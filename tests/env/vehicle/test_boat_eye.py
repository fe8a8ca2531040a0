"""Tests of the ideal eye of a boat, by hand."""

import numpy as np
import pytest

from tests.env.vehicle.basins import arch_at, basin
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.task.priced.eye import features_of
from thalweg.env.vehicle.soundings import half_opening
from thalweg.world.bridges import Bridge
from thalweg.world.record import World

NAMES = features_of("River", "asv")


def seen(world: World, pose: list[float]) -> dict[str, float]:
    env = RiverVectorEnv([world], 1, EnvConfig(vehicle="asv", observation="privileged"))
    obs, _ = env.reset(seed=0, options={"pose": pose})
    return dict(zip(NAMES, obs[0].tolist(), strict=True))


def test_depths_are_told_below_the_keels_ahead_and_aside():
    found = seen(basin(lambda x, y: 0.8 + 0.01 * x + 0.05 * y), [20.0, 0.0, 0.0, 0.0])
    assert found["keel"] == pytest.approx(0.8 + 0.19 - 0.05 * 0.54 - 0.32, abs=1e-5)
    assert found["keel at 4 m, 1.5 m left"] == pytest.approx(0.8 + 0.24 + 0.075 - 0.32, abs=1e-5)
    assert found["keel at 7 m, -1.5 m left"] == pytest.approx(0.8 + 0.27 - 0.075 - 0.32, abs=1e-5)
    # Heading down the course the shallower side is to the left.
    back = seen(basin(lambda x, y: 0.8 + 0.01 * x + 0.05 * y), [20.0, 0.0, 0.0, np.pi])
    assert back["keel at 4 m, 1.5 m left"] == pytest.approx(0.8 + 0.16 - 0.075 - 0.32, abs=1e-5)


def test_depths_are_bounded():
    found = seen(basin(lambda x, y: np.full(x.shape, 9.0), width_m=8.0), [20.0, 3.0, 0.0, 0.0])
    assert found["keel at 2 m, -1.5 m left"] == 2.0
    assert found["keel at 2 m, 1.5 m left"] == pytest.approx(-0.82, abs=1e-5)


def test_the_nearest_rock_ahead_of_the_stern_is_told():
    world = basin(rocks=((26.0, 2.0, 0.5), (30.0, -1.0, 1.0), (18.0, 2.5, 0.5)))
    found = seen(world, [20.0, 0.0, 0.0, 0.0])
    assert found["rock"] == pytest.approx(np.hypot(6.0, 2.0) - 0.5, abs=1e-5)
    assert (found["rock ahead"], found["rock left"], found["rock radius"]) == pytest.approx((6.0, 2.0, 0.5), abs=1e-5)
    none = seen(world, [50.0, 0.0, 0.0, 0.0])
    assert (none["rock"], none["rock ahead"], none["rock left"], none["rock radius"]) == (16.0, 0.0, 0.0, 0.0)


def test_the_opening_of_the_next_arch_is_told():
    world = basin(bridges=arch_at(30.0, 10.0))
    opening = half_opening(Bridge(*world.bridges[0]), 0.75), half_opening(Bridge(*world.bridges[0]), 1.2) + 0.54
    found = seen(world, [20.0, 1.0, 0.0, 0.0])
    assert (found["arch ahead"], found["arch left"]) == pytest.approx((10.0, -1.0), abs=1e-5)
    assert found["arch half opening"] == pytest.approx(min(opening), abs=1e-5)
    behind = seen(world, [40.0, 0.0, 0.0, 0.0])
    assert (behind["arch ahead"], behind["arch half opening"]) == (0.0, 0.0)
