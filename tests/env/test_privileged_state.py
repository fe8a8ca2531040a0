"""Tests of what is true of a pose without an episode, on rivers where it can be worked by hand."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from tests.env.task.test_termination import bridge_at
from tests.render.plain import plane
from thalweg.env import EnvConfig, RiverVectorEnv, sample_starts
from thalweg.env.config import DEFAULT_CONFIG
from thalweg.env.initial_poses import UnsafePoseError
from thalweg.env.privileged_state import privileged_state
from thalweg.env.task.course_arrays import pack_courses
from thalweg.env.task.ideal_eye import FEATURES, RANGE_M
from thalweg.world import World

NAMES = ("left bank", "right bank", "heading error", "height", "bridge")


def one(world: World, *pose: float) -> dict[str, float]:
    seen = dict(zip(FEATURES, privileged_state(world, np.array([pose]))[0].tolist(), strict=True))
    return {name: seen[name] for name in NAMES}


def test_on_a_straight_river_8_m_wide_they_are_those_worked_by_hand():
    found = one(plane(), 2.0, 1.5, 4.0, 0.3)
    assert found == pytest.approx(
        {"left bank": 2.5, "right bank": 5.5, "heading error": 0.3, "height": 4.0, "bridge": RANGE_M}, abs=1e-5
    )


def test_left_and_right_are_those_of_one_who_flies_the_other_way():
    found = one(plane(), 2.0, 1.5, 4.0, math.pi - 0.2)
    assert (found["left bank"], found["right bank"]) == pytest.approx((5.5, 2.5))
    assert found["heading error"] == pytest.approx(-0.2)


def test_a_bridge_counts_that_lies_ahead():
    world = replace(plane(), bridges=bridge_at(10.0))
    assert one(world, 2.0, 1.5, 4.0, 0.3)["bridge"] == pytest.approx(8.0)
    assert one(world, 2.0, 1.5, 4.0, math.pi)["bridge"] == RANGE_M
    assert one(world, 15.0, 0.0, 4.0, math.pi)["bridge"] == pytest.approx(5.0)
    two = replace(plane(), bridges=np.vstack([bridge_at(10.0), bridge_at(-4.0)]))
    assert one(two, 2.0, 0.0, 4.0, math.pi)["bridge"] == pytest.approx(6.0)


def test_at_a_start_they_are_those_of_the_episode(medium_world: World):
    env = RiverVectorEnv([medium_world], 32, EnvConfig(observation="privileged"))
    seen, info = env.reset(seed=2)
    np.testing.assert_array_equal(privileged_state(medium_world, info["pose"]), seen)


def test_at_every_start_they_agree_with_the_rules(medium_world: World):
    starts = sample_starts(medium_world, 200, 1)
    error, left, right, height = privileged_state(medium_world, starts)[:, :4].T
    widths = pack_courses([medium_world], DEFAULT_CONFIG).width
    assert ((left + right >= widths.min() - 1e-4) & (left + right <= widths.max() + 1e-4)).all()
    assert (np.minimum(left, right) > DEFAULT_CONFIG.start_clearance_m - 0.3).all()
    assert (np.abs(error) <= math.radians(DEFAULT_CONFIG.start_heading_deg) + 1e-6).all()
    assert ((height >= DEFAULT_CONFIG.min_height_m - 1e-5) & (height <= DEFAULT_CONFIG.max_height_m + 1e-5)).all()


def test_a_pose_that_is_not_finite_is_refused_by_its_row():
    poses = np.array([[2.0, 1.5, 4.0, 0.3], [2.0, 1.5, math.nan, 0.3]])
    with pytest.raises(
        UnsafePoseError, match=r"four finite numbers x, y, z, yaw, not \[2.0, 1.5, nan, 0.3\] \(row 1\)"
    ):
        privileged_state(plane(), poses)


@pytest.mark.parametrize("poses", [[[2.0, 1.5, 4.0]], [[2.0, 1.5, 4.0, 0.3, 0.0]], [2.0, 1.5, 4.0, 0.3]], ids=str)
def test_poses_of_another_shape_are_refused(poses: list):
    with pytest.raises(UnsafePoseError, match=re.escape(f"poses must be [K, 4], not {list(np.shape(poses))}")):
        privileged_state(plane(), np.array(poses))
