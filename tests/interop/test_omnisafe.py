"""Tests against OmniSafe itself: values of its environment, its normaliser, and its learners."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.interop.small import actions, assert_same, output_of_example, vector

pytest.importorskip("omnisafe.envs", reason="OmniSafe is not installed: make test-interop")

import omnisafe  # pyright: ignore[reportMissingImports]
import torch
from omnisafe.envs.core import make, support_envs  # pyright: ignore[reportMissingImports]
from omnisafe.envs.wrapper import ObsNormalize  # pyright: ignore[reportMissingImports]

from thalweg.interop.errors import InteropError
from thalweg.interop.omnisafe import RiverCMDP, register

SHORT = {"max_steps": 12}


def test_all_ids_are_registered():
    assert {"thalweg/Easy-v0", "thalweg/Swimmers-Hard-v0", "thalweg/Medium-ASV-v0"} <= set(support_envs())


def test_values_of_many_environments_are_the_native_ones():
    env, native = make("thalweg/Easy-v0", num_envs=3, **SHORT), vector(observation="privileged", action="continuous")
    first, _ = env.reset(seed=2)
    assert_same(first.numpy(), native.reset(seed=2)[0])
    ended = 0
    for action in actions(native.action_space, 30):
        *found, info = env.step(torch.as_tensor(action))
        obs, reward, terminated, truncated, expected = native.step(action)
        for value, other in zip(found, (obs, reward, expected["cost"], terminated, truncated), strict=True):
            assert_same(value.numpy(), other.astype(np.float32))
        done = terminated | truncated
        assert ("final_observation" in info) == done.any()
        if done.any():
            assert_same(info["_final_observation"].numpy(), done)
            for row in range(3):
                last = expected["final_obs"][row] if done[row] else np.zeros(37, np.float32)
                assert_same(info["final_observation"][row].numpy(), last)
        ended += done.sum()
    assert ended >= 6


def test_its_normaliser_stays_finite_where_one_of_many_episodes_ends():
    env = ObsNormalize(make("thalweg/Easy-v0", num_envs=3, **SHORT), torch.device("cpu"))
    env.reset(seed=0)
    for action in actions(vector(observation="none", action="continuous").action_space, 30):
        obs, *_, info = env.step(torch.as_tensor(action))
        assert obs.isfinite().all()
        assert "final_observation" not in info or info["final_observation"].isfinite().all()


def test_actions_beyond_the_range_are_clipped():
    env, other = (make("thalweg/Easy-v0", **SHORT) for _ in range(2))
    env.reset(seed=0)
    other.reset(seed=0)
    assert_same(env.step(torch.full((4,), 3.0))[0].numpy(), other.step(torch.ones(4))[0].numpy())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"observation": "rgb"}, r"OmniSafe sees vectors, not Box.*choose observation='privileged', or an encoder"),
        ({"action": "multidiscrete"}, "OmniSafe takes continuous actions, not MultiDiscrete"),
    ],
)
def test_what_it_cannot_carry_is_refused_by_name(options: dict, message: str):
    for count in (1, 2):
        with pytest.raises(InteropError, match=message):
            RiverCMDP("thalweg/Easy-v0", num_envs=count, **options)


register("Codes-v0", "thalweg/Easy-v0", encoder="default", max_steps=12)
register("Short-v0", "thalweg/Easy-v0", max_steps=12)


@pytest.mark.parametrize(
    ("algorithm", "env_id", "count"), [("PPOLag", "Short-v0", 3), ("FOCOPS", "Codes-v0", 1), ("CPO", "Short-v0", 2)]
)
def test_its_learners_run(algorithm: str, env_id: str, count: int, tmp_path: Path):
    custom: dict[str, Any] = {
        "train_cfgs": {"total_steps": 96 * count, "vector_env_nums": count, "torch_threads": 1, "device": "cpu"},
        "algo_cfgs": {"steps_per_epoch": 48 * count, "update_iters": 1, "batch_size": 48},
        "logger_cfgs": {"use_wandb": False, "use_tensorboard": False, "log_dir": str(tmp_path)},
    }
    returned, cost, length = omnisafe.Agent(algorithm, env_id, custom_cfgs=custom).learn()
    assert np.isfinite([returned, cost]).all() and 0 < length <= 12


def test_its_off_policy_learner_runs(tmp_path: Path):
    custom: dict[str, Any] = {
        "train_cfgs": {"total_steps": 192, "vector_env_nums": 1, "torch_threads": 1, "device": "cpu"},
        "algo_cfgs": {"steps_per_epoch": 96, "update_cycle": 48, "update_iters": 2, "start_learning_steps": 48},
        "logger_cfgs": {"use_wandb": False, "use_tensorboard": False, "log_dir": str(tmp_path)},
    }
    returned, cost, _ = omnisafe.Agent("SACLag", "Short-v0", custom_cfgs=custom).learn()
    assert np.isfinite([returned, cost]).all()


def test_ids_that_are_taken_or_unknown_are_refused():
    with pytest.raises(InteropError, match="has an environment 'Codes-v0' already"):
        register("Codes-v0", "thalweg/Easy-v0")
    with pytest.raises(InteropError, match=r"unknown id 'Medium'; known: thalweg/Easy-v0"):
        register("New-v0", "Medium")


def test_the_example_runs(tmp_path: Path):
    assert "mean return" in output_of_example("omnisafe_ppolag.py", "--steps", "512", "--envs", "2", cwd=tmp_path)
