"""Samples with advantages and value targets, from time-major rollouts.

Letters: T steps, N environments, B valid steps among T * N, D numbers seen, K critics; L steps of a sequence, C
sequences.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from thalweg.algos.common.state import array_of, tensor_of
from thalweg.algos.interface import Rollout
from thalweg.algos.maths.advantages import gae
from thalweg.algos.policy.memory import Gru, Sequences
from thalweg.algos.policy.networks import Critics, minibatch_count
from thalweg.algos.policy.normaliser import Normaliser


@dataclass(frozen=True)
class Signal:
    """A signal whose discounted sum a critic predicts: the reward, or a cost."""

    values: Tensor
    """[T, N]."""
    discount: float
    trace: float


@dataclass(frozen=True)
class Samples:
    """B valid steps of a rollout; K critics."""

    inputs: Tensor | Sequences
    """Inputs of the networks: normalised observations [B, D], or all sequences of the rollout."""
    actions: Tensor
    """[B, A], raw."""
    advantages: Tensor
    """[K, B]."""
    targets: Tensor
    """[K, B], advantage + value: the regression targets of the critics."""
    values: Tensor
    """[K, B], predictions of the critics."""
    rollout_steps: int
    """T."""

    def shuffled(self, tensors: Sequence[Tensor], generator: torch.Generator) -> list[Tensor]:
        """Return observations and the given tensors [B, ...] in one random order."""
        assert isinstance(self.inputs, Tensor)
        order = torch.randperm(len(self.actions), generator=generator, device=self.actions.device)
        return [tensor[order] for tensor in (self.inputs, *tensors)]

    def minibatches(
        self, tensors: Sequence[Tensor], size: int, generator: torch.Generator
    ) -> Iterator[tuple[Tensor | Sequences, tuple[Tensor, ...]]]:
        """Yield shuffled minibatches of about `size` rows: inputs and the matching rows of tensors [B, ...].

        Observations are shuffled once and split into views, which is cheaper than indexing for every minibatch.
        Sequences are not split. No minibatch is a small remainder.
        """
        parts = minibatch_count(len(self.actions), size)
        if isinstance(self.inputs, Tensor):
            cut = [tensor.tensor_split(parts) for tensor in self.shuffled(tensors, generator)]
            yield from ((inputs, rows) for inputs, *rows in zip(*cut, strict=True))  # pyright: ignore
            return
        order = torch.randperm(self.inputs.obs.shape[1], generator=generator, device=self.actions.device)
        all_rows = _rows_of_steps(self.inputs)
        for columns in order.tensor_split(min(parts, len(order))):
            rows = all_rows[:, columns].flatten()
            keep = (rows >= 0).nonzero().squeeze(-1)
            if len(keep):
                yield _select_sequences(self.inputs, columns, keep), tuple(tensor[rows[keep]] for tensor in tensors)


@torch.no_grad()
def samples_of(
    rollout: Rollout,
    critics: Critics,
    normaliser: Normaliser,
    signals: Sequence[Signal],
    memory: "RolloutMemory | None" = None,
) -> Samples:
    """Return the rollout's valid steps with the advantages of each signal; critic k predicts signal k."""
    steps, count, size = rollout.obs.shape[0] - 1, rollout.obs.shape[1], rollout.obs.shape[2]
    obs = normaliser(rollout.obs.reshape(-1, size))
    final = normaliser(rollout.final_obs)
    if memory is not None:
        seen, seen_final = memory.scan(obs.view(steps + 1, count, size), rollout, final)
    else:
        seen, seen_final = obs, final
    values = critics(seen).view(-1, steps + 1, count)
    next_values = values[:, 1:].clone()
    if len(rollout.final_index):
        next_values.view(len(signals), -1)[:, rollout.final_index] = critics(seen_final)
    # A step that only resets does not affect earlier advantages, because the step before it ended an episode.
    advantages = torch.stack(
        [
            gae(
                signal.values,
                values[k, :-1],
                next_values[k],
                rollout.terminated,
                rollout.truncated,
                discount=signal.discount,
                trace=signal.trace,
            )
            for k, signal in enumerate(signals)
        ]
    )
    keep = rollout.valid.reshape(-1).nonzero().squeeze(-1)
    flat_values = values[:, :-1].reshape(len(signals), -1)[:, keep]
    flat_advantages = advantages.reshape(len(signals), -1)[:, keep]
    inputs = obs[: steps * count][keep]
    rows = rollout.actions.reshape(steps * count, -1)[keep]
    if memory is not None:
        inputs, order = memory.sequences(obs.view(steps + 1, count, size)[:-1], rollout)
        rows, flat_advantages, flat_values = rows[order], flat_advantages[:, order], flat_values[:, order]
    return Samples(
        inputs=inputs,
        actions=rows,
        advantages=flat_advantages,
        targets=flat_advantages + flat_values,
        values=flat_values,
        rollout_steps=steps,
    )


class RolloutMemory:
    """The recurrent states of policy and critics along the rollouts of N environments."""

    def __init__(self, actor: Gru, critics: Gru, num_envs: int, length: int) -> None:
        self.gru = {"actor": actor, "critics": critics}
        self.length = length
        """L, the length of training sequences."""
        self.starts = {name: gru.start(num_envs) for name, gru in self.gru.items()}
        """[N, M] before the rollout's first observation, by network."""
        self._states: dict[str, Tensor] = {}
        """[T + 1, N, M] after each of its observations."""

    def scan(self, obs: Tensor, rollout: Rollout, final: Tensor) -> tuple[Tensor, Tensor]:
        """Return the critics' inputs at each step [(T + 1) * N, D + M] and at final observations [F, D + M].

        `obs` is [T + 1, N, D], `final` is [F, D].
        """
        self._states = {name: gru.states(obs, rollout.fresh, self.starts[name]) for name, gru in self.gru.items()}
        states = self._states["critics"]
        last = states[:-1].flatten(0, 1)[rollout.final_index]
        after = self.gru["critics"].step(final, last, torch.zeros_like(final[:, 0], dtype=torch.bool))
        return torch.cat([obs, states], -1).flatten(0, 1), torch.cat([final, after], -1)

    def sequences(self, obs: Tensor, rollout: Rollout) -> tuple[Sequences, Tensor]:
        """Return the sequences of the rollout, and the index [B] of each of their steps among its valid steps.

        `obs` is [T, N, D].
        """
        steps, count = obs.shape[:2]
        blocks = -(-steps // self.length)
        missing = blocks * self.length - steps

        def cut(tensor: Tensor) -> Tensor:
            """Return [T, N, ...] as [L, blocks * N, ...], padded with zeros."""
            padded = torch.cat([tensor, tensor.new_zeros(missing, *tensor.shape[1:])])
            return padded.view(blocks, self.length, *tensor.shape[1:]).transpose(0, 1).flatten(1, 2)

        # Valid steps are numbered from 1, so that 0 marks padding.
        number = rollout.valid.flatten().cumsum(0).view(steps, count) * rollout.valid
        rows = cut(number).flatten() - 1
        keep = (rows >= 0).nonzero().squeeze(-1)
        starts = {
            name: torch.stack([self.starts[name], *states[self.length - 1 : steps - 1 : self.length]]).flatten(0, 1)
            for name, states in self._states.items()
        }
        return Sequences(cut(obs), cut(rollout.fresh[:-1]), starts, keep), rows[keep]

    def advance(self) -> None:
        """Prepare for the next rollout, whose first observation is the last one of this rollout."""
        self.starts = {name: states[-2].clone() for name, states in self._states.items()}

    def state(self) -> dict[str, object]:
        """Return the states as arrays."""
        return {name: array_of(start) for name, start in self.starts.items()}

    def load_state(self, state: dict) -> None:
        """Restore what `state` returned."""
        self.starts = {name: tensor_of(state[name], start.device) for name, start in self.starts.items()}


def _rows_of_steps(sequences: Sequences) -> Tensor:
    """Return the row in 0..B - 1 of each step [L, C], -1 for steps that are not valid."""
    length, count = sequences.fresh.shape
    rows = torch.full((length * count,), -1, device=sequences.keep.device)
    rows[sequences.keep] = torch.arange(len(sequences.keep), device=sequences.keep.device)
    return rows.view(length, count)


def _select_sequences(sequences: Sequences, columns: Tensor, keep: Tensor) -> Sequences:
    """Return the sequences with indices `columns`; `keep` are the indices of their valid steps."""
    return replace(
        sequences,
        obs=sequences.obs[:, columns],
        fresh=sequences.fresh[:, columns],
        starts={name: start[columns] for name, start in sequences.starts.items()},
        keep=keep,
    )


def valid_obs(rollout: Rollout) -> Tensor:
    """Return raw observations [B, D] of the valid steps."""
    return rollout.obs[:-1][rollout.valid]
