"""Adapter with the interface of Safety-Gymnasium: steps return six values, of which the third is the cost.

The package itself is not needed; its version 1.0.0 cannot be imported beside Gymnasium 1. The interface is that which
learners such as SafePO expect; they are not tested here.
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorEnv, VectorWrapper

from thalweg.interop.vector_infos import FINAL, check_same_step, info_of_each, not_told, values_of_step


def make(env_id: str, **options: Any) -> "SafetyEnv":
    """Return a single environment of a Gymnasium id, such as "thalweg/Medium-v0", with options of `gymnasium.make`."""
    return SafetyEnv(gymnasium.make(env_id, **options))


def make_vec(env_id: str, num_envs: int = 1, **options: Any) -> "SafetyVectorEnv":
    """Return N environments of a Gymnasium id, with options of `gymnasium.make_vec`."""
    return SafetyVectorEnv(gymnasium.make_vec(env_id, num_envs=num_envs, **options))


class SafetyEnv(gymnasium.Wrapper, RecordConstructorArgs):
    """A single environment whose `step` returns observation, reward, cost, terminated, truncated and info."""

    def __init__(self, env: gymnasium.Env) -> None:
        """Wrap an environment whose `info` has `cost`."""
        RecordConstructorArgs.__init__(self)
        gymnasium.Wrapper.__init__(self, env)

    def step(self, action: Any) -> tuple[Any, float, float, bool, bool, dict[str, Any]]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Take one action; raises `InteropError` if `info` has no `cost`."""
        obs, reward, terminated, truncated, info = self.env.step(action)
        if "cost" not in info:
            raise not_told(info, "cost")
        return obs, float(reward), float(info["cost"]), terminated, truncated, info


class SafetyVectorEnv(VectorWrapper):
    """N environments whose `step` returns observations, rewards, costs [N], terminated, truncated and info.

    A new episode begins in the step in which one ends (SAME_STEP). As in Safety-Gymnasium, `final_observation` [N] then
    has the last observation, and `final_info` [N] the info, of each episode that ended, and None for the others. Their
    masks are `_final_observation` and `_final_info` [N]. The keys are absent where no episode ended.
    """

    def __init__(self, env: VectorEnv) -> None:
        """Wrap a vector environment; raises `InteropError` for another autoreset mode than SAME_STEP."""
        check_same_step(env, type(self).__name__)
        super().__init__(env)

    def step(self, actions: Any) -> tuple[Any, Any, np.ndarray, Any, Any, dict[str, Any]]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Take one action per environment; raises `InteropError` if `info` has no `cost`."""
        obs, reward, terminated, truncated, info = self.env.step(actions)
        ended = np.asarray(terminated | truncated)
        cost = values_of_step(info, "cost", ended).astype(np.float64)
        if "final_obs" in info:
            told = info_of_each(info, self.num_envs)
            final_info = np.full(self.num_envs, None, dtype=object)
            for row in np.flatnonzero(ended):
                final_info[row] = told[row]
            masks = ("_final_obs", "_final_info")
            info = {key: value for key, value in info.items() if key not in (*FINAL, *masks)} | {
                "final_observation": info["final_obs"],
                "_final_observation": ended,
                "final_info": final_info,
                "_final_info": ended.copy(),
            }
        return obs, reward, cost, terminated, truncated, info
