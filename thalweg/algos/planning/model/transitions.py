"""Transitions of rollouts and their replay buffer, which a model is fitted to.

What is kept are observations of numbers (latents on the river), never images. Letters: T steps, N environments, B
transitions, K frames seen side by side of D numbers each, A numbers of a raw action, C costs.
"""

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from thalweg.algos.common.state import CPU, array_of, tensor_of
from thalweg.algos.interface import Rollout


@dataclass(frozen=True)
class Batch:
    """B transitions; or B for each of M models, with a dimension more in front."""

    obs: Tensor
    """[B, K * D], raw."""
    actions: Tensor
    """[B, A], raw."""
    rewards: Tensor
    """[B], of all steps that the decision was carried out for."""
    costs: Tensor
    """[B, C]."""
    next_frame: Tensor
    """[B, D], the newest frame afterwards: the last one of an episode that ended, whichever way."""
    terminated: Tensor
    """[B] bool: nothing comes after. Not where the clock ran out."""

    @property
    def next_obs(self) -> Tensor:
        """[B, K * D]."""
        return torch.cat([self.obs[..., self.next_frame.shape[-1] :], self.next_frame], -1)


class TransitionBuilder:
    """Makes transitions of the steps of rollouts; with an action repeat, each of several steps."""

    def __init__(self, num_envs: int, repeat: int, *, drop_terminal: bool, device: torch.device = CPU) -> None:
        self.num_envs, self.repeat, self.drop_terminal = num_envs, repeat, drop_terminal
        self._count = torch.zeros(num_envs, dtype=torch.int64, device=device)
        """[N] steps since the decision that is being carried out."""
        self._begun: dict[str, Tensor] = {}
        """What was seen and done then, and sums since: obs [N, K * D], actions [N, A], rewards [N], costs [N, C]."""

    def transitions(self, rollout: Rollout, frame: int) -> Batch:
        """Every decision of which the last step lies in the rollout, in order; `frame`: D.

        A step that only reset an environment is none.
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
        parts = [vars(self._step(rollout, next_frames, over, step)) for step in range(len(rollout.rewards))]
        return Batch(**{name: torch.cat([part[name] for part in parts]) for name in parts[0]})

    def _step(self, rollout: Rollout, next_frames: Tensor, over: Tensor, step: int) -> Batch:
        """The decisions that step completes; one that was cut off with its episode between two rollouts is dropped."""
        self._count = torch.where(rollout.fresh[step], 0, self._count)
        first = (self._count == 0) & rollout.valid[step]
        now = {"obs": rollout.obs[step], "actions": rollout.actions[step]}
        if not self._begun:
            self._begun = {name: value.clone() for name, value in now.items()}
            self._begun |= {name: torch.zeros_like(getattr(rollout, name)[0]) for name in ("rewards", "costs")}
        begun = self._begun
        for name, value in now.items():
            begun[name] = torch.where(first.unsqueeze(-1), value, begun[name])
        begun["rewards"] = torch.where(first, 0.0, begun["rewards"]) + rollout.rewards[step] * rollout.valid[step]
        begun["costs"] = torch.where(first.unsqueeze(-1), 0.0, begun["costs"])
        begun["costs"] = begun["costs"] + rollout.costs[step] * rollout.valid[step].unsqueeze(-1)
        self._count += rollout.valid[step]
        whole = rollout.valid[step] & (over[step] | (self._count == self.repeat))
        self._count = torch.where(whole, 0, self._count)
        kept = whole & ~over[step] if self.drop_terminal else whole
        summed = {name: value[kept] for name, value in begun.items()}
        return Batch(**summed, next_frame=next_frames[step][kept], terminated=rollout.terminated[step][kept])

    def state(self) -> dict[str, Any]:
        """What it remembers, as arrays."""
        return {name: array_of(value) for name, value in {"count": self._count, **self._begun}.items()}

    def load_state(self, state: dict[str, Any]) -> None:
        """The inverse of `state`."""
        tensors = {name: tensor_of(value, self._count.device) for name, value in state.items()}
        self._count = tensors.pop("count")
        self._begun = tensors


class ReplayBuffer:
    """The last transitions, in a ring that grows as it fills.

    One in so many stays out of fitting: the first of each block, wherever it lies, so that no draw decides.
    """

    def __init__(self, capacity: int, hold_out: float, device: torch.device = CPU) -> None:
        self.device, self.capacity, self.block = device, capacity, max(2, round(1.0 / hold_out))
        self.size, self._at = 0, 0
        self._fields: dict[str, Tensor] = {}

    def add(self, batch: Batch) -> None:
        """Take in B transitions; the oldest make room."""
        new = vars(batch)
        count = len(batch.rewards)
        if not count:
            return
        if count > self.capacity:
            new, count = {name: value[-self.capacity :] for name, value in new.items()}, self.capacity
        self._make_room(min(self.capacity, self.size + count), new)
        places = (self._at + torch.arange(count, device=self.device)) % self.capacity
        for name, value in new.items():
            self._fields[name][places] = value
        self._at = (self._at + count) % self.capacity
        self.size = min(self.capacity, self.size + count)

    def rows(self, places: Tensor) -> Batch:
        """The transitions at places [...] int64."""
        return Batch(**{name: field[places] for name, field in self._fields.items()})

    def places(self, shape: tuple[int, ...], generator: torch.Generator) -> Tensor:
        """Random places to fit to, with replacement."""
        fitted = self.size - self.held_out_count
        if fitted < 1:
            return torch.zeros(shape, dtype=torch.int64, device=self.device)
        drawn = torch.randint(fitted, shape, generator=generator, device=self.device)
        return drawn // (self.block - 1) * self.block + 1 + drawn % (self.block - 1)

    @property
    def held_out_count(self) -> int:
        return -(-self.size // self.block)

    def held_out(self) -> Batch:
        """Those that are not fitted to."""
        return self.rows(torch.arange(0, self.size, self.block, device=self.device))

    def fitted(self) -> Tensor:
        """Places of all those that are."""
        places = torch.arange(self.size, device=self.device)
        return places[places % self.block != 0]

    def state(self) -> dict[str, Any]:
        """Its filled part, as arrays."""
        return {"size": self.size, "at": self._at} | {
            name: array_of(field[: self.size]) for name, field in self._fields.items()
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """The inverse of `state`."""
        self.size, self._at = int(state["size"]), int(state["at"])
        self._fields = {
            name: tensor_of(value, self.device) for name, value in state.items() if name not in ("size", "at")
        }

    def _make_room(self, needed: int, like: dict[str, Tensor]) -> None:
        room = len(self._fields["rewards"]) if self._fields else 0
        if room >= needed:
            return
        room = min(self.capacity, max(needed, 2 * room, 4096))
        old = self._fields
        self._fields = {name: value.new_zeros(room, *value.shape[1:]) for name, value in like.items()}
        for name, field in old.items():
            self._fields[name][: self.size] = field[: self.size]
