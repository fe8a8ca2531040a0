"""Test that a policy with memory learns a task that needs it: to name a side that was shown earlier.

A policy without memory is right half of the time; one with memory can always be right.
"""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from thalweg.train import run

STEPS = 30_000
MEMORIES: dict[str, dict[str, Any]] = {
    "gru": {"memory": "gru", "memory_size": 16, "sequence": 8},
    "frames": {"frame_stack": 3},
}


class Recall(VectorEnv):
    """N episodes of three steps: the first observation is (side, 1), then (0, 0); the last action should be the
    side."""

    def __init__(self, num_envs: int = 16) -> None:
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}
        self.num_envs = num_envs
        self.single_observation_space = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.single_action_space = gym.spaces.Discrete(2)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(self, *, seed: Any = None, options: Any = None):
        self._random = np.random.default_rng(seed)
        self._at = np.arange(self.num_envs) % 3  # so that episodes do not end all at once
        self._side = self._random.integers(2, size=self.num_envs)
        return self._obs(), {}

    def step(self, actions: Any):
        ended = self._at == 2
        reward = (ended & (np.asarray(actions) == self._side)).astype(np.float64)
        info: dict[str, Any] = {"cost": np.zeros(self.num_envs), "final_obs": np.full(self.num_envs, None, object)}
        for env in np.flatnonzero(ended):
            info["final_obs"][env] = np.zeros(2, np.float32)
        self._at = np.where(ended, 0, self._at + 1)
        self._side = np.where(ended, self._random.integers(2, size=self.num_envs), self._side)
        return self._obs(), reward, ended, np.zeros_like(ended), info

    def _obs(self) -> np.ndarray:
        shown = self._at == 0
        return np.stack([shown * (2.0 * self._side - 1.0), shown], 1).astype(np.float32)


def score(settings: dict[str, Any], folder: Path) -> float:
    """Share of right answers of the last 50 episodes of training and of 600 flown after it."""
    config = {"steps_per_update": 1024, "hidden": [32], "learning_rate": 3e-3, "critic_learning_rate": 3e-3}
    policy = run("PPO", Recall(), steps=STEPS, seed=0, folder=folder, config=config | settings).policy
    env = Recall(600)
    obs, _ = env.reset(seed=1)
    player, fresh, right = policy.player(600, deterministic=True), np.ones(600, dtype=bool), []
    for step in range(6):
        obs, reward, ended, _, _ = env.step(player(obs, fresh))
        if step > 2:
            right += reward[ended].tolist()
        fresh = ended
    return float(np.mean(right))


@pytest.mark.slow
def test_without_a_memory_every_other_answer_is_right(tmp_path: Path):
    assert score({}, tmp_path) == pytest.approx(0.5, abs=0.07)


@pytest.mark.slow
@pytest.mark.parametrize("settings", MEMORIES.values(), ids=list(MEMORIES))
def test_with_a_memory_every_answer_is_right(settings: dict[str, Any], tmp_path: Path):
    assert score(settings, tmp_path) > 0.97
