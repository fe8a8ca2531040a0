"""Tests of the poses at which episodes start: random ones and given ones."""

import math
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
import torch

from tests.env.handmade import canal, ring
from tests.env.winding import river
from thalweg.env import ConfigError, EnvConfig, RiverEnv, RiverVectorEnv, UnsafePoseError, sample_starts
from thalweg.env.initial_poses import CLOCK_RANGE_S, begin_at_pose, check_pose
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.task.course_arrays import pack_courses
from thalweg.env.task.termination import first_bridge_hit, island_at
from thalweg.env.torch_env import TensorRiverEnv
from thalweg.world.bridges import bridge_across

BRIDGE = bridge_across(np.array([20.0, 0.0]), np.array([1.0, 0.0]), 6.0, 0.0, np.random.default_rng(1))[None]
START_OF_SEED_3 = (18.5228022981009, 11.05646493813216, 12.118479745492754, 2.338381115528124)
"""Of a ring of radius 20 m; known from the first version."""


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        ((10.0, 0.0, 16.7, 0.0), r"height 16.2 m is above max_height_m = 15"),
        ((10.0, 0.0, 0.9, 0.0), r"height 0.4 m is below min_height_m = 0.5"),
        ((10.0, -4.25, 5.0, 0.0), r"4.25 m from the centre line, 1.25 m beyond the bank"),
        ((40.0, 0.5, 5.0, 0.0), r"lies on island 0"),
        ((20.0, 0.0, 1.0, 0.0), r"touches the collision hull of bridge 0"),
        ((10.0, 0.0, math.nan, 0.0), r"four finite numbers"),
    ],
)
def test_an_unsafe_pose_says_which_limit_it_breaks(pose, message):
    env = RiverVectorEnv(
        canal(bridges=BRIDGE, islands=[[40.0, 0.0, 2.0, 1.0, 0.0]], level_m=0.5), 2, EnvConfig(observation="none")
    )
    env.reset(seed=1)
    before = env.get_state()
    with pytest.raises(UnsafePoseError, match=message):
        env.reset(seed=5, options={"pose": np.array(pose)})
    assert all(np.array_equal(value, before[key]) for key, value in env.get_state().items())


def test_one_environment_draws_nothing_for_an_unsafe_pose_either():
    env = RiverEnv(canal(), EnvConfig(observation="none"))
    env.reset(seed=1)
    before = env.get_state()
    with pytest.raises(UnsafePoseError, match="above max_height_m"):
        env.reset(seed=5, options={"pose": np.array([10.0, 0.0, 16.7, 0.0])})
    assert all(np.array_equal(value, before[key]) for key, value in env.get_state().items())
    assert env.np_random is env.vector.generators[0]
    assert env.np_random_seed == 1


@pytest.mark.parametrize("seed", [-1, [3, -1], [3, 1.5], 1.5, "1"])
def test_a_bad_seed_changes_nothing(seed):
    env = RiverVectorEnv(canal(), 2, EnvConfig(observation="none"))
    env.reset(seed=1)
    before = env.get_state()
    with pytest.raises((ConfigError, gymnasium.error.Error), match=r"seed"):
        env.reset(seed=seed)
    assert all(np.array_equal(value, before[key]) for key, value in env.get_state().items())
    assert env.np_random_seed == 1


def test_a_safe_pose_is_flown_from_where_no_random_start_is_found():
    env = RiverVectorEnv(canal(width_m=0.8), 1, EnvConfig(observation="none"))
    with pytest.raises(UnsafePoseError, match="no safe start found"):
        env.reset(seed=0)
    observations, _ = env.reset(seed=0, options={"pose": [10.0, 0.0, 5.0, 0.0]})
    assert observations[0].tolist() == [10.0, 0.0, 5.0, 0.0]


def test_a_pose_leaves_only_the_clock_to_chance():
    env = RiverVectorEnv(canal(), 1, EnvConfig(observation="none"))
    env.reset(seed=8, options={"pose": [10.0, 0.0, 5.0, 0.0]})
    generator = np.random.default_rng(8)
    assert env.state.time_s[0] == CLOCK_RANGE_S * generator.random()
    assert env.generators[0] is not None
    assert env.generators[0].bit_generator.state == generator.bit_generator.state


def test_random_starts_are_those_that_policies_were_trained_from():
    observations, _ = RiverVectorEnv(ring(), 1, EnvConfig(observation="none")).reset(seed=3)
    assert observations[0] == pytest.approx(START_OF_SEED_3, abs=1e-12)


def test_a_heading_off_the_course_is_unsafe_where_the_limit_is_narrow():
    env = RiverVectorEnv(canal(), 1, EnvConfig(observation="none", max_yaw_deviation_deg=60.0, start_heading_deg=60.0))
    with pytest.raises(UnsafePoseError, match=r"heading 70 degrees off the course is above max_yaw_deviation_deg = 60"):
        env.reset(options={"pose": [10.0, 0.0, 5.0, math.radians(110.0)]})


@pytest.mark.parametrize("pose", [[1.0, 2.0, 3.0], np.zeros((3, 4))])
def test_a_pose_of_the_wrong_shape_is_refused(pose):
    with pytest.raises(ConfigError, match=r"needed: \(4,\) or \(2, 4\)"):
        RiverVectorEnv(canal(), 2, EnvConfig(observation="none")).reset(options={"pose": pose})


def test_each_environment_begins_at_its_own_pose():
    poses = np.array([[10.0, 0.0, 5.0, 0.0], [12.0, 1.0, 6.0, 3.0]])
    env = RiverVectorEnv(canal(), 2, EnvConfig(observation="none"))
    observations, info = env.reset(options={"pose": poses})
    assert np.array_equal(observations, poses)
    assert np.array_equal(info["pose"], poses)
    assert env.state.travel.tolist() == [1, -1]


def test_random_starts_are_safe_with_clearance_and_spread_over_everything():
    world = river("Hard", 1)
    config = EnvConfig()
    courses = pack_courses([world], config)
    starts = sample_starts(world, 1000, seed=0)
    for pose in starts:
        check_pose(courses, 0, config, pose)
        for angle in np.arange(0.0, 2 * math.pi, math.pi / 4):
            assert island_at(courses, 0, pose[0] + 0.5 * math.cos(angle), pose[1] + 0.5 * math.sin(angle)) < 0
    nearest = np.linalg.norm(starts[:, None, :2] - world.river.position_m[None], axis=2).argmin(axis=1)
    heights = starts[:, 2] - world.river.level_m[nearest]
    tangent = world.river.tangent[nearest]
    off = np.degrees(
        np.arccos(
            np.clip(
                np.abs(np.sum(tangent * np.column_stack([np.cos(starts[:, 3]), np.sin(starts[:, 3])]), axis=1)), 0, 1
            )
        )
    )
    along = np.sum(tangent * np.column_stack([np.cos(starts[:, 3]), np.sin(starts[:, 3])]), axis=1) > 0
    assert len(np.unique(nearest // 8)) == 41
    assert heights.min() < 1.0
    assert heights.max() > 14.5
    assert 75.0 < off.max() < 90.0
    assert 400 < along.sum() < 600


def at_station(pose: np.ndarray) -> bool:
    """Whether a pose in a canal of 60 m lies within 3 m of the station, 2 m before the end that it heads for."""
    ahead = pose[0] if math.cos(pose[3]) < 0.0 else 60.0 - pose[0]
    return ahead <= 5.0


def test_a_start_in_an_open_course_lies_before_the_station_and_is_else_that_of_other_tasks():
    starts = {task: sample_starts(canal(), 400, seed=0, config=EnvConfig(task=task)) for task in ("River", "Portage")}
    moved = np.array([at_station(pose) for pose in starts["River"]])
    assert 10 < moved.sum() < 60 and not any(at_station(pose) for pose in starts["Portage"])
    assert np.array_equal(starts["River"][~moved], starts["Portage"][~moved])


@pytest.mark.parametrize("world", [ring(), river("Easy", 0)], ids=["ring", "Easy"])
def test_starts_in_a_loop_are_those_of_other_tasks(world):
    ours, theirs = (sample_starts(world, 200, seed=0, config=EnvConfig(task=task)) for task in ("Portage", "River"))
    assert np.array_equal(ours, theirs)


def test_no_episode_of_portage_in_an_open_course_ends_in_a_step_that_stays():
    env = RiverVectorEnv(canal(), 200, EnvConfig(observation="none", task="Portage"))
    env.reset(seed=0)
    assert not env.step(np.ones((200, 4), np.int64))[2].any()
    tensors = TensorRiverEnv(canal(), 200, EnvConfig(observation="none", task="Portage"), device="cpu")
    tensors.reset(seed=0)
    assert not tensors.step(torch.ones(200, 4, dtype=torch.int64))[2].any()


@pytest.mark.parametrize(
    ("task", "pose", "message"),
    [
        ("River", (59.5, 0.0, 5.0, 0.0), "lies in the last segment of the course in the direction of travel"),
        ("River", (0.5, 0.0, 5.0, math.pi), "lies in the last segment of the course in the direction of travel"),
        ("Portage", (55.5, 0.0, 5.0, 0.0), "lies within 3 m of the station"),
        ("Portage", (4.5, 0.0, 5.0, math.pi), "lies within 3 m of the station"),
    ],
)
def test_a_pose_at_the_goal_is_refused_and_one_before_it_or_away_from_it_is_none(task, pose, message):
    env = RiverVectorEnv(canal(), 1, EnvConfig(observation="none", task=task))
    with pytest.raises(UnsafePoseError, match=rf"\({pose[0]:.2f}, 0.00\) {message}, which is the goal"):
        env.reset(options={"pose": pose})
    before = pose[0] + (1.0 if pose[3] else -1.0)
    for safe in ((before, *pose[1:]), (*pose[:3], math.pi - pose[3])):
        env.reset(seed=0, options={"pose": safe})
        assert not env.step(np.ones((1, 4), np.int64))[2].any()


def test_a_start_depends_on_the_seed_and_its_number_alone():
    world = ring()
    assert np.array_equal(sample_starts(world, 3, seed=7), sample_starts(world, 10, seed=7)[:3])
    assert not np.array_equal(sample_starts(world, 3, seed=7), sample_starts(world, 3, seed=8))
    assert sample_starts(world, 0, seed=7).shape == (0, 4)


def test_a_course_without_a_safe_start_is_an_error():
    with pytest.raises(UnsafePoseError, match="no safe start") as raised:
        sample_starts(ring(width_m=0.9), 1, seed=0)
    for words in ("found in handmade-0 among", "start_clearance_m = 0.5", "start_heading_deg = 80", "0.5 to 15 m"):
        assert words in str(raised.value)


def test_the_river_without_a_safe_start_is_named_where_episodes_change_it():
    env = RiverVectorEnv(
        RiverList([canal(), replace(ring(width_m=0.9), name="narrow")]), 1, EnvConfig(observation="none")
    )
    with pytest.raises(UnsafePoseError, match="no safe start found in narrow-0 among"):
        for seed in range(20):
            env.reset(seed=seed)
    env.close()


def test_an_open_course_never_starts_at_its_goal():
    for x, _, _, yaw in sample_starts(canal(4.0), 200, seed=0):
        assert (x < 3.0) if math.cos(yaw) > 0 else (x > 1.0)


def test_an_unknown_reset_option_lists_the_known_ones():
    with pytest.raises(ConfigError, match=r"'poes' \(did you mean 'pose'\?\); known: pose, reset_mask"):
        RiverVectorEnv(canal(), 1, EnvConfig(observation="none")).reset(options={"poes": [0, 0, 0, 0]})


def test_an_episode_begins_without_anything_of_the_last_one_or_of_a_longer_river():
    env = RiverVectorEnv([canal(), ring()], 2, EnvConfig(observation="none"))
    env.reset(seed=1)
    state = env.state
    state.visited[:], state.visited_count[:], state.steps[:], state.idle[:] = 1, 9, 9, 9
    begin_at_pose(0, env.courses, env.config.limits, state, 0)
    assert not state.visited[0].any() and state.visited[1].all()
    for kept in (state.visited_count, state.steps, state.idle):
        assert kept.tolist() == [0, 9]


def test_random_starts_keep_their_clearance_from_banks_islands_and_bridges():
    world = canal(40.0, width_m=6.0, bridges=BRIDGE, islands=[[8.0, 0.0, 3.0, 1.0, 0.3]])
    courses = pack_courses([world], EnvConfig())
    for x, y, z, _ in sample_starts(world, 600, seed=0):
        assert abs(y) <= 2.5
        assert first_bridge_hit(courses, 0, x, y, z - 0.5, x, y, z + 0.5) < 0
        for angle in np.arange(0.0, 2 * math.pi, math.pi / 4):
            beside = x + 0.5 * math.cos(angle), y + 0.5 * math.sin(angle)
            assert island_at(courses, 0, *beside) < 0
            assert first_bridge_hit(courses, 0, x, y, z, *beside, z) < 0
