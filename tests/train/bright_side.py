"""A problem of images whose optimum is known: one side of the image is bright, and only the option for it pays."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

SIZE, STEPS = 8, 4


class BrightSide(VectorEnv):
    """N episodes of four steps. The option of the first branch should be the bright side, or with `recall` the side
    that was bright in the first step, after which images are grey; a wrong one costs 1.

    The second branch does nothing. Critics are told the side and the step.
    """

    def __init__(self, num_envs: int = 8, recall: bool = False) -> None:
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}
        self.num_envs, self.recall = num_envs, recall
        self.single_observation_space = gym.spaces.Box(0, 255, (SIZE, SIZE, 1), np.uint8)
        self.single_action_space = gym.spaces.MultiDiscrete([2, 2])
        self.single_critic_space = gym.spaces.Box(-np.inf, np.inf, (2,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.random = np.random.default_rng(0)
        self.side, self.at = np.zeros(num_envs, np.int64), np.zeros(num_envs, np.int64)
        self.total = 0

    def reset(self, *, seed: Any = None, options: Any = None):
        self.random = np.random.default_rng(seed)
        self.at = np.arange(self.num_envs) % STEPS if not self.recall else np.zeros(self.num_envs, np.int64)
        self.side = self.random.integers(2, size=self.num_envs)
        return self.images(), {"critic_obs": self.told()}

    def step(self, actions: Any):
        self.total += 1
        right = np.asarray(actions)[:, 0] == self.side
        self.at = self.at + 1
        done = self.at == STEPS
        info: dict[str, Any] = {"cost": (~right).astype(np.float64)}
        if done.any():
            last, told = self.images(), self.told()
            info["final_obs"] = np.full(self.num_envs, None, dtype=object)
            for env in np.flatnonzero(done):
                info["final_obs"][env] = last[env]
            info["final_info"] = {"critic_obs": told, "_critic_obs": done}
        drawn = self.random.integers(2, size=self.num_envs)
        self.side = np.where(done | (not self.recall), drawn, self.side)
        self.at = np.where(done, 0, self.at)
        info["critic_obs"] = self.told()
        return self.images(), right.astype(np.float64), np.zeros_like(done), done, info

    def images(self) -> np.ndarray:
        images = np.full((self.num_envs, SIZE, SIZE, 1), 100, np.uint8)
        for env in range(self.num_envs):
            if not self.recall or self.at[env] == 0:
                half = slice(0, SIZE // 2) if self.side[env] == 0 else slice(SIZE // 2, SIZE)
                images[env, :, half] = 220
        return images

    def told(self) -> np.ndarray:
        return np.stack([self.side, self.at], 1).astype(np.float32)

    def get_state(self) -> dict[str, Any]:
        return {"side": self.side, "at": self.at, "random": self.random.bit_generator.state}

    def set_state(self, state: dict[str, Any]) -> None:
        self.side, self.at = np.array(state["side"]), np.array(state["at"])
        self.random.bit_generator.state = state["random"]


class Stop(Exception):
    pass


class StopsAt(BrightSide):
    """Raises in the given vector step, once."""

    def __init__(self, at: int, **settings: Any) -> None:
        super().__init__(**settings)
        self.stop = at

    def step(self, actions: Any):
        if self.total + 1 == self.stop:
            self.stop = 0
            raise Stop
        return super().step(actions)


class OneBrightSide(gym.Env):
    """One episode of three steps at a time, whose image says episode and step; critics are told the step."""

    observation_space = gym.spaces.Box(0, 255, (SIZE, SIZE, 1), np.uint8)
    action_space = gym.spaces.MultiDiscrete([3, 2], start=[1, 0])
    critic_space = gym.spaces.Box(-np.inf, np.inf, (1,), np.float32)

    def __init__(self) -> None:
        self.episode, self.at = -1, 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        self.episode, self.at = self.episode + 1, 0
        return self._image(), self._told()

    def step(self, action: Any):
        self.at += 1
        return self._image(), 1.0, False, self.at == 3, self._told() | {"cost": 0.0}

    def _image(self) -> np.ndarray:
        return np.full((SIZE, SIZE, 1), 10 * self.episode + self.at, np.uint8)

    def _told(self) -> dict[str, Any]:
        return {"critic_obs": np.array([self.at], np.float32)}
