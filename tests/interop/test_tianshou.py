"""Tests against Tianshou itself, which takes single environments as they are."""

import re
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from tests.interop.small import OPTIONS, actions, assert_same, output_of_example, single

pytest.importorskip("tianshou", reason="Tianshou is not installed: make test-interop")

import torch
from tianshou.algorithm import DQN  # pyright: ignore[reportMissingImports]
from tianshou.algorithm.modelfree.dqn import DiscreteQLearningPolicy  # pyright: ignore[reportMissingImports]
from tianshou.algorithm.optim import AdamOptimizerFactory  # pyright: ignore[reportMissingImports]
from tianshou.data import Collector, VectorReplayBuffer  # pyright: ignore[reportMissingImports]
from tianshou.env import (  # pyright: ignore[reportMissingImports]
    BaseVectorEnv,
    DummyVectorEnv,
    MultiDiscreteToDiscrete,
    ShmemVectorEnv,
)
from tianshou.trainer import OffPolicyTrainerParams  # pyright: ignore[reportMissingImports]
from tianshou.utils.net.common import Net  # pyright: ignore[reportMissingImports]

SCALARS = ("cost", "done_reason", "progress")
"""Names in `info` whose values are numbers."""


def vectors() -> gymnasium.Env:
    """Return an environment without frames whose 81 moves are one discrete action."""
    return MultiDiscreteToDiscrete(single(observation="privileged"))


@pytest.mark.parametrize("kind", [DummyVectorEnv, ShmemVectorEnv])
def test_values_of_its_vector_environments_are_the_native_ones(kind: type[BaseVectorEnv]):
    options: dict[str, Any] = {"observation": "rgb", "action": "continuous"}
    envs, natives = kind([lambda: single(**options)] * 2), [single(**options) for _ in range(2)]
    envs.seed([3, 4])
    for native, seed in zip(natives, (3, 4), strict=True):
        native.reset(seed=seed)  # `seed` begins an episode, and the next call another one
    obs, _ = envs.reset()
    assert_same(obs, np.stack([native.reset()[0] for native in natives]))
    ends = 0
    for both in actions(gymnasium.vector.utils.batch_space(natives[0].action_space, 2), 20):
        obs, rewards, terminated, truncated, infos = envs.step(both)
        for index, native in enumerate(natives):
            found = (obs[index], rewards[index], terminated[index], truncated[index])
            *expected, info = native.step(both[index])
            assert_same(found, tuple(expected))
            assert {name: infos[index][name] for name in SCALARS} == {name: info[name] for name in SCALARS}
            if terminated[index] or truncated[index]:
                assert_same(envs.reset([index])[0][0], native.reset()[0])
                ends += 1
    envs.close()
    assert ends >= 2


def test_each_move_is_one_of_its_discrete_actions():
    env: Any = vectors()
    moves = [tuple(env.action(index)) for index in range(env.action_space.n)]
    assert sorted(moves) == list(np.ndindex(3, 3, 3, 3))


def test_its_buffer_keeps_the_cost_of_each_step():
    envs = DummyVectorEnv([vectors] * 3)
    envs.seed(0)
    net = Net(state_shape=envs.observation_space[0].shape, action_shape=81, hidden_sizes=(16,))
    policy = DiscreteQLearningPolicy(model=net, action_space=vectors().action_space, eps_inference=1.0)
    collector = Collector(policy, envs, VectorReplayBuffer(120, 3), exploration_noise=True)
    collector.reset()
    collector.collect(n_step=90)
    buffer, ends = collector.buffer, collector.buffer.done
    assert len(buffer) == 90 and ends.sum() >= 6
    steps = buffer.sample_indices(0)  # all, in their order
    assert (buffer.info["done_reason"][steps][ends[steps]] >= 0).all()
    assert (buffer.info["done_reason"][steps][~ends[steps]] == -1).all()
    assert buffer.info["cost"][steps].sum() > 0


def test_its_dqn_learns():
    torch.manual_seed(0)
    envs = DummyVectorEnv([vectors] * 2)
    envs.seed(0)
    net = Net(state_shape=envs.observation_space[0].shape, action_shape=81, hidden_sizes=(16,))
    policy = DiscreteQLearningPolicy(model=net, action_space=vectors().action_space, eps_training=0.5)
    algorithm = DQN(policy=policy, optim=AdamOptimizerFactory(lr=1e-3), target_update_freq=20)
    before = torch.nn.utils.parameters_to_vector(net.parameters()).detach().numpy().copy()
    collector = Collector(algorithm, envs, VectorReplayBuffer(200, 2), exploration_noise=True)
    limits: dict[str, Any] = {"max_epochs": 1, "epoch_num_steps": 100, "collection_step_num_env_steps": 20}
    quiet: dict[str, Any] = {"verbose": False, "show_progress": False}
    algorithm.run_training(OffPolicyTrainerParams(training_collector=collector, batch_size=32, **limits, **quiet))
    after = torch.nn.utils.parameters_to_vector(net.parameters()).detach().numpy()
    assert np.isfinite(after).all() and not np.array_equal(before, after)


def test_an_option_that_is_unknown_is_named():
    with pytest.raises(TypeError, match="framskip"):
        DummyVectorEnv([lambda: gymnasium.make("thalweg/Easy-v0", **OPTIONS, framskip=2)])


def test_its_ppo_runs_by_example(tmp_path: Path):
    arguments = ["--epochs", "2", "--steps", "64", "--envs", "2", "--length", "32"]
    lines = output_of_example("tianshou_ppo.py", *arguments, cwd=tmp_path).splitlines()
    pattern = r"epoch (\d): \d+ episodes, mean return \d+\.\d\d, mean cost \d+\.\d\d"
    assert [found[1] for line in lines if (found := re.fullmatch(pattern, line))] == ["0", "1"]


def test_an_example_in_which_no_episode_ended_says_so(tmp_path: Path):
    arguments = ["--epochs", "1", "--steps", "2", "--envs", "2", "--length", "1"]
    assert "epoch 0: no episode ended" in output_of_example("tianshou_ppo.py", *arguments, cwd=tmp_path).splitlines()
