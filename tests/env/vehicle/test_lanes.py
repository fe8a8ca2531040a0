"""Lanes by hand, and rivers that the boat does not fit, refused by name and reach."""

import numpy as np
import pytest

from tests.env.handmade import canal
from tests.env.vehicle.basins import arch_at, basin
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.rivers.bare_river import load_or_plan
from thalweg.env.task.course_arrays import pack_courses
from thalweg.env.vehicle.boat import Boat, FitError
from thalweg.env.vehicle.lanes import wide_enough
from thalweg.env.vehicle.soundings import LANE_POINTS
from thalweg.world import LEVELS

CONFIG = EnvConfig(vehicle="asv", observation="none")


def test_the_lane_of_a_flat_basin_leaves_half_a_beam_to_either_bank():
    through = pack_courses([basin(width_m=10.0)], CONFIG).through
    # The bank is a step in the map between the nodes at 5 and 5.25 m, where the depth falls from 1.5 to -0.5 m; with
    # 0.42 m it is 0.135 m beyond the bank. A point across is 10 / 64 m.
    free = np.abs(np.linspace(-5.0, 5.0, LANE_POINTS)) + 0.54 <= 5.0 + 0.25 * (1.5 - 0.42) / 2.0
    assert (through[5:-5] == free).all()


def test_points_behind_a_bar_lead_nowhere_up_the_course_and_on_down_it():
    # A shoal from the left bank to the middle, from x = 30 on: whoever is far left before it must move aside in time.
    world = basin(lambda x, y: np.where((x > 30.0) & (x < 34.0) & (y > -1.0), 0.1, 1.5))
    through = pack_courses([world], CONFIG).through
    offset = np.linspace(-5.0, 5.0, LANE_POINTS)
    before = through[28, 0].astype(bool)
    assert before[offset < -1.6].any() and not before[offset > 0.0].any()
    # From further away there is room to move aside: 0.4 m for each metre.
    assert through[20, 0].astype(bool)[(offset > 0.0) & (offset < 1.5)].all()
    assert through[28, 1].astype(bool)[(offset > 0.0) & (offset < 4.0)].all()


def test_a_lane_narrower_than_a_step_aside_is_none():
    free = np.array([[1, 1, 0, 1, 1, 1, 0, 1], [0, 0, 1, 0, 1, 1, 1, 1]])
    # Points 0.25 m apart in the first row and 0.5 m in the second.
    kept = wide_enough(free, np.array([1.75, 3.5]), 0.5)
    assert kept.tolist() == [[0, 0, 0, 1, 1, 1, 0, 0], [0, 0, 0, 0, 1, 1, 1, 1]]


def refused(world, config: EnvConfig = CONFIG) -> str:
    with pytest.raises(FitError) as error:
        RiverVectorEnv([world], 1, config)
    return str(error.value)


def test_a_river_that_is_too_shallow_is_refused_with_the_reach():
    message = refused(basin(lambda x, y: np.where(np.abs(x - 40.0) < 3.0, 0.2, 1.5)))
    assert message.startswith("the boat (2 m by 1.08 m, draught 0.32 m) does not fit handmade-0: at arc 3")
    assert "10.0 m wide" in message and "at most 0.200 m of water under all of the hull" in message


def test_a_river_that_is_too_narrow_is_refused():
    assert "does not fit" in refused(basin(width_m=2.0, length_m=30.0), EnvConfig(vehicle="asv", boat=Boat(beam_m=2.6)))


def test_a_river_whose_lane_is_narrower_than_a_step_aside_is_refused():
    gap = basin(lambda x, y: np.where((np.abs(x - 30.0) < 3.0) & (np.abs(y) > 0.7), 0.2, 1.5))
    assert "the lane that is deep and free enough is narrower than a step aside" in refused(gap)


def test_a_bridge_that_leaves_no_passage_is_refused():
    world = basin(width_m=4.0, bridges=arch_at(30.0, 4.0))
    tall = EnvConfig(vehicle="asv", observation="none", boat=Boat(camera_height_m=1.9))
    message = refused(world, tall)
    assert "bridges and rocks leave no passage" in message and "at arc 2" in message
    RiverVectorEnv([world], 1, CONFIG)  # the usual boat passes below it


def test_lanes_that_do_not_meet_are_refused():
    walls = basin(lambda x, y: np.where(((x > 20) & (x < 25) & (y > -2)) | ((x > 26) & (x < 31) & (y < 2)), 0.1, 1.5))
    assert "no way through" in refused(walls)


def test_a_river_without_land_is_refused():
    assert "the bed of handmade-0 is unknown" in refused(canal())
    assert "the bed of Easy-5 is unknown" in refused(load_or_plan(LEVELS["Easy"], 5))


def test_where_the_margin_cannot_be_kept_lanes_are_those_that_float():
    shallow = basin(lambda x, y: np.full(x.shape, 0.36))
    through = pack_courses([shallow], CONFIG).through
    assert through[30, 0].sum() > LANE_POINTS // 2
