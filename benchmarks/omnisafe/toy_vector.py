"""The toy as a Gymnasium vector environment with autoreset in the same step."""

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from benchmarks.omnisafe.toy import ACTIONS, SIZE, Toy


class ToyVectorEnv(VectorEnv):
    """`num_envs` instances of the toy, with `info["cost"]` [N]."""

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012  as Gymnasium has it

    def __init__(self, num_envs: int = 16) -> None:
        self.num_envs, self.toy = num_envs, Toy(num_envs)
        self.single_observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (SIZE,), np.float32)
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (ACTIONS,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start all episodes; a single seed is incremented from environment to environment."""
        if seed is not None:
            self.toy.seed([seed + row for row in range(self.num_envs)] if isinstance(seed, int) else list(seed))  # pyright: ignore[reportArgumentType]
        self.toy.begin(np.arange(self.num_envs))
        return self.toy.observations(), {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Step all environments; where an episode ends, the next one starts, with `final_obs` in info."""
        reward, cost, terminated, truncated = self.toy.step(actions)
        obs, info = self.toy.observations(), {"cost": cost}
        done = terminated | truncated
        if done.any():
            info |= {"final_obs": obs, "_final_obs": done}
            self.toy.begin(np.flatnonzero(done))
            obs = self.toy.observations()
        return obs, reward, terminated, truncated, info

    def get_state(self) -> dict[str, np.ndarray]:
        """Return everything that the future depends on."""
        return self.toy.state()

    def set_state(self, state: Mapping[str, np.ndarray]) -> None:
        """Continue from a state of `get_state`."""
        self.toy.load_state(dict(state))
