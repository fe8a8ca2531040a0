"""Replay buffer of off-policy algorithms: a ring of rows, one environment step each.

Everything about a step lies in one row, so that a batch is one gather. Rows hold raw observations, because the running
statistics that normalise them change after they were stored. Letters: R rows, B batch size, S steps, D numbers of an
observation, C that only critics see, A of a raw action, W of an encoded action, M costs.
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

Normalise = Callable[[Tensor], Tensor]
BATCHES_PER_GATHER = 64
"""Largest number of batches that are gathered at once."""


@dataclass(frozen=True)
class Batch:
    """B stored steps: views of one gathered matrix."""

    obs: Tensor
    """[B, D], normalised."""
    seen: Tensor
    """[B, D + C], normalised: what critics see of the state, `obs` and then the C numbers."""
    actions: Tensor
    """[B, W], encoded."""
    seen_actions: Tensor
    """[B, D + C + W], `seen` and `actions` side by side."""
    next_obs: Tensor
    """[B, D], normalised: the observation after the step, at an episode's end its last one."""
    next_seen: Tensor
    """[B, D + C], normalised: what critics see after the step."""
    signals: Tensor
    """[1 + M, B], the reward and then the costs."""
    continues: Tensor
    """[1 + M, B], whether anything comes after the step, see `Transitions`."""


class Transitions(NamedTuple):
    """The S valid steps of a rollout."""

    obs: Tensor
    """[S, D], raw."""
    critic_obs: Tensor
    """[S, C], raw."""
    actions: Tensor
    """[S, A], raw."""
    next_obs: Tensor
    """[S, D], raw."""
    next_critic_obs: Tensor
    """[S, C], raw."""
    signals: Tensor
    """[S, 1 + M], the reward and then the costs."""
    continues: Tensor
    """[S, 1] float32 for all signals, 0 where the episode terminated, else 1, also where it was truncated. With numbers
    that only critics see [S, 1 + M], a column for each signal: of costs it is 0 at a truncation too, since these
    critics are told when the step limit comes."""


class ReplayBuffer:
    """The last `size` steps."""

    def __init__(
        self, size: int, obs: int, action: int, costs: int, *, critic_obs: int = 0, device: torch.device = CPU
    ) -> None:
        """Allocate `size` rows for `obs` numbers of an observation, `critic_obs` that only critics see, `action` of an
        encoded action and `costs` costs.

        The operating system provides the memory only as it fills.
        """
        self.size, self._obs, self._critic_obs, self._action, self._signals = size, obs, critic_obs, action, 1 + costs
        self._seen, self._ends = obs + critic_obs, self._signals if critic_obs else 1
        self.rows = torch.empty(
            size, 2 * self._seen + action + self._signals + self._ends, dtype=torch.float32, device=device
        )
        """[R, ...] observation, C numbers, action, both after the step, reward, costs, continues."""
        self.filled, self._next = 0, 0

    def add(self, steps: Transitions) -> None:
        """Store steps whose actions are encoded [S, W]; they overwrite the oldest.

        Raises `NotFiniteError` for NaN or infinity.
        """
        rows = torch.cat([*steps], 1)[-self.size :]
        require_finite(**{"reward and costs": float(steps.signals.sum()), "the replay": float(rows.sum())})
        before_wrap = rows[: self.size - self._next]
        after_wrap = rows[len(before_wrap) :]
        self.rows[self._next : self._next + len(before_wrap)] = before_wrap
        self.rows[: len(after_wrap)] = after_wrap
        self._next = (self._next + len(rows)) % self.size
        self.filled = min(self.filled + len(rows), self.size)

    def batches(
        self, count: int, size: int, generator: torch.Generator, normalise: Normalise, normalise_critic_obs: Normalise
    ) -> Iterator[Tensor]:
        """Yield the rows of `count` batches of `size` steps, drawn uniformly with replacement, with normalised
        observations [B, D] and C numbers [B, C]."""
        while count > 0:
            gathered = min(count, BATCHES_PER_GATHER)
            drawn = torch.randint(self.filled, (gathered * size,), generator=generator, device=self.rows.device)
            rows = self.rows.index_select(0, drawn)
            for start in (0, self._seen + self._action):
                obs = rows[:, start : start + self._obs]
                obs.copy_(normalise(obs))
                if self._critic_obs:
                    critic_obs = rows[:, start + self._obs : start + self._seen]
                    critic_obs.copy_(normalise_critic_obs(critic_obs))
            yield from rows.split(size)
            count -= gathered

    def batch(self, rows: Tensor) -> Batch:
        """Return the fields of rows, as views of them."""
        seen, actions, next_seen, signals, continues = rows.split(
            [self._seen, self._action, self._seen, self._signals, self._ends], 1
        )
        obs, next_obs = (seen[:, : self._obs], next_seen[:, : self._obs]) if self._critic_obs else (seen, next_seen)
        seen_actions = rows[:, : self._seen + self._action]
        continues = continues.T.expand(self._signals, -1)
        return Batch(obs, seen, actions, seen_actions, next_obs, next_seen, signals.T, continues)

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


def valid_transitions(rollout: Rollout, critic_size: int = 0) -> Transitions:
    """Return the valid steps of a rollout, with the C = `critic_size` numbers that only critics see; 0 for none.

    What is seen after an episode's end is its last state, never the first of the next episode. Raises `AlgorithmError`
    if the rollout has not C of them.
    """
    valid = rollout.valid.flatten().nonzero().squeeze(-1)
    obs, next_obs = _before_and_after(rollout.obs, rollout.final_obs, rollout.final_index, valid)
    if critic_size:
        told, final = rollout.critic_obs, rollout.final_critic_obs
        if told is None or final is None or told.shape[-1] != critic_size:
            found = "none" if told is None or final is None else f"{told.shape[-1]}"
            raise AlgorithmError(f"critics see {critic_size} numbers beside the observation; the rollout has {found}")
        before, after = _before_and_after(told, final, rollout.final_index, valid)
    else:
        before, after = obs[:, :0], next_obs[:, :0]
    ends = [rollout.terminated]
    if critic_size:
        ends += [rollout.terminated | rollout.truncated] * rollout.costs.shape[-1]
    return Transitions(
        obs,
        before,
        rollout.actions.flatten(0, 1)[valid],
        next_obs,
        after,
        torch.cat([rollout.rewards.unsqueeze(-1), rollout.costs], -1).flatten(0, 1)[valid],
        (~torch.stack(ends, -1)).flatten(0, 1)[valid].float(),
    )


def _before_and_after(seen: Tensor, final: Tensor, final_index: Tensor, valid: Tensor) -> tuple[Tensor, Tensor]:
    """Return what was seen before and after each valid step, twice [S, D], from [T + 1, N, D] and [F, D]."""
    after = seen[1:].flatten(0, 1).clone()
    after[final_index] = final
    return seen[:-1].flatten(0, 1)[valid], after[valid]
