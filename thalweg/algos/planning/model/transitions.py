"""Transitions of rollouts, and the replay buffer of transitions that the model is fitted to.

Observations are vectors (latents on the river), never images. Dimensions: T steps, N environments, B transitions, K
stacked frames of D numbers, A numbers of a raw action, C costs.
"""

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from thalweg.algos.common.state import CPU, array_of, tensor_of
from thalweg.algos.interface import Rollout


@dataclass(frozen=True)
class Batch:
    """B transitions, or [M, B] transitions for M models."""

    obs: Tensor
    """[B, K * D], not normalised."""
    actions: Tensor
    """[B, A], raw actions."""
    rewards: Tensor
    """[B], sums over the steps that the action was repeated for."""
    costs: Tensor
    """[B, C], sums over the same steps."""
    next_frame: Tensor
    """[B, D], newest frame after the transition; at the end of an episode its final frame, not that of the reset."""
    terminated: Tensor
    """[B] bool; False for truncated episodes."""

    @property
    def next_obs(self) -> Tensor:
        """[B, K * D], observations after the transitions."""
        return torch.cat([self.obs[..., self.next_frame.shape[-1] :], self.next_frame], -1)


class TransitionBuilder:
    """Converts the steps of rollouts to transitions; with an action repeat, a transition spans several steps."""

    def __init__(self, num_envs: int, repeat: int, *, drop_terminal: bool, device: torch.device = CPU) -> None:
        self.num_envs, self.repeat, self.drop_terminal = num_envs, repeat, drop_terminal
        self._count = torch.zeros(num_envs, dtype=torch.int64, device=device)
        """[N], steps of the pending transition so far."""
        self._pending: dict[str, Tensor] = {}
        """Pending transitions: first obs [N, K * D] and actions [N, A], summed rewards [N] and costs [N, C]."""

    def transitions(self, rollout: Rollout, frame: int) -> Batch:
        """Return the transitions whose last step lies in the rollout, in order; `frame` is D.

        Steps that only reset an environment are skipped.
        """
        next_frames = rollout.obs[1:, :, -frame:].clone()
        next_frames.flatten(0, 1)[rollout.final_index] = rollout.final_obs[:, -frame:]
        over = rollout.terminated | rollout.truncated
        keep = rollout.valid & ~over if self.drop_terminal else rollout.valid
        if self.repeat == 1:
            return Batch(
                rollout.obs[:-1][keep],
                rollout.actions[keep],
                rollout.rewards[keep],
                rollout.costs[keep],
                next_frames[keep],
                rollout.terminated[keep],
            )
        batches = [vars(self._step(rollout, next_frames, over, step)) for step in range(len(rollout.rewards))]
        return Batch(**{name: torch.cat([part[name] for part in batches]) for name in batches[0]})

    def _step(self, rollout: Rollout, next_frames: Tensor, over: Tensor, step: int) -> Batch:
        """Return the transitions that a step completes.

        A pending transition is dropped if its episode was abandoned between two rollouts.
        """
        self._count = torch.where(rollout.fresh[step], 0, self._count)
        first = (self._count == 0) & rollout.valid[step]
        current = {"obs": rollout.obs[step], "actions": rollout.actions[step]}
        if not self._pending:
            self._pending = {name: value.clone() for name, value in current.items()}
            self._pending |= {name: torch.zeros_like(getattr(rollout, name)[0]) for name in ("rewards", "costs")}
        pending = self._pending
        for name, value in current.items():
            pending[name] = torch.where(first.unsqueeze(-1), value, pending[name])
        pending["rewards"] = torch.where(first, 0.0, pending["rewards"]) + rollout.rewards[step] * rollout.valid[step]
        pending["costs"] = torch.where(first.unsqueeze(-1), 0.0, pending["costs"])
        pending["costs"] = pending["costs"] + rollout.costs[step] * rollout.valid[step].unsqueeze(-1)
        self._count += rollout.valid[step]
        complete = rollout.valid[step] & (over[step] | (self._count == self.repeat))
        self._count = torch.where(complete, 0, self._count)
        selected = complete & ~over[step] if self.drop_terminal else complete
        summed = {name: value[selected] for name, value in pending.items()}
        return Batch(**summed, next_frame=next_frames[step][selected], terminated=rollout.terminated[step][selected])

    def state(self) -> dict[str, Any]:
        """Return the pending transitions, as arrays."""
        return {name: array_of(value) for name, value in {"count": self._count, **self._pending}.items()}

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        tensors = {name: tensor_of(value, self._count.device) for name, value in state.items()}
        self._count = tensors.pop("count")
        self._pending = tensors


class ReplayBuffer:
    """Ring buffer of the most recent transitions, which grows as it fills.

    The first transition of each block of `block` rows is held out of fitting; the choice is not random.
    """

    def __init__(self, capacity: int, hold_out: float, device: torch.device = CPU) -> None:
        self.device, self.capacity, self.block = device, capacity, max(2, round(1.0 / hold_out))
        self.size, self._next_row = 0, 0
        self._fields: dict[str, Tensor] = {}

    def add(self, batch: Batch) -> None:
        """Add B transitions; the oldest ones are overwritten when the buffer is full."""
        new = vars(batch)
        count = len(batch.rewards)
        if not count:
            return
        if count > self.capacity:
            new, count = {name: value[-self.capacity :] for name, value in new.items()}, self.capacity
        self._grow(min(self.capacity, self.size + count), new)
        indices = (self._next_row + torch.arange(count, device=self.device)) % self.capacity
        for name, value in new.items():
            self._fields[name][indices] = value
        self._next_row = (self._next_row + count) % self.capacity
        self.size = min(self.capacity, self.size + count)

    def rows(self, indices: Tensor) -> Batch:
        """Return the transitions with indices [...] int64."""
        return Batch(**{name: field[indices] for name, field in self._fields.items()})

    def sample_indices(self, shape: tuple[int, ...], generator: torch.Generator) -> Tensor:
        """Return random indices of transitions to fit to, sampled with replacement."""
        fitted = self.size - self.held_out_count
        if fitted < 1:
            return torch.zeros(shape, dtype=torch.int64, device=self.device)
        random = torch.randint(fitted, shape, generator=generator, device=self.device)
        return random // (self.block - 1) * self.block + 1 + random % (self.block - 1)

    @property
    def held_out_count(self) -> int:
        """Number of held-out transitions."""
        return -(-self.size // self.block)

    def held_out(self) -> Batch:
        """Return the held-out transitions."""
        return self.rows(torch.arange(0, self.size, self.block, device=self.device))

    def training_indices(self) -> Tensor:
        """Return indices of all transitions that are not held out."""
        indices = torch.arange(self.size, device=self.device)
        return indices[indices % self.block != 0]

    def state(self) -> dict[str, Any]:
        """Return the filled part of the buffer, as arrays."""
        return {"size": self.size, "at": self._next_row} | {
            name: array_of(field[: self.size]) for name, field in self._fields.items()
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        self.size, self._next_row = int(state["size"]), int(state["at"])
        self._fields = {
            name: tensor_of(value, self.device) for name, value in state.items() if name not in ("size", "at")
        }

    def _grow(self, needed: int, like: dict[str, Tensor]) -> None:
        """Allocate at least `needed` rows, doubling the buffer up to its capacity."""
        allocated = len(self._fields["rewards"]) if self._fields else 0
        if allocated >= needed:
            return
        allocated = min(self.capacity, max(needed, 2 * allocated, 4096))
        old = self._fields
        self._fields = {name: value.new_zeros(allocated, *value.shape[1:]) for name, value in like.items()}
        for name, field in old.items():
            self._fields[name][: self.size] = field[: self.size]
