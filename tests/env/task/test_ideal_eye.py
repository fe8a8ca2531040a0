"""Tests of what the ideal eye sees, against numbers worked by hand and against the maps by independent methods."""

import math

import numpy as np
import pytest

from tests.env.handmade import canal
from tests.env.task.test_termination import bridge_at
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.env import RiverEnv
from thalweg.env.privileged_state import privileged_state
from thalweg.env.task.course_arrays import nearest_arcs, pack_courses
from thalweg.env.task.ideal_eye import BEHIND_M, FEATURES, POINTS_M, RANGE_M, point_ahead, see_all
from thalweg.env.task.progress import Projection
from thalweg.world import World

CONFIG = EnvConfig(observation="privileged")


def seen(world: World, pose: tuple[float, float, float, float], travel: int = 1) -> dict[str, float]:
    """What is seen from a pose."""
    courses = pack_courses([world], CONFIG)
    out = np.full((1, len(FEATURES)), np.nan, np.float32)
    segment = int(np.linalg.norm(world.river.position_m - pose[:2], axis=1).argmin()) % world.river.segments
    arrays = np.zeros(1, np.int64), np.array([pose]), np.array([segment]), np.array([travel])
    see_all(courses, CONFIG.max_height_m, *arrays, out)
    return dict(zip(FEATURES, out[0].tolist(), strict=True))


def points(values: dict[str, float], name: str) -> list[float]:
    return [values[f"{name} at {metres:g} m"] for metres in POINTS_M]


def test_in_a_straight_canal_they_are_those_worked_by_hand():
    found = seen(canal(60.0, width_m=8.0), (20.0, 1.5, 4.0, 0.3))
    assert found["heading error"] == pytest.approx(0.3)
    assert (found["left bank"], found["right bank"]) == pytest.approx((2.5, 5.5))
    assert (found["height"], found["room above"]) == pytest.approx((4.0, 11.0))
    cos, sin = math.cos(0.3), math.sin(0.3)
    # From (20, 1.5) a point of the line at d lies at (d, -1.5).
    assert points(found, "ahead") == pytest.approx([d * cos - 1.5 * sin for d in POINTS_M], abs=1e-5)
    assert points(found, "left") == pytest.approx([-1.5 * cos - d * sin for d in POINTS_M], abs=1e-5)
    assert points(found, "half width") == pytest.approx([4.0] * 6)
    assert points(found, "level") == pytest.approx([0.0] * 6)
    assert found["bridge"] == found["island"] == RANGE_M
    assert not any(found[name] for name in FEATURES if name.startswith(("bridge ", "island ")))


def test_who_flies_the_other_way_sees_the_course_the_other_way():
    found = seen(canal(60.0, width_m=8.0), (20.0, 1.5, 4.0, math.pi - 0.2), travel=-1)
    assert (found["left bank"], found["right bank"]) == pytest.approx((5.5, 2.5))
    assert found["heading error"] == pytest.approx(-0.2)
    # The line ends at x = 0, 20 m away: the last point is its end.
    yaw = math.pi - 0.2
    expected = [-d * math.cos(yaw) - 1.5 * math.sin(yaw) for d in (*POINTS_M[:-1], 20.0)]
    assert points(found, "ahead") == pytest.approx(expected, abs=1e-5)


def test_widths_and_levels_are_those_of_the_points():
    x = np.linspace(0.0, 60.0, 61)
    world = canal(60.0, spacing_m=1.0, width_m=6.0 + 0.1 * x, level_m=np.where(x < 30.0, 3.0, 0.0))
    found = seen(world, (20.5, 0.0, 5.0, 0.0))
    assert found["height"] == pytest.approx(2.0)
    assert points(found, "half width") == pytest.approx([3.0 + 0.05 * (20.5 + d) for d in POINTS_M], abs=1e-5)
    assert points(found, "level") == pytest.approx([0.0, 0.0, 0.0, -3.0, -3.0, -3.0])


def test_the_next_bridge_counts_until_it_is_behind():
    world = canal(60.0, width_m=8.0, bridges=np.vstack([bridge_at(30.0, 8.0), bridge_at(48.0, 8.0)]))
    box = pack_courses([world], CONFIG).bridge_box
    found = seen(world, (20.0, 0.0, 4.0, 0.0))
    assert found["bridge"] == pytest.approx(10.0, abs=1e-4)
    assert found["bridge underside"] == pytest.approx(box[0, 2] - 4.0, abs=1e-5)
    assert found["bridge top"] == pytest.approx(box[0, 5] - 4.0, abs=1e-5)
    assert found["bridge top"] > found["bridge underside"]
    assert seen(world, (30.0 + BEHIND_M - 0.1, 0.0, 4.0, 0.0))["bridge"] == pytest.approx(-BEHIND_M + 0.1, abs=1e-4)
    assert seen(world, (30.0 + BEHIND_M + 0.1, 0.0, 4.0, 0.0))["bridge"] == pytest.approx(14.9, abs=1e-4)
    assert seen(world, (40.0, 0.0, 4.0, math.pi), travel=-1)["bridge"] == pytest.approx(10.0, abs=1e-4)
    assert seen(world, (56.0, 0.0, 4.0, 0.0))["bridge"] == RANGE_M


def test_the_next_island_has_its_place_and_size():
    world = canal(90.0, width_m=12.0, islands=[[30.0, 1.0, 4.0, 1.5, 0.0], [49.0, 0.0, 2.0, 1.0, 0.5]])
    found = seen(world, (20.0, -1.0, 4.0, 0.0))
    assert found["island"] == pytest.approx(10.0)
    assert (found["island ahead"], found["island left"]) == pytest.approx((10.0, 2.0))
    assert (found["island half length"], found["island half width"]) == pytest.approx((4.0, 1.5))
    assert seen(world, (33.9, -1.0, 4.0, 0.0))["island"] == pytest.approx(-3.9, abs=1e-5)
    beyond = seen(world, (34.1, -1.0, 4.0, 0.0))
    assert beyond["island"] == pytest.approx(14.9, abs=1e-4)
    assert (beyond["island half length"], beyond["island half width"]) == pytest.approx((2.0, 1.0))


def test_round_a_river_they_are_those_of_other_methods(medium_world: World):
    """Heights, banks and points ahead are those of a course whose samples are interpolated by the arc length."""
    env = RiverVectorEnv([medium_world], 32, CONFIG)
    observations, info = env.reset(seed=3)
    river = medium_world.river
    arc = np.append(river.arc_m, river.length_m)
    line = np.vstack([river.position_m, river.position_m[:1]])
    for _ in range(12):
        poses = info["pose"]
        here = nearest_arcs(river, poses[:, :2])
        across = poses[:, :2] - np.stack([np.interp(here, arc, line[:, axis]) for axis in (0, 1)], axis=1)
        further = (here + 0.01 * env.state.travel) % river.length_m
        along = np.stack([np.interp(further, arc, line[:, axis]) for axis in (0, 1)], axis=1) - (poses[:, :2] - across)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        left = along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]
        half_width, level = (
            np.interp(here, arc, np.append(values, values[0])) for values in (0.5 * river.width_m, river.level_m)
        )
        np.testing.assert_allclose(observations[:, 1], half_width - left, atol=0.02)
        np.testing.assert_allclose(observations[:, 2], half_width + left, atol=0.02)
        np.testing.assert_allclose(observations[:, 3], poses[:, 2] - level, atol=0.01)
        course = np.arctan2(along[:, 1], along[:, 0])
        apart = np.angle(np.exp(1j * (observations[:, 0] - poses[:, 3] + course)))
        np.testing.assert_allclose(apart, 0.0, atol=0.1)  # the course is smoother than its samples
        for k, metres in enumerate(POINTS_M):
            at = (here + env.state.travel * metres) % river.length_m
            offset = np.stack([np.interp(at, arc, line[:, axis]) for axis in (0, 1)], axis=1) - poses[:, :2]
            cos, sin = np.cos(poses[:, 3]), np.sin(poses[:, 3])
            ahead = offset[:, 0] * cos + offset[:, 1] * sin
            left = offset[:, 1] * cos - offset[:, 0] * sin
            np.testing.assert_allclose(observations[:, 5 + 4 * k : 7 + 4 * k], np.stack([ahead, left], 1), atol=0.02)
        actions = env.pilot_actions()
        observations, _, _, _, info = env.step(actions)


def test_single_environments_see_the_same_and_nothing_is_drawn(medium_world: World, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("thalweg.render.Renderer.__init__", None)
    vector = RiverVectorEnv([medium_world], 2, CONFIG)
    single = RiverEnv(medium_world, CONFIG)
    both, _ = vector.reset(seed=5)
    one, _ = single.reset(seed=5)
    np.testing.assert_array_equal(both[0], one)
    assert one in single.observation_space and one.dtype == np.float32
    action = single.action_space.sample()
    np.testing.assert_array_equal(vector.step(np.stack([action, action]))[0][0], single.step(action)[0])


def test_the_last_observation_of_an_episode_is_its_own(medium_world: World):
    env = RiverVectorEnv([medium_world], 4, CONFIG.with_options(max_steps=3))
    env.reset(seed=1)
    for _ in range(2):
        env.step(env.pilot_actions())
    observations, _, _, truncated, info = env.step(env.pilot_actions())
    assert truncated.all()
    poses = info["final_info"]["pose"]
    for row in range(4):
        last = info["final_obs"][row]
        assert last[3] != observations[row, 3] or last[1] != observations[row, 1]
        assert last[3] == pytest.approx(privileged_state(medium_world, poses[row : row + 1])[0, 3], abs=1e-5)


def test_the_search_ahead_of_nan_ends_where_it_begins():
    # On a loop, where no course ends, it would go on for ever.
    courses = pack_courses([canal(60.0)], CONFIG)
    assert point_ahead(courses, 0, Projection(3, math.nan, 0.0), 1, 2.0).segment == 3
