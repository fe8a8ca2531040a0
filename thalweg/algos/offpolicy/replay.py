"""Which steps are remembered, and how are some of them drawn? A ring of rows, one step each.

Everything of a step lies in one row, so that a batch is one gather. Rows hold raw observations: what standardises them
may change after they were stored. Letters: R rows, B of a batch, D numbers seen, W of a coded action, M costs.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from thalweg.algos.common.errors import AlgorithmError, require_finite
from thalweg.algos.common.state import CPU, array_of, tensor_of
from thalweg.algos.interface import Rollout

AT_ONCE = 64
"""Batches that are gathered together at most."""


@dataclass(frozen=True)
class Batch:
    """B remembered steps: views of one gathered matrix."""

    obs: Tensor
    """[B, D], normalised."""
    actions: Tensor
    """[B, W], coded."""
    pairs: Tensor
    """[B, D + W], both side by side."""
    next_obs: Tensor
    """[B, D], normalised: what the step led to, at an episode's end its last observation."""
    paid: Tensor
    """[1 + M, B], the reward and then the costs."""
    going_on: Tensor
    """[B], 0 where the episode ended by itself, else 1; being cut off is no end."""


class Replay:
    """The last `size` steps."""

    def __init__(self, size: int, obs: int, action: int, costs: int, device: torch.device = CPU) -> None:
        """Room for `size` steps with `obs` numbers seen, `action` of a coded action and so many costs; memory is taken
        as it fills."""
        self.size, self._obs, self._action, self._paid = size, obs, action, 1 + costs
        self.rows = torch.empty(size, 2 * obs + action + 1 + costs + 1, device=device)
        """[R, ...] observation, action, next observation, reward, costs, going on."""
        self.filled, self._next = 0, 0

    def add(self, obs: Tensor, actions: Tensor, next_obs: Tensor, paid: Tensor, going_on: Tensor) -> None:
        """Remember steps: [S, D], [S, W], [S, D], [S, 1 + M] and [S], the oldest forgotten for them.

        Raises `NotFiniteError` for NaN or infinity.
        """
        rows = torch.cat([obs, actions, next_obs, paid, going_on.unsqueeze(1)], 1)[-self.size :]
        require_finite(**{"what was paid": float(paid.sum()), "the replay": float(rows.sum())})
        before_the_end = rows[: self.size - self._next]
        after_it = rows[len(before_the_end) :]
        self.rows[self._next : self._next + len(before_the_end)] = before_the_end
        self.rows[: len(after_it)] = after_it
        self._next = (self._next + len(rows)) % self.size
        self.filled = min(self.filled + len(rows), self.size)

    def batches(
        self, count: int, size: int, generator: torch.Generator, normalise: Callable[[Tensor], Tensor]
    ) -> Iterator[Tensor]:
        """The rows of so many batches of `size` steps, each drawn uniformly with replacement."""
        while count > 0:
            now = min(count, AT_ONCE)
            drawn = torch.randint(self.filled, (now * size,), generator=generator, device=self.rows.device)
            rows = self.rows.index_select(0, drawn)
            after = self._obs + self._action
            for seen in (rows[:, : self._obs], rows[:, after : after + self._obs]):
                seen.copy_(normalise(seen))
            yield from rows.split(size)
            count -= now

    def batch(self, rows: Tensor) -> Batch:
        """What rows hold, as views of them."""
        obs, actions, next_obs, paid, going_on = rows.split([self._obs, self._action, self._obs, self._paid, 1], 1)
        return Batch(obs, actions, rows[:, : self._obs + self._action], next_obs, paid.T, going_on[:, 0])

    def state(self) -> dict[str, Any]:
        """Arrays: the filled part only."""
        return {"rows": array_of(self.rows[: self.filled]), "next": self._next}

    def load_state(self, state: dict[str, Any]) -> None:
        """The inverse of `state`; raises `AlgorithmError` for rows of another width or too many."""
        rows = np.asarray(state["rows"])
        if rows.shape[1] != self.rows.shape[1] or len(rows) > self.size:
            raise AlgorithmError(f"a replay of {tuple(self.rows.shape)} can't take rows of {rows.shape}")
        self.filled, self._next = len(rows), int(state["next"])
        self.rows[: self.filled] = tensor_of(rows, self.rows.device)


def steps_of(rollout: Rollout) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """What a rollout's valid steps add: observations [S, D], raw actions [S, A], next observations [S, D], rewards and
    costs [S, 1 + M], and whether the episode goes on [S], as numbers.

    The observation after an episode's end is its last one, never the first of the next episode.
    """
    next_obs = rollout.obs[1:].flatten(0, 1).clone()
    next_obs[rollout.final_index] = rollout.final_obs
    keep = rollout.valid.flatten().nonzero().squeeze(-1)
    paid = torch.cat([rollout.rewards.unsqueeze(-1), rollout.costs], -1)
    return (
        rollout.obs[:-1].flatten(0, 1)[keep],
        rollout.actions.flatten(0, 1)[keep],
        next_obs[keep],
        paid.flatten(0, 1)[keep],
        (~rollout.terminated).flatten()[keep].float(),
    )
