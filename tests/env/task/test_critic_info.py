"""Tests of what critics may see beside the observation, against the slow rules and the ideal eye's own observation."""

from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from tests.env.handmade import canal, ring
from tests.env.reference import ReferenceEpisode
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.env import RiverEnv
from thalweg.env.task.course_arrays import config_fingerprint, pack_courses
from thalweg.env.task.critic_info import PROGRESS, critic_features
from thalweg.env.task.ideal_eye import FEATURES, see_all
from thalweg.env.torch_env import TensorRiverEnv

N = 5
WORLDS = [ring(12.0, 48), canal(40.0)]
MODES = list(AutoresetMode)


def told_config(**options: Any) -> EnvConfig:
    return EnvConfig(**{"observation": "none", "max_idle_steps": 7, "critic_info": True, **options})


class Expected:
    """What critics of one environment should be told, from the reference implementation of the rules."""

    def __init__(self, world: int, pose: np.ndarray, config: EnvConfig) -> None:
        self.config, self.world = config, WORLDS[world]
        self.courses = pack_courses([self.world], config)
        self.episode = ReferenceEpisode(self.world, config, pose)

    def numbers(self) -> np.ndarray:
        episode = self.episode
        progress = (
            len(episode.visited) / self.world.river.segments,
            episode.idle / self.config.max_idle_steps,
            episode.steps / episode.max_steps,
        )
        if self.config.observation == "privileged":
            return np.array(progress, np.float32)
        pose = np.array([[episode.x, episode.y, episode.z, episode.yaw]])
        seen = np.empty((1, len(FEATURES)), np.float32)
        at = np.zeros(1, np.int64), pose, np.array([episode.segment]), np.array([episode.travel])
        see_all(self.courses, self.config.max_height_m, *at, seen)
        return np.concatenate([np.array(progress, np.float32), seen[0]])


def flight(seed: int, steps: int) -> np.ndarray:
    """Random actions [T, N, 4] that go forward more often than not."""
    random = np.random.default_rng(seed)
    actions = random.integers(0, 3, (steps, N, 4))
    actions[..., 2] = np.where(random.random((steps, N)) < 0.6, 0, actions[..., 2])
    actions[..., 0] = np.where(random.random((steps, N)) < 0.8, 1, actions[..., 0])
    return actions


def close(found: np.ndarray, expected: list[Expected]) -> None:
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, [each.numbers() for each in expected], rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("observation", ["none", "privileged"])
@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_they_belong_to_the_state_that_is_shown_and_final_ones_to_the_last_state(mode: AutoresetMode, observation: str):
    limit = 25 if observation == "none" else None  # without one, each world has its own
    config = told_config(observation=observation, max_steps=limit)
    env = RiverVectorEnv(WORLDS, N, config, autoreset_mode=mode)
    _, info = env.reset(seed=4)
    expected = [Expected(row % 2, info["pose"][row], config) for row in range(N)]
    close(info["critic_obs"], expected)
    assert info["critic_obs"].shape == (N, *env.single_critic_space.shape) and info["_critic_obs"].all()
    pending, ends, reasons = np.zeros(N, dtype=bool), 0, set()
    for actions in flight(2, 80):
        _, _, terminated, truncated, info = env.step(actions)
        for row in np.flatnonzero(~pending):
            expected[row].episode.step(actions[row])
        for row in np.flatnonzero(pending).tolist():
            expected[row] = Expected(row % 2, info["pose"][row], config)
        done = terminated | truncated
        reasons |= set(info["done_reason"][done].tolist())
        ends += int(done.sum())
        pending = done & (mode is AutoresetMode.NEXT_STEP)
        if mode is AutoresetMode.SAME_STEP and done.any():
            rows = np.flatnonzero(done)
            close(info["final_info"]["critic_obs"][rows], [expected[row] for row in rows])
            np.testing.assert_array_equal(info["final_info"]["_critic_obs"], done)
            begun = env.state.pose
            expected = [Expected(row % 2, begun[row], config) if done[row] else expected[row] for row in range(N)]
        close(info["critic_obs"], expected)
        if mode is AutoresetMode.DISABLED and done.any():
            _, info = env.reset(options={"reset_mask": done})
            expected = [Expected(i % 2, info["pose"][i], config) if done[i] else expected[i] for i in range(N)]
            np.testing.assert_array_equal(info["_critic_obs"], done)
            close(info["critic_obs"], expected)
    assert ends > 15 and len(reasons) > 2  # among them idle episodes and full ones


@pytest.mark.parametrize(("action", "ends_after", "column"), [((1, 1, 1, 1), 8, "idle"), ((1, 1, 0, 1), 9, "steps")])
def test_a_share_reaches_one_where_its_limit_ends_the_episode(action: tuple[int, ...], ends_after: int, column: str):
    config = told_config(max_steps=9)
    env = RiverVectorEnv([canal(60.0)], 1, config, autoreset_mode="DISABLED")
    env.reset(seed=0, options={"pose": [20.5, 0.0, 3.0, 0.0]})
    for count in range(1, ends_after + 1):
        *_, info = env.step(np.array([action]))
        told: dict[str, float] = dict(zip(PROGRESS, info["critic_obs"][0].tolist(), strict=False))
        # The first step also visits the segment in which the episode begins: whoever hovers is idle from the second on.
        visited, idle = (1, count - 1) if column == "idle" else (count + 1, 0)
        assert told == pytest.approx({"visited": visited / 60, "idle": idle / 7, "steps": count / 9}, rel=1e-6)
        assert (info["done_reason"][0] >= 0) == (count == ends_after)
    assert told[column] == 1.0


def test_environments_of_tensors_say_the_same():
    config = told_config()
    env = TensorRiverEnv(WORLDS, N, config, device="cpu")
    _, info = env.reset(seed=3)
    poses, ended, ends = info["pose"].numpy(), np.zeros(N, dtype=bool), 0
    expected = [Expected(row % 2, poses[row], config) for row in range(N)]
    close(info["critic_obs"].numpy(), expected)
    assert info["critic_obs"].shape[1:] == env.single_critic_space.shape
    for actions in flight(6, 80):
        _, _, terminated, truncated, info = env.step(torch.from_numpy(actions))
        for row in range(N):
            if ended[row]:
                expected[row] = Expected(row % 2, info["pose"][row].numpy(), config)
            else:
                expected[row].episode.step(actions[row])
        close(info["critic_obs"].numpy(), expected)
        ended = (terminated | truncated).numpy()
        ends += int(ended.sum())
    assert ends > 10


def test_single_environments_say_the_same_also_through_gymnasiums_vector():
    config = told_config(max_steps=12)
    vector = SyncVectorEnv([lambda: RiverEnv(WORLDS[0], config)] * 2, autoreset_mode=AutoresetMode.SAME_STEP)
    ours = RiverVectorEnv([WORLDS[0]], 2, config)
    env = RiverEnv(WORLDS[0], config)
    assert env.critic_space == ours.single_critic_space == gymnasium.spaces.Box(-np.inf, np.inf, (40,), np.float32)
    _, single = env.reset(seed=8)
    (_, theirs), (_, info) = vector.reset(seed=8), ours.reset(seed=8)
    np.testing.assert_array_equal(single["critic_obs"], info["critic_obs"][0])
    ends = 0
    for actions in flight(1, 30)[:, :2]:
        np.testing.assert_array_equal(theirs["critic_obs"], info["critic_obs"])
        (*_, theirs), (*_, info) = vector.step(actions), ours.step(actions)
        if "final_info" in info:
            ends += 1
            np.testing.assert_array_equal(theirs["final_info"]["critic_obs"], info["final_info"]["critic_obs"])
    assert ends > 3


def test_the_names_leave_out_what_is_observed():
    assert critic_features("privileged") == PROGRESS
    assert critic_features("rgb+mask") == critic_features("mask") == (*PROGRESS, *FEATURES)


@pytest.mark.parametrize("kind", [RiverVectorEnv, TensorRiverEnv])
def test_without_the_option_there_is_no_space_and_nothing_is_said(kind: Any):
    env = kind(WORLDS, N, EnvConfig(observation="none"), **({"device": "cpu"} if kind is TensorRiverEnv else {}))
    _, info = env.reset(seed=0)
    assert "critic_obs" not in info and not hasattr(env, "single_critic_space")


def test_the_task_and_its_states_are_the_same_either_way():
    silent, told = (told_config(critic_info=on) for on in (False, True))
    assert told.as_data() == silent.as_data() and "critic_info" not in told.as_data()
    ours, theirs = RiverVectorEnv(WORLDS, N, told), RiverVectorEnv(WORLDS, N, silent)
    ours.reset(seed=0)
    theirs.reset(seed=1)
    theirs.set_state(ours.get_state())
    for actions in flight(0, 40):
        mine, others = ours.step(actions), theirs.step(actions)
        np.testing.assert_array_equal(mine[0], others[0])
        np.testing.assert_array_equal(mine[1], others[1])


def test_hashes_of_earlier_versions_stay_valid():
    # Those of the version before the option, by which its states are recognised.
    assert config_fingerprint(EnvConfig()) == 11103356612019202923
    varied = EnvConfig(observation="privileged", max_steps=7, randomisation=True)  # pyright: ignore[reportArgumentType]
    assert config_fingerprint(varied) == 4499541351577311779
