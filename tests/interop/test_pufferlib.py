"""Tests against PufferLib itself: its vector environments, its emulation, its rollouts and its policies."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from tests.interop.small import OPTIONS, actions, assert_same, output_of_example, single, vector
from thalweg.env import RiverVectorEnv
from thalweg.interop.errors import InteropError

pytest.importorskip("pufferlib", reason="PufferLib is not installed: make test-interop")

import pufferlib.emulation  # pyright: ignore[reportMissingImports]
import pufferlib.models  # pyright: ignore[reportMissingImports]
import pufferlib.pufferl  # pyright: ignore[reportMissingImports]
import pufferlib.vector  # pyright: ignore[reportMissingImports]

from thalweg.interop.pufferlib import RiverPufferEnv

KINDS: list[dict[str, Any]] = [
    {},
    {"observation": "privileged", "action": "continuous"},
    {
        "observation": "privileged",
        "vectorization_mode": "sync",
        "vector_kwargs": {"autoreset_mode": AutoresetMode.SAME_STEP},
    },
]
APART = ("vectorization_mode", "vector_kwargs")
"""Options of environments that are not the native vector."""
SETTINGS = {
    "env": "river", "seed": 0, "device": "cpu", "use_rnn": False, "cpu_offload": False, "compile": False,
    "batch_size": 64, "bptt_horizon": 16, "minibatch_size": 64, "max_minibatch_size": 64, "update_epochs": 1,
    "optimizer": "adam", "learning_rate": 1e-3, "adam_beta1": 0.9, "adam_beta2": 0.999, "adam_eps": 1e-8,
    "total_timesteps": 64, "precision": "float32", "torch_deterministic": True,
}  # fmt: skip
"""Settings of PufferLib's learner."""
SUMS = ("episode_return", "episode_length", "episode_cost")


def river(num_envs: int = 3, **options: Any) -> Any:
    """Return a `PufferEnv` with small frames."""
    return RiverPufferEnv("thalweg/Easy-v0", num_envs, **{**OPTIONS, **options})


@pytest.mark.parametrize("options", KINDS, ids=str)
def test_values_are_those_of_the_native_vector_environment_and_infos_are_sums_of_episodes(options: dict):
    native = vector(**{key: value for key, value in options.items() if key not in APART})
    env = river(**options)
    assert_same(env.reset(seed=7)[0], native.reset(seed=7 * 3)[0])
    sums, ended = np.zeros((3, 3)), 0
    for action in actions(native.action_space, 40):
        obs, reward, terminated, truncated, info = native.step(action)
        *found, infos = env.step(action)
        assert_same(found, [obs, reward.astype(np.float32), terminated, truncated])
        sums += [reward, np.ones(3), info["cost"]]
        rows = np.flatnonzero(terminated | truncated)
        assert [[told[name] for name in SUMS] for told in infos] == sums[:, rows].T.tolist()
        assert [told["done_reason"] for told in infos] == info["done_reason"][rows].tolist()
        sums[:, rows] = 0
        ended += len(rows)
    assert ended >= 9


def test_two_of_them_share_the_buffers_of_its_vector_environment():
    options = {**OPTIONS, "observation": "privileged"}
    both = pufferlib.vector.make(
        RiverPufferEnv, ["thalweg/Easy-v0", 2], options, backend=pufferlib.vector.Serial, num_envs=2, seed=5
    )
    natives = [vector(2, observation="privileged") for _ in range(2)]
    seeds = (10, 12)  # of the instances 5 and 6: 10, 11 and 12, 13
    expected = [native.reset(seed=seed)[0] for native, seed in zip(natives, seeds, strict=True)]
    assert_same(both.reset(seed=5)[0], np.concatenate(expected))
    assert len(np.unique(both.observations, axis=0)) == 4, "no two environments begin alike"
    action = np.ones((4, 4), dtype=np.int32)
    expected = [native.step(action[:2]) for native in natives]
    obs, rewards, *_ = both.step(action)
    assert_same(obs, np.concatenate([each[0] for each in expected]))
    assert_same(rewards, np.concatenate([each[1] for each in expected]).astype(np.float32))
    both.close()


def test_the_seed_of_its_making_is_that_of_the_first_reset():
    native = vector(observation="privileged")
    env = river(observation="privileged", seed=3)
    for seed in (9, None):
        assert_same(env.reset()[0], native.reset(seed=seed)[0])


@pytest.mark.parametrize("observation", ["rgb", "dict", "privileged"])
def test_its_emulation_takes_single_environments(observation: str):
    env = pufferlib.emulation.GymnasiumPufferEnv(single(observation=observation))
    native = single(observation=observation)
    found, (obs, _) = env.reset(seed=2)[0], native.reset(seed=2)
    for action in [None, *actions(native.action_space, 3)]:
        if action is not None:
            found, reward, *_ = env.step(action)
            obs, expected, *_ = native.step(action)
            assert reward == expected
        if observation == "dict":
            parts = found.view(env.obs_dtype)[0]
            assert_same({name: parts[name][0] for name in obs}, dict(obs))
        else:
            assert_same(found[0], obs)


def test_its_learner_collects_a_batch(tmp_path: Path):
    """`evaluate` of PuffeRL fills the batch; its `train` needs a compiled extension and CUDA's libraries."""
    env = river(4, observation="privileged", seed=0)
    config = {**SETTINGS, "data_dir": str(tmp_path)}
    learner = pufferlib.pufferl.PuffeRL(config, env, pufferlib.models.Default(env, hidden_size=16))
    stats = learner.evaluate()
    learner.utilization.stop()
    assert (learner.observations != 0).any(dim=2).all()
    assert len(stats["episode_return"]) >= 4 and set(stats["episode_length"]) <= set(range(1, 13))
    assert set(stats["done_reason"]) <= set(range(6))


def test_observations_and_modes_that_it_cannot_take_are_refused_by_name(monkeypatch: pytest.MonkeyPatch):
    closed = []
    monkeypatch.setattr(RiverVectorEnv, "close_extras", lambda self, **_: closed.append(self))
    with pytest.raises(InteropError, match="observations that are one array, not a Dict") as first:
        river(observation="dict")
    with pytest.raises(InteropError, match="autoreset_mode is SAME_STEP, not NEXT_STEP") as second:
        river(observation="none", autoreset_mode="next_step")
    assert len(closed) == 2 and first.tb and second.tb, "its environments are closed while errors still refer to them"


def test_a_policy_learns_by_example(tmp_path: Path):
    arguments = ["--steps", "256", "--envs", "4", "--length", "32"]
    lines = output_of_example("pufferlib_ppo.py", *arguments, cwd=tmp_path).splitlines()
    pattern = r"step (\d+): \d+ episodes, mean return \d+\.\d\d, mean cost \d+\.\d\d"
    assert [found[1] for line in lines if (found := re.fullmatch(pattern, line))] == ["0", "128"]


def test_an_example_in_which_no_episode_ended_says_so(tmp_path: Path):
    arguments = ["--steps", "2", "--envs", "2", "--length", "1"]
    assert "step 0: no episode ended" in output_of_example("pufferlib_ppo.py", *arguments, cwd=tmp_path).splitlines()
