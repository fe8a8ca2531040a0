"""Rollout buffers: the steps of one policy, from arrays on the host or from tensors on a device, until a learner uses
them."""

import numpy as np
import torch
from torch import Tensor

from thalweg.algos.common.state import CPU
from thalweg.algos.interface import Rollout
from thalweg.train.errors import TrainingError
from thalweg.train.rollouts.env_stepper import EnvStep


class RolloutBuffer:
    """T steps of N environments on the host, written in place: no memory is allocated while steps arrive."""

    def __init__(
        self,
        steps: int,
        obs: np.ndarray,
        actions: Tensor,
        costs: np.ndarray,
        device: torch.device = CPU,
        critic_obs: np.ndarray | None = None,
    ) -> None:
        """Allocate memory for `steps` steps with the shapes of observations [N, K * D], raw actions [N, A], costs
        [N, M] and, unless it is None, what only critics see [N, C].

        `device` is that of the rollouts.
        """
        self.steps, self.filled, self.device = steps, 0, device
        num_envs = len(obs)
        self._tensors = {
            "obs": torch.zeros(steps + 1, num_envs, obs.shape[1], dtype=torch.from_numpy(obs).dtype),
            "fresh": torch.zeros(steps + 1, num_envs, dtype=torch.bool),
            "actions": torch.zeros(steps, num_envs, actions.shape[1], dtype=actions.dtype),
            "rewards": torch.zeros(steps, num_envs, dtype=torch.float32),
            "costs": torch.zeros(steps, num_envs, costs.shape[1], dtype=torch.float32),
            "terminated": torch.zeros(steps, num_envs, dtype=torch.bool),
            "truncated": torch.zeros(steps, num_envs, dtype=torch.bool),
            "valid": torch.zeros(steps, num_envs, dtype=torch.bool),
        }
        if critic_obs is not None:
            self._tensors["critic_obs"] = torch.zeros(steps + 1, num_envs, critic_obs.shape[1], dtype=torch.float32)
        self._arrays = {name: tensor.numpy() for name, tensor in self._tensors.items()}
        self._ends: list[tuple[int, np.ndarray]] = []
        """Index t * N + n and last observation of each step that ended an episode."""
        self._critic_ends: list[np.ndarray] = []
        """What critics see beside each of them."""

    def add(
        self,
        obs: np.ndarray,
        fresh: np.ndarray,
        actions: Tensor,
        step: EnvStep,
        costs: np.ndarray,
        critic_obs: np.ndarray | None = None,
    ) -> None:
        """Add a step: observations [N, K * D], of which `fresh` [N] start an episode, raw actions [N, A], their result,
        the costs [N, M] to learn from, and what critics see beside the observations [N, C]."""
        t, arrays = self.filled, self._arrays
        arrays["obs"][t] = obs
        arrays["obs"][t + 1] = step.next_obs
        arrays["fresh"][t] = fresh
        arrays["fresh"][t + 1] = step.fresh
        arrays["actions"][t] = actions.cpu().numpy()
        arrays["rewards"][t] = step.reward
        arrays["costs"][t] = costs
        arrays["terminated"][t] = step.terminated
        arrays["truncated"][t] = step.truncated
        arrays["valid"][t] = step.valid
        for env, final in zip(step.finished, step.final_obs, strict=True):
            self._ends.append((t * len(obs) + int(env), final))
        if critic_obs is not None and step.final_critic_obs is not None:
            arrays["critic_obs"][t] = critic_obs
            arrays["critic_obs"][t + 1] = step.critic_obs
            self._critic_ends.extend(step.final_critic_obs)
        self.filled += 1

    def rollout(self) -> Rollout:
        """Return the steps so far; on the CPU as views of this buffer, valid until the next `add`."""
        if not self.filled:
            raise TrainingError("there are no steps to learn from")
        index = torch.tensor([index for index, _ in self._ends], dtype=torch.int64)
        states = ("obs", "fresh", "critic_obs")  # one more than steps
        tensors = {name: tensor[: self.filled + (name in states)] for name, tensor in self._tensors.items()}
        tensors |= {"final_index": index, "final_obs": self._rows("obs", [obs for _, obs in self._ends])}
        if "critic_obs" in tensors:
            tensors["final_critic_obs"] = self._rows("critic_obs", self._critic_ends)
        return Rollout(**{name: tensor.to(self.device) for name, tensor in tensors.items()})

    def clear(self) -> None:
        """Discard the steps before the next rollout."""
        self.filled = 0
        self._ends.clear()
        self._critic_ends.clear()

    def _rows(self, name: str, rows: list[np.ndarray]) -> Tensor:
        """Return rows [F, ...] with the size of a tensor's."""
        like = self._tensors[name]
        return torch.from_numpy(np.stack(rows)) if rows else like.new_zeros(0, like.shape[2])


class TensorRolloutBuffer:
    """T steps of N environments, written in place on their device."""

    def __init__(
        self,
        steps: int,
        obs: Tensor,
        fresh: Tensor,
        actions: Tensor,
        costs: Tensor,
        critic_obs: Tensor | None = None,
    ) -> None:
        """Allocate memory for `steps` steps with the shapes of observations [N, K * D], of which `fresh` [N] start an
        episode, raw actions [N, A], costs [N, M] and, unless it is None, what only critics see [N, C]."""
        count, device = len(obs), obs.device
        self.steps, self.filled = steps, 0
        self.obs, self.fresh = obs.new_zeros(steps + 1, *obs.shape), fresh.new_zeros(steps + 1, count)
        self.critic_obs = None if critic_obs is None else critic_obs.new_zeros(steps + 1, *critic_obs.shape)
        self.samples = {
            "actions": actions.new_zeros(steps, *actions.shape),
            "rewards": obs.new_zeros(steps, count),
            "costs": obs.new_zeros(steps, *costs.shape),
            **{name: fresh.new_zeros(steps, count) for name in ("terminated", "truncated", "valid")},
        }
        """The tensors of a `Rollout` [T, N, ...]."""
        kinds = {"reward": torch.float64, "cost": torch.float64, "tight": torch.float64, "loose": torch.float64}
        self.records = {
            name: torch.zeros(steps, count, dtype=kind, device=device)
            for name, kind in (kinds | {"reasons": torch.int64}).items()
        }
        """Values [T, N] that only the statistics of episodes need, in float64."""

    def start(self, obs: Tensor, fresh: Tensor, critic_obs: Tensor | None = None) -> None:
        """Start a rollout with the observations of its first step, and what critics see beside them."""
        self.filled = 0
        self._set(obs, fresh, critic_obs)

    def add(
        self,
        next_obs: Tensor,
        fresh: Tensor,
        samples: dict[str, Tensor],
        records: dict[str, Tensor],
        critic_obs: Tensor | None = None,
    ) -> None:
        """Add the result of a step [N, ...]."""
        for name, tensor in samples.items():
            self.samples[name][self.filled] = tensor
        for name, tensor in records.items():
            self.records[name][self.filled] = tensor
        self.filled += 1
        self._set(next_obs, fresh, critic_obs)

    def _set(self, obs: Tensor, fresh: Tensor, critic_obs: Tensor | None) -> None:
        """Write the observations of the next step."""
        self.obs[self.filled], self.fresh[self.filled] = obs, fresh
        if self.critic_obs is not None and critic_obs is not None:
            self.critic_obs[self.filled] = critic_obs

    def rollout(self) -> Rollout:
        """Return views of the steps so far.

        `final_obs` is empty: in NEXT_STEP mode the observation after an episode's last step is its last observation;
        so is what critics see.
        """
        samples = {name: tensor[: self.filled] for name, tensor in self.samples.items()}
        none = torch.zeros(0, dtype=torch.int64, device=self.obs.device)
        obs, fresh = self.obs[: self.filled + 1], self.fresh[: self.filled + 1]
        critics = {}
        if self.critic_obs is not None:
            seen = self.critic_obs[: self.filled + 1]
            critics = {"critic_obs": seen, "final_critic_obs": seen.new_zeros(0, seen.shape[2])}
        final_obs = self.obs.new_zeros(0, obs.shape[2])
        return Rollout(obs=obs, fresh=fresh, **samples, final_index=none, final_obs=final_obs, **critics)
