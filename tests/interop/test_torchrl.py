"""Tests against TorchRL itself, which takes single environments and the native vector environment as they are."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.interop.small import OPTIONS, actions, assert_same, output_of_example, single, vector

pytest.importorskip("torchrl", reason="TorchRL is not installed: make test-interop")

import torch
from torchrl.envs import GymEnv, GymWrapper  # pyright: ignore[reportMissingImports]
from torchrl.envs.utils import check_env_specs  # pyright: ignore[reportMissingImports]

MADE = {
    "GymEnv": lambda **options: GymEnv("thalweg/Easy-v0", **OPTIONS, **options),
    "GymWrapper": lambda **options: GymWrapper(single(**options)),
    "GymEnv of many": lambda **options: GymEnv("thalweg/Easy-v0", num_envs=3, **OPTIONS, **options),
    "GymWrapper of many": lambda **options: GymWrapper(vector(**options)),
}
"""The ways to an environment of TorchRL."""
KINDS: list[dict[str, Any]] = [{}, {"observation": "rgb,proprioception", "action": "continuous"}]


@pytest.mark.parametrize("way", MADE)
@pytest.mark.parametrize("options", KINDS, ids=str)
def test_its_checker_passes(way: str, options: dict):
    check_env_specs(MADE[way](**options))


def test_a_frame_as_pixels_is_that_of_render():
    env = GymEnv("thalweg/Easy-v0", from_pixels=True, pixels_only=True, **OPTIONS)
    env.set_seed(0)
    first = env.reset()
    assert_same(first["pixels"].numpy(), env.render())


def test_values_of_a_single_environment_are_the_native_ones():
    env, native = GymWrapper(single(action="continuous")).auto_register_info_dict(), single(action="continuous")
    env.set_seed(0)  # begins an episode, and the next call another one
    native.reset(seed=0)
    state, expected = env.reset(), native.reset()[0]
    assert_same(state["observation"].numpy(), expected)
    for action in actions(native.action_space, 8):
        found = env.step(state.set("action", torch.as_tensor(action)))["next"]
        obs, reward, terminated, truncated, info = native.step(action)
        assert_same(found["observation"].numpy(), obs)
        assert found["reward"].item() == np.float32(reward)
        assert (found["terminated"].item(), found["truncated"].item()) == (terminated, truncated)
        assert found["cost"].item() == info["cost"]
        state = found.exclude("reward")
        if terminated or truncated:
            break


def test_values_of_many_environments_are_the_native_ones_and_last_observations_are_those_of_their_episodes():
    options: dict[str, Any] = {"observation": "none", "action": "continuous"}
    env, native = GymWrapper(vector(**options)), vector(**options)
    env.set_seed(0)  # begins episodes, and the next call others
    native.reset(seed=0)
    state, (obs, _) = env.reset(), native.reset()
    assert_same(state["observation"].numpy(), obs)
    ended = 0
    for action in actions(native.action_space, 30):
        both, following = env.step_and_maybe_reset(state.set("action", torch.as_tensor(action)))
        obs, reward, terminated, truncated, info = native.step(action)
        found = both["next"]
        assert_same(found["reward"].numpy()[:, 0], reward.astype(np.float32))
        assert_same(found["cost"].numpy(), info["cost"])
        assert_same(following["observation"].numpy(), obs)
        last = obs.copy()
        for row in np.flatnonzero(terminated | truncated):
            last[row] = info["final_obs"][row]
        assert_same(found["observation"].numpy(), last)
        ended += (terminated | truncated).sum()
        state = following
    assert ended >= 6


def test_an_option_that_is_unknown_is_named():
    with pytest.raises(TypeError, match="framskip"):
        GymEnv("thalweg/Easy-v0", framskip=2)


def test_its_ppo_runs_by_example(tmp_path: Path):
    arguments = ["--steps", "256", "--envs", "4", "--length", "32"]
    lines = output_of_example("torchrl_ppo.py", *arguments, cwd=tmp_path).splitlines()
    assert [line.split(":")[0] for line in lines if line.startswith("step ")] == ["step 0", "step 128"]
