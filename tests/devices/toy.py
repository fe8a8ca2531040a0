"""A small walk of tensors on any device, and the same walk as a Gymnasium vector environment."""

from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from torch import Tensor

from thalweg.algos.common.state import array_of, tensor_of

SPACES = {
    "MultiDiscrete": gym.spaces.MultiDiscrete([3, 3]),
    "Discrete": gym.spaces.Discrete(3),
    "Box": gym.spaces.Box(-1.0, 1.0, (2,), np.float32),
}
GOAL, SIZE = 6.0, 3


class TensorWalk:
    """Environment i walks by its first action from 0 to `GOAL`, and is cut off after 5 + i % 4 steps.

    It earns how far it went, and an action of the largest number costs 1, tight on odd steps and loose on even ones.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012
    done_reasons = {0: "Arrived", 1: "Late"}  # noqa: RUF012

    def __init__(self, num_envs: int, space: gym.Space, device: torch.device) -> None:
        self.num_envs, self.device, self.single_action_space = num_envs, device, space
        self.single_observation_space = gym.spaces.Box(-np.inf, np.inf, (SIZE,), np.float32)
        self.place = torch.zeros(num_envs, dtype=torch.float64, device=device)
        self.steps = torch.zeros(num_envs, dtype=torch.int64, device=device)
        self.ended = torch.zeros(num_envs, dtype=torch.bool, device=device)
        self.most = 5 + torch.arange(num_envs, device=device) % 4

    @property
    def unwrapped(self) -> "TensorWalk":
        return self

    def reset(self, *, seed: int) -> tuple[Tensor, dict[str, Tensor]]:
        for tensor in (self.place, self.steps, self.ended):
            tensor.zero_()
        return self.observed(), {}

    def step(self, actions: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, dict[str, Tensor]]:
        first = actions.double().reshape(self.num_envs, -1)[:, 0]
        move = first.clamp(-1.0, 1.0) + 1.0 if isinstance(self.single_action_space, gym.spaces.Box) else first
        again = self.ended
        move = torch.where(again, 0.0, move)
        self.place = torch.where(again, 0.0, self.place) + move
        self.steps = torch.where(again, 0, self.steps + 1)
        terminated = (self.place >= GOAL) & ~again
        truncated = (self.steps >= self.most) & ~again & ~terminated
        self.ended = terminated | truncated
        cost = (move > 1.9).double()
        odd = self.steps % 2
        info = {
            "cost": cost,
            "costs": torch.stack([cost * odd, cost * (1 - odd)], 1),
            "done_reason": torch.where(terminated, 0, torch.where(truncated, 1, -1)),
        }
        return self.observed(), move, terminated, truncated, info

    def observed(self) -> Tensor:
        parts = [self.place, self.steps.double(), self.most.double()]
        return torch.stack(parts, 1).float()

    def get_state(self) -> dict[str, np.ndarray]:
        return {name: array_of(getattr(self, name)) for name in ("place", "steps", "ended")}

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        for name, array in state.items():
            setattr(self, name, tensor_of(array, self.device))


class ArrayWalk(VectorEnv):
    """The same, of arrays."""

    def __init__(self, num_envs: int, space: gym.Space) -> None:
        self.walk = TensorWalk(num_envs, space, torch.device("cpu"))
        self.metadata, self.num_envs, self.done_reasons = self.walk.metadata, num_envs, self.walk.done_reasons
        self.single_action_space, self.single_observation_space = space, self.walk.single_observation_space
        self.action_space = batch_space(space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[np.ndarray, dict[str, Any]]:
        return self.walk.reset(seed=0)[0].numpy(), {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        *found, info = self.walk.step(torch.from_numpy(np.asarray(actions)))
        obs, reward, terminated, truncated = (tensor.numpy() for tensor in found)
        return obs, reward, terminated, truncated, {name: value.numpy() for name, value in info.items()}

    def get_state(self) -> dict[str, np.ndarray]:
        return self.walk.get_state()

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        self.walk.set_state(state)
