"""Where the steps of one policy wait until there are enough to learn from."""

import numpy as np
import torch
from torch import Tensor

from thalweg.algos.common.state import CPU
from thalweg.algos.interface import Rollout
from thalweg.train.errors import TrainingError
from thalweg.train.rollouts.stream import Step


class RolloutBuffer:
    """T steps of N environments, written in place: nothing is allocated while steps come in."""

    def __init__(
        self, steps: int, obs: np.ndarray, actions: Tensor, costs: np.ndarray, device: torch.device = CPU
    ) -> None:
        """Room for `steps` steps like the given one: observations [N, K * D], raw actions [N, A], costs [N, M].

        `device` is where rollouts are wanted.
        """
        self.steps, self.filled, self.device = steps, 0, device
        num_envs = len(obs)
        self._tensors = {
            "obs": torch.zeros(steps + 1, num_envs, obs.shape[1]),
            "fresh": torch.zeros(steps + 1, num_envs, dtype=torch.bool),
            "actions": torch.zeros(steps, num_envs, actions.shape[1], dtype=actions.dtype),
            "rewards": torch.zeros(steps, num_envs),
            "costs": torch.zeros(steps, num_envs, costs.shape[1]),
            "terminated": torch.zeros(steps, num_envs, dtype=torch.bool),
            "truncated": torch.zeros(steps, num_envs, dtype=torch.bool),
            "valid": torch.zeros(steps, num_envs, dtype=torch.bool),
        }
        self._arrays = {name: tensor.numpy() for name, tensor in self._tensors.items()}
        self._ends: list[tuple[int, np.ndarray]] = []
        """Place t * N + n and last observation of each step that ended an episode."""

    def add(self, obs: np.ndarray, fresh: np.ndarray, actions: Tensor, step: Step, costs: np.ndarray) -> None:
        """Take in observations [N, K * D], of which `fresh` [N] begin an episode, raw actions [N, A], what they led
        to, and the costs [N, M] that are learnt from."""
        at, arrays = self.filled, self._arrays
        arrays["obs"][at] = obs
        arrays["obs"][at + 1] = step.next_obs
        arrays["fresh"][at] = fresh
        arrays["fresh"][at + 1] = step.fresh
        arrays["actions"][at] = actions.cpu().numpy()
        arrays["rewards"][at] = step.reward
        arrays["costs"][at] = costs
        arrays["terminated"][at] = step.terminated
        arrays["truncated"][at] = step.truncated
        arrays["valid"][at] = step.valid
        for env, final in zip(step.finished, step.final_obs, strict=True):
            self._ends.append((at * len(obs) + int(env), final))
        self.filled += 1

    def rollout(self) -> Rollout:
        """The steps so far; on the CPU views of this buffer, to be used before the next `add`."""
        if not self.filled:
            raise TrainingError("there are no steps to learn from")
        size = self._tensors["obs"].shape[2]
        final = np.stack([obs for _, obs in self._ends]) if self._ends else np.zeros((0, size), np.float32)
        index = torch.tensor([place for place, _ in self._ends], dtype=torch.int64)
        tensors = {name: tensor[: self.filled + (name in ("obs", "fresh"))] for name, tensor in self._tensors.items()}
        tensors |= {"final_index": index, "final_obs": torch.from_numpy(final)}
        return Rollout(**{name: tensor.to(self.device) for name, tensor in tensors.items()})

    def clear(self) -> None:
        """Make room for the next rollout."""
        self.filled = 0
        self._ends.clear()
