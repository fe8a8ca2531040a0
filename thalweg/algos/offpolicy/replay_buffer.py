"""Replay buffer of off-policy algorithms: a ring of rows, one environment step each.

Everything about a step lies in one row, so that a batch is one gather. Rows hold raw observations, because the running
statistics that normalise them change after they were stored. Letters: R rows, B batch size, S steps, D numbers of an
observation, A of a raw action, W of an encoded action, M costs.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from thalweg.algos.common.errors import AlgorithmError, require_finite
from thalweg.algos.common.state import CPU, array_of, tensor_of
from thalweg.algos.interface import Rollout

BATCHES_PER_GATHER = 64
"""Largest number of batches that are gathered at once."""


@dataclass(frozen=True)
class Batch:
    """B stored steps: views of one gathered matrix."""

    obs: Tensor
    """[B, D], normalised."""
    actions: Tensor
    """[B, W], encoded."""
    obs_actions: Tensor
    """[B, D + W], both side by side."""
    next_obs: Tensor
    """[B, D], normalised: the observation after the step, at an episode's end its last one."""
    signals: Tensor
    """[1 + M, B], the reward and then the costs."""
    continues: Tensor
    """[B], 0 where the episode terminated, else 1, also where it was truncated."""


class Transitions(NamedTuple):
    """The S valid steps of a rollout."""

    obs: Tensor
    """[S, D], raw."""
    actions: Tensor
    """[S, A], raw."""
    next_obs: Tensor
    """[S, D], raw."""
    signals: Tensor
    """[S, 1 + M], the reward and then the costs."""
    continues: Tensor
    """[S] float32, 0 where the episode terminated, else 1."""


class ReplayBuffer:
    """The last `size` steps."""

    def __init__(self, size: int, obs: int, action: int, costs: int, device: torch.device = CPU) -> None:
        """Allocate `size` rows for `obs` numbers of an observation, `action` of an encoded action and `costs` costs.

        The operating system provides the memory only as it fills.
        """
        self.size, self._obs, self._action, self._signals = size, obs, action, 1 + costs
        self.rows = torch.empty(size, 2 * obs + action + 1 + costs + 1, device=device)
        """[R, ...] observation, action, next observation, reward, costs, continues."""
        self.filled, self._next = 0, 0

    def add(self, steps: Transitions) -> None:
        """Store steps whose actions are encoded [S, W]; they overwrite the oldest.

        Raises `NotFiniteError` for NaN or infinity.
        """
        rows = torch.cat([*steps[:4], steps.continues.unsqueeze(1)], 1)[-self.size :]
        require_finite(**{"reward and costs": float(steps.signals.sum()), "the replay": float(rows.sum())})
        before_wrap = rows[: self.size - self._next]
        after_wrap = rows[len(before_wrap) :]
        self.rows[self._next : self._next + len(before_wrap)] = before_wrap
        self.rows[: len(after_wrap)] = after_wrap
        self._next = (self._next + len(rows)) % self.size
        self.filled = min(self.filled + len(rows), self.size)

    def batches(
        self, count: int, size: int, generator: torch.Generator, normalise: Callable[[Tensor], Tensor]
    ) -> Iterator[Tensor]:
        """Yield the rows of `count` batches of `size` steps, drawn uniformly with replacement, with normalised
        observations."""
        while count > 0:
            gathered = min(count, BATCHES_PER_GATHER)
            drawn = torch.randint(self.filled, (gathered * size,), generator=generator, device=self.rows.device)
            rows = self.rows.index_select(0, drawn)
            next_obs = self._obs + self._action
            for obs in (rows[:, : self._obs], rows[:, next_obs : next_obs + self._obs]):
                obs.copy_(normalise(obs))
            yield from rows.split(size)
            count -= gathered

    def batch(self, rows: Tensor) -> Batch:
        """Return the fields of rows, as views of them."""
        obs, actions, next_obs, signals, continues = rows.split(
            [self._obs, self._action, self._obs, self._signals, 1], 1
        )
        return Batch(obs, actions, rows[:, : self._obs + self._action], next_obs, signals.T, continues[:, 0])

    def state(self) -> dict[str, Any]:
        """Return the state as arrays and plain data: the filled rows only."""
        return {"rows": array_of(self.rows[: self.filled]), "next": self._next}

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned; raises `AlgorithmError` for rows of another width or too many."""
        rows = np.asarray(state["rows"])
        if rows.shape[1] != self.rows.shape[1] or len(rows) > self.size:
            raise AlgorithmError(f"a replay of {tuple(self.rows.shape)} can't take rows of {rows.shape}")
        self.filled, self._next = len(rows), int(state["next"])
        self.rows[: self.filled] = tensor_of(rows, self.rows.device)


def valid_transitions(rollout: Rollout) -> Transitions:
    """Return the valid steps of a rollout.

    The observation after an episode's end is its last one, never the first of the next episode.
    """
    next_obs = rollout.obs[1:].flatten(0, 1).clone()
    next_obs[rollout.final_index] = rollout.final_obs
    valid = rollout.valid.flatten().nonzero().squeeze(-1)
    signals = torch.cat([rollout.rewards.unsqueeze(-1), rollout.costs], -1)
    return Transitions(
        rollout.obs[:-1].flatten(0, 1)[valid],
        rollout.actions.flatten(0, 1)[valid],
        next_obs[valid],
        signals.flatten(0, 1)[valid],
        (~rollout.terminated).flatten()[valid].float(),
    )
