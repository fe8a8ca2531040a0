"""The bird's eye map: straight canals, islands and turned vehicles have maps that can be worked out by hand."""

import math

import numpy as np
import pytest

from tests.env.flights import at
from tests.env.handmade import canal, ring
from tests.env.winding import river
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.initial_poses import UnsafePoseError, check_pose
from thalweg.env.task.bird_eye import BEHIND_M, CELL_M, COLUMNS, ROWS, open_water


def seen(world, pose) -> np.ndarray:
    env = at(world, pose)
    return open_water(env.courses, env.state)[0]


def test_a_straight_canal_is_a_band_of_columns():
    found = seen(canal(60.0, width_m=6.0), (20.0, 0.0, 4.0, 0.0))
    expected = np.zeros((ROWS, COLUMNS), np.uint8)
    expected[:, 5:11] = 1  # centres 2.5, 1.5, ... -2.5 metres to the left
    assert np.array_equal(found, expected)


def test_a_vehicle_to_the_left_sees_the_canal_to_its_right():
    found = seen(canal(60.0, width_m=6.0), (20.0, 2.0, 4.0, 0.0))
    assert np.flatnonzero(found[0]).tolist() == [7, 8, 9, 10, 11, 12]


def test_a_turned_vehicle_sees_the_bank_ahead():
    """Heading to the left bank, 3 m away, along the y axis: rows up to there are open, in all columns."""
    found = seen(canal(60.0, width_m=6.0), (20.0, 0.0, 4.0, math.radians(89.9)))
    centres = (np.arange(ROWS) + 0.5) * CELL_M - BEHIND_M
    assert np.array_equal(found.min(axis=1), (centres < 3.0).astype(np.uint8))
    assert np.array_equal(found.max(axis=1), found.min(axis=1))


def test_an_island_ahead_is_closed():
    found = seen(canal(60.0, width_m=10.0, islands=[[28.0, 0.0, 2.0, 1.2, 0.0]]), (20.0, 0.0, 4.0, 0.0))
    rows, columns = np.nonzero(found[:, 4:12] == 0)
    ahead = (rows + 0.5) * CELL_M - BEHIND_M
    assert ahead.min() == 6.5 and ahead.max() == 9.5
    assert set(columns + 4) == {7, 8}


@pytest.mark.parametrize("level", ["Easy", "Medium", "Hard"])
def test_open_cells_are_those_where_a_pose_is_allowed(level: str):
    """Against the check of initial poses, near the vehicle, where no other arm of the river can be meant."""
    env = RiverVectorEnv([river(level, 1)], 4, EnvConfig(observation="none"))
    env.reset(seed=0)
    maps = open_water(env.courses, env.state)
    for pose, found in zip(env.state.pose, maps, strict=True):
        for row in range(8):
            for column in range(4, 12):
                ahead, left = (row + 0.5) * CELL_M - BEHIND_M, (0.5 * COLUMNS - column - 0.5) * CELL_M
                x = pose[0] + ahead * math.cos(pose[3]) - left * math.sin(pose[3])
                y = pose[1] + ahead * math.sin(pose[3]) + left * math.cos(pose[3])
                assert bool(found[row, column]) == allowed(env, x, y)


def allowed(env: RiverVectorEnv, x: float, y: float) -> bool:
    """Whether the check of poses finds no land at x, y."""
    try:
        check_pose(env.courses, 0, env.config, np.array([x, y, 1000.0, 0.0]))
    except UnsafePoseError as error:
        return "bank" not in str(error) and "island" not in str(error)
    return True


def test_a_ring_bends_to_the_left():
    found = seen(ring(radius_m=20.0, count=96, width_m=6.0), (20.0, 0.0, 4.0, math.radians(90.0)))
    middle = [np.flatnonzero(row).mean() for row in found]
    assert middle[-1] < middle[2] - 3.0
