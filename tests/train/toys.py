"""Small environments with everything that can go wrong between an environment and a trainer."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space


class Count(gym.Env):
    """Counts its steps: the observation is (episode, step), the reward 1, and its last step costs 1.

    Episodes take `length` steps and are truncated if `cut`, else terminated.
    """

    observation_space = gym.spaces.Box(-np.inf, np.inf, (2,), np.float32)
    action_space = gym.spaces.Discrete(2)

    def __init__(self, length: int = 3, cut: bool = True, names_cost: str = "always") -> None:
        self.length, self.cut, self.names_cost = length, cut, names_cost
        self.episode, self.at = -1, 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        self.episode, self.at = self.episode + 1, 0
        return self._obs(), {}

    def step(self, action: Any):
        self.at += 1
        last = self.at == self.length
        named = self.names_cost == "always" or (self.names_cost == "last" and last)
        return self._obs(), 1.0, last and not self.cut, last and self.cut, {"cost": float(last)} if named else {}

    def _obs(self) -> np.ndarray:
        return np.array([self.episode, self.at], np.float32)


class ToldCount(Count):
    """A count that tells critics twice its observation, and how long its episodes take."""

    critic_space = gym.spaces.Box(-np.inf, np.inf, (3,), np.float32)

    def reset(self, **given: Any):
        obs, info = super().reset(**given)
        return obs, info | self._told()

    def step(self, action: Any):
        *rest, info = super().step(action)
        return *rest, info | self._told()

    def _told(self) -> dict[str, Any]:
        return {"critic_obs": np.array([2 * self.episode, 2 * self.at, self.length], np.float32)}


class Walk(VectorEnv):
    """N walkers on a line with an own generator each step; can be put away and brought back if `portable`.

    Action 0, 1, 2 is left, stay, right; beyond ±1 the episode ends with a cost; after 20 steps it is cut off.
    """

    def __init__(self, num_envs: int = 4, portable: bool = True, poison: tuple[str, int] | None = None) -> None:
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}
        self.num_envs, self.poison = num_envs, poison
        self.single_observation_space = gym.spaces.Box(-np.inf, np.inf, (3,), np.float32)
        self.single_action_space = gym.spaces.MultiDiscrete([3, 2])
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.random = np.random.default_rng(0)
        self.position, self.clock, self.total = np.zeros(num_envs), np.zeros(num_envs, dtype=np.int64), 0
        if portable:
            self.get_state, self.set_state = self._get_state, self._set_state

    def reset(self, *, seed: Any = None, options: Any = None):
        self.random = np.random.default_rng(seed)
        self._begin(np.ones(self.num_envs, dtype=bool))
        return self._obs(), {}

    def step(self, actions: Any):
        self.total += 1
        push = (np.asarray(actions)[:, 0] - 1) * 0.2
        self.position = self.position + push + 0.1 * self.random.standard_normal(self.num_envs)
        self.clock = self.clock + 1
        terminated = np.abs(self.position) > 1
        truncated = (self.clock >= 20) & ~terminated
        reward, cost = self.position.copy(), terminated.astype(np.float64)
        info: dict[str, Any] = {
            "cost": cost,
            "costs": np.stack([cost * (self.position > 0), cost * (self.position < 0)], 1),
        }
        done = terminated | truncated
        if done.any():
            last = self._obs()
            info["final_obs"] = np.full(self.num_envs, None, dtype=object)
            for env in np.flatnonzero(done):
                info["final_obs"][env] = last[env]
            self._begin(done)
        obs = self._obs()
        if self.poison is not None and self.total == self.poison[1]:
            places = {"observation": obs[0], "reward": reward, "cost": cost, "costs": info["costs"][0]}
            places[self.poison[0]][0] = np.nan
        return obs, reward, terminated, truncated, info

    def _begin(self, which: np.ndarray) -> None:
        self.position = np.where(which, self.random.uniform(-0.5, 0.5, self.num_envs), self.position)
        self.clock = np.where(which, 0, self.clock)

    def _obs(self) -> np.ndarray:
        return np.stack([self.position, self.position**2, self.clock / 20], 1).astype(np.float32)

    def _get_state(self) -> dict[str, Any]:
        return {"position": self.position, "clock": self.clock, "random": self.random.bit_generator.state}

    def _set_state(self, state: dict[str, Any]) -> None:
        self.position, self.clock = np.array(state["position"]), np.array(state["clock"])
        self.random.bit_generator.state = state["random"]


class Pictures(VectorEnv):
    """N grey images 4x4 whose level says environment and step; environments end in turn, SAME_STEP."""

    def __init__(self, num_envs: int = 3) -> None:
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}
        self.num_envs, self.at = num_envs, 0
        self.single_observation_space = gym.spaces.Box(0, 255, (4, 4, 1), np.uint8)
        self.single_action_space = gym.spaces.Discrete(2)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(self, *, seed: Any = None, options: Any = None):
        self.at = 0
        return self._images(0), {}

    def step(self, actions: Any):
        self.at += 1
        done = np.arange(self.num_envs) == self.at % self.num_envs
        info: dict[str, Any] = {
            "cost": done.astype(np.float64),
            "final_obs": np.full(self.num_envs, None, dtype=object),
        }
        for env in np.flatnonzero(done):
            info["final_obs"][env] = self._images(100)[env]
        return self._images(0), np.ones(self.num_envs), done, np.zeros_like(done), info

    def pilot_actions(self) -> np.ndarray:
        return np.full(self.num_envs, self.at)

    def _images(self, offset: int) -> np.ndarray:
        level = offset + 10 * np.arange(self.num_envs) + self.at
        return np.broadcast_to(level[:, None, None, None], (self.num_envs, 4, 4, 1)).astype(np.uint8)


class ToldWalk(Walk):
    """Walkers whose critics are told the square of the position and what is left of the clock."""

    def __init__(self, *args: Any, **settings: Any) -> None:
        super().__init__(*args, **settings)
        self.single_critic_space = gym.spaces.Box(-np.inf, np.inf, (2,), np.float32)

    def reset(self, **given: Any):
        obs, info = super().reset(**given)
        return obs, info | {"critic_obs": self.told(obs)}

    def step(self, actions: Any):
        obs, reward, terminated, truncated, info = super().step(actions)
        info["critic_obs"] = self.told(obs)
        done = terminated | truncated
        if done.any():
            last = np.zeros_like(info["critic_obs"])
            last[done] = self.told(np.stack(info["final_obs"][done].tolist()))
            info["final_info"] = {"critic_obs": last, "_critic_obs": done}
        return obs, reward, terminated, truncated, info

    @staticmethod
    def told(obs: np.ndarray) -> np.ndarray:
        return np.stack([obs[:, 0] ** 2, 1 - obs[:, 2]], 1)
