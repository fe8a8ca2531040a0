"""What is true of a pose, on rivers where it can be worked by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.env.task.test_termination import bridge_at
from tests.render.plain import plane
from thalweg.env import sample_starts
from thalweg.env.config import DEFAULT_CONFIG
from thalweg.env.privileged_state import PRIVILEGED_NAMES, privileged_state
from thalweg.env.task.course_arrays import pack_courses
from thalweg.world import World


def one(world: World, *pose: float) -> dict[str, float]:
    return dict(zip(PRIVILEGED_NAMES, privileged_state(world, np.array([pose]))[0].tolist(), strict=True))


def test_on_a_straight_river_8_m_wide_they_are_those_worked_by_hand():
    found = one(plane(), 2.0, 1.5, 4.0, 0.3)
    assert found == pytest.approx(
        {"left bank": 2.5, "right bank": 5.5, "heading error": 0.3, "height": 4.0, "bridge": math.nan}, nan_ok=True
    )


def test_left_and_right_are_those_of_one_who_flies_the_other_way():
    found = one(plane(), 2.0, 1.5, 4.0, math.pi - 0.2)
    assert (found["left bank"], found["right bank"]) == pytest.approx((5.5, 2.5))
    assert found["heading error"] == pytest.approx(-0.2)


def test_a_bridge_counts_that_lies_ahead():
    world = replace(plane(), bridges=bridge_at(10.0))
    assert one(world, 2.0, 1.5, 4.0, 0.3)["bridge"] == pytest.approx(8.0)
    assert math.isnan(one(world, 2.0, 1.5, 4.0, math.pi)["bridge"])
    assert one(world, 15.0, 0.0, 4.0, math.pi)["bridge"] == pytest.approx(5.0)
    two = replace(plane(), bridges=np.vstack([bridge_at(10.0), bridge_at(-4.0)]))
    assert one(two, 2.0, 0.0, 4.0, math.pi)["bridge"] == pytest.approx(6.0)


def test_round_a_loop_with_one_bridge_there_and_back_are_the_whole_loop(
    medium_world: World, monkeypatch: pytest.MonkeyPatch
):
    one_bridge = replace(medium_world, bridges=medium_world.bridges[:1])
    length = medium_world.river.length_m
    starts = sample_starts(one_bridge, 100, 0)
    back = starts + np.array([0.0, 0.0, 0.0, math.pi])
    assert np.isnan(privileged_state(one_bridge, starts)[:, 4]).mean() > 0.5  # most are out of sight
    monkeypatch.setattr("thalweg.env.privileged_state.BRIDGE_RANGE_M", length)
    ways = np.stack([privileged_state(one_bridge, poses)[:, 4] for poses in (starts, back)])
    assert ways.sum(0) == pytest.approx(np.full(100, length), abs=0.5)


def test_at_every_start_they_agree_with_the_rules(medium_world: World):
    starts = sample_starts(medium_world, 200, 1)
    left, right, error, height, _ = privileged_state(medium_world, starts).T
    widths = pack_courses([medium_world], DEFAULT_CONFIG).width
    assert ((left + right >= widths.min() - 1e-9) & (left + right <= widths.max() + 1e-9)).all()
    assert (np.minimum(left, right) > DEFAULT_CONFIG.start_clearance_m - 0.3).all()
    assert (np.abs(error) <= math.radians(DEFAULT_CONFIG.start_heading_deg) + 1e-6).all()
    assert ((height >= DEFAULT_CONFIG.min_height_m) & (height <= DEFAULT_CONFIG.max_height_m)).all()
