"""Tests of the six values against the environments that they come from.

Safety-Gymnasium 1.0.0 itself cannot be imported beside Gymnasium 1, on which Thalweg depends; OmniSafe's use of six
values is tested in `test_omnisafe.py`.
"""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from tests.interop.small import OPTIONS, actions, assert_same, single, vector
from thalweg.interop import safety_gymnasium
from thalweg.interop.errors import InteropError
from thalweg.interop.safety_gymnasium import SafetyEnv, SafetyVectorEnv


def test_a_step_returns_the_cost_as_its_third_value_and_else_what_it_did():
    options = {**OPTIONS, "observation": "none"}
    env, plain = safety_gymnasium.make("thalweg/Easy-v0", **options), single(observation="none")
    assert_same(env.reset(seed=3), plain.reset(seed=3))
    costs = []
    for action in actions(env.action_space, 12):
        obs, reward, cost, *rest = env.step(action)
        expected = plain.step(action)
        assert_same([obs, reward, *rest], list(expected))
        assert cost == expected[4]["cost"] and type(cost) is float
        costs.append(cost)
    assert costs == [0.0] * 11 + [0.2]  # the step limit costs 0.2


@pytest.mark.parametrize("critic_info", [False, True])
def test_many_environments_have_final_observations_where_episodes_ended_and_nowhere_else(critic_info: bool):
    options = {"observation": "none", "critic_info": critic_info}
    env, plain = SafetyVectorEnv(vector(**options)), vector(**options)
    singles = [single(**options) for _ in range(3)]
    env.reset(seed=5)
    plain.reset(seed=5)
    for row, each in enumerate(singles):
        each.reset(seed=5 + row)
    ended = 0
    for action in actions(env.action_space, 30):
        obs, reward, cost, terminated, truncated, info = env.step(action)
        expected = plain.step(action)
        assert_same([obs, reward, terminated, truncated], list(expected[:4]))
        assert_same(cost, expected[4]["cost"])
        done = terminated | truncated
        assert ("final_observation" in info) == ("final_info" in info) == done.any()
        assert "final_obs" not in info
        for row, each in enumerate(singles):
            last = each.step(action[row])
            if done[row]:
                assert_same(info["final_observation"][row], last[0])
                assert_same(info["final_info"][row], last[4])
                each.reset()
            elif done.any():
                assert info["final_observation"][row] is None and info["final_info"][row] is None
        if done.any():
            assert_same(info["_final_observation"], done)
        ended += done.sum()
    assert ended >= 6


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_vectors_of_single_environments_have_the_costs_of_ends_too(mode: str):
    envs = vector(
        observation="none", vectorization_mode=mode, vector_kwargs={"autoreset_mode": AutoresetMode.SAME_STEP}
    )
    env, native = SafetyVectorEnv(envs), vector(observation="none")
    env.reset(seed=5)
    native.reset(seed=5)
    costs = []
    for action in actions(native.action_space, 30):
        cost, *_, info = env.step(action)[2:]
        expected = native.step(action)[4]["cost"]
        assert_same(cost, expected)
        for row in np.flatnonzero(info.get("_final_info", np.zeros(3))):
            assert info["final_info"][row]["cost"] == cost[row]
        costs.extend(cost)
    env.close()
    assert np.count_nonzero(costs) >= 6


class Unsafe(gymnasium.Env):
    """An environment whose episodes have one step and that tells a cost of 3 then, and nothing at a reset."""

    observation_space = action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[int, dict[str, Any]]:
        super().reset(seed=seed)
        return 0, {}

    def step(self, action: Any) -> tuple[int, float, bool, bool, dict[str, Any]]:
        return 1, 0.0, True, False, {"cost": 3.0}


def test_a_cost_that_only_the_final_info_tells_is_returned():
    env = SafetyVectorEnv(SyncVectorEnv([Unsafe, Unsafe], autoreset_mode=AutoresetMode.SAME_STEP))
    env.reset(seed=0)
    assert_same(env.step(np.zeros(2, dtype=int))[2], np.array([3.0, 3.0]))


def test_other_autoreset_modes_and_environments_without_a_cost_are_refused():
    with pytest.raises(InteropError, match=r"SafetyVectorEnv needs .* SAME_STEP, not NEXT_STEP"):
        safety_gymnasium.make_vec("thalweg/Easy-v0", 2, observation="none", autoreset_mode="next_step")
    env = SafetyEnv(gymnasium.make("CartPole-v1"))
    env.reset(seed=0)
    with pytest.raises(InteropError, match="tells no cost: info has nothing, not cost"):
        env.step(np.int64(0))
    many = SafetyVectorEnv(
        SyncVectorEnv([lambda: gymnasium.make("CartPole-v1")], autoreset_mode=AutoresetMode.SAME_STEP)
    )
    many.reset(seed=0)
    with pytest.raises(InteropError, match="tells no cost: info has nothing, not cost"):
        many.step(np.zeros(1, dtype=int))
