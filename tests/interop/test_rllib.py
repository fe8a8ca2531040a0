"""Tests against RLlib itself, which takes single environments and the native vector environment as they are."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from tests.interop.small import OPTIONS, output_of_example

pytest.importorskip("ray.rllib", reason="RLlib is not installed: make test-interop")

import ray  # pyright: ignore[reportMissingImports]
from ray.rllib.algorithms.ppo import PPOConfig  # pyright: ignore[reportMissingImports]
from ray.rllib.core.rl_module.default_model_config import (  # pyright: ignore[reportMissingImports]
    DefaultModelConfig,
)
from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner  # pyright: ignore[reportMissingImports]

NATIVE = "vector_entry_point"
WAYS: dict[str, dict[str, Any]] = {"sync": {}, NATIVE: {"autoreset_mode": "next_step"}}
"""Modes of vectorisation, each with the option that it needs."""


@pytest.fixture(scope="module", autouse=True)
def _ray() -> Iterator[None]:
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    yield
    ray.shutdown()


def config_of(way: str, **options: Any) -> Any:
    """Return a config of PPO with a small network, on three environments in this process."""
    return (
        PPOConfig()
        .environment("thalweg/Easy-v0", env_config={**OPTIONS, **WAYS[way], **options})
        .env_runners(num_env_runners=0, num_envs_per_env_runner=3, gym_env_vectorize_mode=way)
        .rl_module(model_config=DefaultModelConfig(fcnet_hiddens=[16]))
        .training(train_batch_size_per_learner=48, minibatch_size=24, num_epochs=1)
        .debugging(seed=0)
    )


@pytest.mark.parametrize("action", ["multidiscrete", "continuous"])
@pytest.mark.parametrize("way", WAYS)
def test_its_episodes_are_those_of_single_environments(way: str, action: str):
    options = {"observation": "privileged", "action": action}
    runner = SingleAgentEnvRunner(config=config_of(way, **options))
    episodes = runner.sample(num_episodes=6, random_actions=True)
    native: Any = gymnasium.make("thalweg/Easy-v0", **{**OPTIONS, **options})
    for episode in episodes:
        infos = episode.get_infos()
        obs, _ = native.reset(options={"pose": infos[0]["pose"].tolist()})
        np.testing.assert_allclose(episode.get_observations(0), obs, rtol=1e-5)
        for step, action_taken in enumerate(episode.get_actions()):
            obs, reward, terminated, truncated, info = native.step(action_taken)
            np.testing.assert_allclose(episode.get_observations(step + 1), obs, rtol=1e-5, atol=1e-5)
            assert episode.get_rewards(step) == pytest.approx(reward)
            assert infos[step + 1]["cost"] == info["cost"]
        assert (episode.is_terminated, episode.is_truncated) == (terminated, truncated)
    runner.stop()


def test_its_ppo_learns_on_the_native_vector_environment():
    algorithm = config_of(NATIVE, observation="privileged").build_algo()
    weights = [parameter.detach().numpy().copy() for parameter in algorithm.get_module().parameters()]
    found = algorithm.train()["env_runners"]
    after = [parameter.detach().numpy() for parameter in algorithm.get_module().parameters()]
    algorithm.stop()
    assert found["num_env_steps_sampled"] == 48 and found["num_episodes"] >= 3
    assert all(np.isfinite(each).all() for each in after)
    assert any(not np.array_equal(old, new) for old, new in zip(weights, after, strict=True))


def test_an_option_that_is_unknown_is_named():
    with pytest.raises(TypeError, match="framskip"):
        SingleAgentEnvRunner(config=config_of("sync", framskip=2))


def test_its_ppo_runs_by_example(tmp_path: Path):
    arguments = ["--iterations", "2", "--envs", "4", "--length", "32"]
    lines = output_of_example("rllib_ppo.py", *arguments, cwd=tmp_path).splitlines()
    pattern = r"iteration (\d): \d+ episodes, mean return \d+\.\d\d, mean cost \d+\.\d\d"
    assert [found[1] for line in lines if (found := re.fullmatch(pattern, line))] == ["0", "1"]


def test_an_example_in_which_no_episode_ended_says_so(tmp_path: Path):
    arguments = ["--iterations", "1", "--envs", "2", "--length", "1"]
    assert "iteration 0: no episode ended" in output_of_example("rllib_ppo.py", *arguments, cwd=tmp_path).splitlines()
