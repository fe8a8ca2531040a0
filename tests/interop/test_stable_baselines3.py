"""Tests against Stable-Baselines3 itself: its checker, its own vector environment, and its learners."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from tests.interop.small import OPTIONS, actions, assert_same, output_of_example, output_of_page, single, vector
from thalweg.interop.errors import InteropError
from thalweg.render import Camera

pytest.importorskip("stable_baselines3", reason="Stable-Baselines3 is not installed: make test-interop")

import torch
from stable_baselines3 import A2C, PPO  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.env_checker import check_env  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.evaluation import evaluate_policy  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor  # pyright: ignore[reportMissingImports]

from thalweg.interop.stable_baselines3 import RiverVecEnv, make_vec_env


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("observation", ["rgb+mask", "rgb", "dict", "privileged"])
@pytest.mark.parametrize("action", ["multidiscrete", "continuous"])
def test_its_checker_passes_on_single_environments(observation: str, action: str):
    check_env(single(observation=observation, action=action))


@pytest.mark.parametrize("options", [{}, {"observation": "dict", "action": "continuous"}, {"critic_info": True}])
def test_the_vec_env_is_its_own_of_single_environments_to_the_bit(options: dict):
    ours, theirs = RiverVecEnv(vector(**options)), DummyVecEnv([lambda: single(**options) for _ in range(3)])
    for vec_env in (ours, theirs):
        vec_env.seed(7)
    assert_same(ours.reset(), theirs.reset())
    assert_same(ours.reset_infos, theirs.reset_infos)
    ended = 0
    space = gymnasium.vector.utils.batch_space(ours.action_space, 3)
    for step, action in enumerate(actions(space, 40)):
        found, expected = ours.step(action), theirs.step(action)
        assert_same(found, expected, f"step {step}")
        ended += sum(found[2])
    assert ended >= 9


def test_the_time_limit_is_told_apart_from_other_ends():
    vec_env = RiverVecEnv(vector(observation="none", max_steps=3))
    vec_env.seed(0)
    vec_env.reset()
    for _ in range(3):
        _, _, ends, infos = vec_env.step(np.ones((3, 4), dtype=np.int64))
    assert ends.all() and all(info["TimeLimit.truncated"] for info in infos)
    assert [info["done_reason"] for info in infos] == [5, 5, 5]


def test_the_deadline_of_a_task_is_no_time_limit():
    vec_env = RiverVecEnv(vector(observation="none", task="Nests", max_steps=3))
    vec_env.seed(0)
    vec_env.reset()
    for _ in range(3):
        _, _, ends, infos = vec_env.step(np.ones((3, 4), dtype=np.int64))
    assert ends.all() and not any(info["TimeLimit.truncated"] for info in infos)
    assert [info["done_reason"] for info in infos] == [5, 5, 5]


def test_poses_set_as_options_are_where_the_next_episodes_begin():
    vec_env = RiverVecEnv(vector(2, observation="none"))
    vec_env.seed(0)
    vec_env.reset()
    poses = [info["pose"] for info in vec_env.reset_infos]
    vec_env.set_options([{"pose": poses[1]}, {"pose": poses[0]}])
    assert_same(vec_env.reset(), np.stack(poses[::-1]))
    vec_env.set_options([{"pose": poses[1]}, {}])
    with pytest.raises(InteropError, match=r"'pose' must be set for all environments; it is not for \[1\]"):
        vec_env.reset()


def test_what_one_object_cannot_do_for_some_environments_is_refused_by_name():
    native: Any = vector(2, observation="none")
    vec_env = RiverVecEnv(native)
    vec_env.reset()
    with pytest.raises(AttributeError, match=r"get_attr knows render_mode, .*, not 'state'"):
        vec_env.get_attr("state")
    with pytest.raises(AttributeError, match="'render_mode' cannot be set for some of them"):
        vec_env.set_attr("render_mode", "human")
    with pytest.raises(AttributeError, match="env_method knows pilot_action, not 'set_state'"):
        vec_env.env_method("set_state", {})
    assert vec_env.has_attr("cost_kinds") and not vec_env.has_attr("action_masks")
    assert vec_env.get_attr("action_space", 1) == [vec_env.action_space]
    assert_same(vec_env.env_method("pilot_action"), list(native.pilot_actions()))


@pytest.mark.parametrize("mode", ["next_step", "disabled"])
def test_another_autoreset_mode_is_refused(mode: str):
    with pytest.raises(InteropError, match=f"autoreset_mode is SAME_STEP, not {mode.upper()}: leave autoreset_mode="):
        RiverVecEnv(vector(2, observation="none", autoreset_mode=mode))


def test_frames_are_tiled_and_absent_without_a_render_mode():
    vec_env = RiverVecEnv(vector(4, render_mode="rgb_array"))
    vec_env.reset()
    frames: Any = vec_env.envs.render()
    rows = [np.concatenate(frames[first : first + 2], axis=1) for first in (0, 2)]
    assert_same(vec_env.render(), np.concatenate(rows))
    assert RiverVecEnv(vector(2, observation="none")).get_images() == [None, None]


def weights_after(algorithm, env, steps: int, **settings) -> tuple[np.ndarray, np.ndarray]:
    """Return a policy's weights before and after some steps of learning."""
    torch.manual_seed(0)
    model = algorithm(env=env, seed=0, device="cpu", **settings)
    before = torch.nn.utils.parameters_to_vector(model.policy.parameters()).detach().numpy().copy()
    model.learn(steps)
    assert model.num_timesteps >= steps
    return before, torch.nn.utils.parameters_to_vector(model.policy.parameters()).detach().numpy()


def test_ppo_with_convolutions_learns_on_a_single_environment():
    before, after = weights_after(PPO, single(), 128, policy="CnnPolicy", n_steps=64, batch_size=32, n_epochs=1)
    assert np.isfinite(after).all() and not np.array_equal(before, after)


def test_ppo_with_convolutions_learns_on_the_vec_env():
    env = make_vec_env("thalweg/Easy-v0", 4, seed=0, **OPTIONS)
    before, after = weights_after(PPO, env, 256, policy="CnnPolicy", n_steps=32, batch_size=64, n_epochs=1)
    assert np.isfinite(after).all() and not np.array_equal(before, after)


def test_a2c_learns_from_dictionaries_and_gets_the_same_weights_as_on_its_own_vec_env():
    options = {"observation": "rgb,proprioception"}
    own = DummyVecEnv([lambda: single(**options) for _ in range(2)])
    found = [
        weights_after(A2C, env, 80, policy="MultiInputPolicy", n_steps=10)[1]
        for env in (RiverVecEnv(vector(2, **options)), own)
    ]
    assert_same(found[0], found[1])


def test_codes_of_an_encoder_are_observations_and_the_monitor_tells_costs(tmp_path: Path):
    options = {**OPTIONS, "camera": Camera()}
    env = make_vec_env("thalweg/Easy-v0", 2, seed=0, encoder="default", monitor_file=str(tmp_path / "log"), **options)
    assert isinstance(env, VecMonitor) and len(env.observation_space.shape) == 1
    model = PPO("MlpPolicy", env, n_steps=16, batch_size=16, n_epochs=1, seed=0, device="cpu").learn(64)
    returns, lengths = evaluate_policy(model, env, n_eval_episodes=2, return_episode_rewards=True)
    assert len(returns) == 2 and max(lengths) <= 12
    header, *rows = (tmp_path / "log.monitor.csv").read_text().splitlines()[1:]
    assert header == "r,l,t,cost,done_reason" and len(rows) >= 4


def test_the_example_runs(tmp_path: Path):
    arguments = ["--steps", "256", "--envs", "2", "--out", str(tmp_path / "ppo")]
    assert "mean return" in output_of_example("stable_baselines3_ppo.py", *arguments, cwd=tmp_path)
    assert (tmp_path / "ppo.zip").exists()


def test_the_lines_of_the_page_run(tmp_path: Path):
    smaller = {"n_envs=16": "n_envs=2", '"0:4"': '"0"', "n_steps=128": "n_steps=32", "200_000": "64"}
    output_of_page("Stable-Baselines3", smaller, tmp_path)
