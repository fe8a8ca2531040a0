"""Samples with advantages and value targets, from time-major rollouts.

Letters: T steps, N environments, B valid steps among T * N, F final observations, D numbers that the policy sees, E
those that critics see, K critics, M numbers of a recurrent state, L steps of a sequence, P parameters of an action
distribution.
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
from thalweg.algos.policy.vision import Convolutions


@dataclass(frozen=True)
class Signal:
    """A signal whose discounted sum a critic predicts: the reward, or a cost."""

    values: Tensor
    """[T, N]."""
    discount: float
    trace: float
    ends_at_limit: bool = False
    """Whether a truncation ends the sum as a termination does. If not, the value of the last state stands for the
    rest."""


@dataclass(frozen=True)
class Samples:
    """B valid steps of a rollout; K critics."""

    inputs: Tensor | Sequences
    """Inputs of the policy: normalised observations [B, D], rows of images uint8 [B, D], or all sequences of the
    rollout."""
    critic_inputs: Tensor | Sequences
    """Inputs of the critics [B, E], or sequences; the same object as `inputs` if they see the observation alone."""
    index: Tensor
    """[B] int64, t * N + n of each step."""
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
    imitated: Tensor
    """[B, P], distribution of the policy to which a KL is measured in the loss; [B, 0] if none is."""

    @property
    def of_critics(self) -> "Samples":
        """The same samples, with what critics see as `inputs`."""
        return replace(self, inputs=self.critic_inputs)

    def shuffled(self, tensors: Sequence[Tensor], generator: torch.Generator) -> list[Tensor]:
        """Return the inputs and the given tensors [B, ...] in one random order."""
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
        for inputs, rows in _parts_of_sequences(self.inputs, order, parts):
            yield inputs, tuple(tensor[rows] for tensor in tensors)

    def parts(self, size: int) -> Iterator[tuple[Tensor | Sequences, Tensor]]:
        """Yield all samples in parts of about `size` rows, in order: inputs, and the rows [b] int64."""
        parts = minibatch_count(len(self.actions), size)
        if isinstance(self.inputs, Tensor):
            rows = torch.arange(len(self.actions), device=self.actions.device)
            yield from zip(self.inputs.tensor_split(parts), rows.tensor_split(parts), strict=True)
        else:
            order = torch.arange(self.inputs.obs.shape[1], device=self.actions.device)
            yield from _parts_of_sequences(self.inputs, order, parts)

    def drawn(self, size: int, generator: torch.Generator) -> tuple[Tensor | Sequences, Tensor]:
        """Return about `size` random samples: inputs, and the rows [b] int64."""
        device, count = self.actions.device, len(self.actions)
        if isinstance(self.inputs, Tensor):
            rows = torch.randperm(count, generator=generator, device=device)[:size]
            return self.inputs[rows], rows
        order = torch.randperm(self.inputs.obs.shape[1], generator=generator, device=device)
        return next(iter(_parts_of_sequences(self.inputs, order, minibatch_count(count, size))))


@torch.no_grad()
def samples_of(
    rollout: Rollout,
    critics: Critics,
    normaliser: Normaliser,
    signals: Sequence[Signal],
    memory: "RolloutMemory | None" = None,
    critic_normaliser: Normaliser | None = None,
    critics_see_obs: bool = True,
) -> Samples:
    """Return the rollout's valid steps with the advantages of each signal; critic k predicts signal k.

    Critics see `Rollout.critic_obs` beside the observation if there is a normaliser of it, and unless
    `critics_see_obs`, nothing else.
    """
    steps, count, size = rollout.obs.shape[0] - 1, rollout.obs.shape[1], rollout.obs.shape[2]
    obs = normaliser(rollout.obs.reshape(-1, size))
    own = (obs, normaliser(rollout.final_obs)) if critics_see_obs else None
    seen, final = _seen_by_critics(rollout, own, critic_normaliser)
    features = seen
    if memory is not None:
        features, final = memory.scan(obs, seen, rollout, final)
    values = critics(features).view(-1, steps + 1, count)
    next_values = values[:, 1:].clone()
    if len(rollout.final_index):
        next_values.view(len(signals), -1)[:, rollout.final_index] = critics(final)
    # A step that only resets does not affect earlier advantages, because the step before it ended an episode.
    advantages = torch.stack(
        [
            gae(
                signal.values,
                values[k, :-1],
                next_values[k],
                rollout.terminated | rollout.truncated if signal.ends_at_limit else rollout.terminated,
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
    if memory is None:
        inputs = obs[: steps * count][keep]
        critic_inputs = inputs if seen is obs else seen[: steps * count][keep]
    else:
        inputs, critic_inputs, order = memory.sequences(obs, seen, rollout)
        keep, flat_advantages, flat_values = keep[order], flat_advantages[:, order], flat_values[:, order]
        critic_inputs = seen[: steps * count][keep] if critic_inputs is None else critic_inputs
    return Samples(
        inputs=inputs,
        critic_inputs=critic_inputs,
        index=keep,
        actions=rollout.actions.reshape(steps * count, -1)[keep],
        advantages=flat_advantages,
        targets=flat_advantages + flat_values,
        values=flat_values,
        rollout_steps=steps,
        imitated=flat_values.new_zeros(len(keep), 0),
    )


def _seen_by_critics(
    rollout: Rollout, own: tuple[Tensor, Tensor] | None, normaliser: Normaliser | None
) -> tuple[Tensor, Tensor]:
    """Return what critics see in each state [(T + 1) * N, E] and in final ones [F, E].

    It is the normalised observation, `own` in all states and in final ones, unless they do not see it, and after it,
    with a normaliser, what only critics see.
    """
    if normaliser is None:
        assert own is not None, "critics see neither the observation nor anything else"
        return own
    told, told_final = rollout.critic_obs, rollout.final_critic_obs
    assert told is not None, "critics see more than the observation, but the rollout has none of it"
    told = told.flatten(0, 1)
    told_final = told[:0] if told_final is None else told_final  # collectors without final observations
    told, told_final = normaliser(told), normaliser(told_final)
    return (told, told_final) if own is None else (torch.cat([own[0], told], -1), torch.cat([own[1], told_final], -1))


class RolloutMemory:
    """The recurrent states of policy and critics along the rollouts of N environments."""

    def __init__(
        self, actor: Gru, critics: Gru | None, num_envs: int, length: int, eyes: Convolutions | None = None
    ) -> None:
        """`critics` is None for critics without memory; `eyes` are the policy's, if it sees images."""
        self.gru = {"actor": actor} | ({} if critics is None else {"critics": critics})
        self.eyes, self.length = eyes, length
        """L, the length of training sequences."""
        self.starts = {name: gru.start(num_envs) for name, gru in self.gru.items()}
        """[N, M] before the rollout's first observation, by network."""
        self._states: dict[str, Tensor] = {}
        """[T + 1, N, M] after each of its observations."""

    def scan(self, obs: Tensor, seen: Tensor, rollout: Rollout, final: Tensor) -> tuple[Tensor, Tensor]:
        """Return the inputs of the critics' perceptrons at each step [(T + 1) * N, E + M] and at final states
        [F, E + M], without M for critics without memory.

        Args:
            obs: [(T + 1) * N, D], what the policy sees.
            seen: [(T + 1) * N, E], what critics see; both recurrent networks see as much as the perceptrons after them.
            rollout: The rollout.
            final: [F, E], what critics see in final states.
        """
        seen_by = {"actor": obs if self.eyes is None else self.eyes.in_blocks(obs), "critics": seen}
        self._states = {
            name: gru.states(seen_by[name].view(*rollout.fresh.shape, -1), rollout.fresh, self.starts[name])
            for name, gru in self.gru.items()
        }
        if "critics" not in self.gru:
            return seen, final
        states = self._states["critics"]
        last = states[:-1].flatten(0, 1)[rollout.final_index]
        after = self.gru["critics"].step(final, last, torch.zeros_like(final[:, 0], dtype=torch.bool))
        return torch.cat([seen, states.flatten(0, 1)], -1), torch.cat([final, after], -1)

    def sequences(self, obs: Tensor, seen: Tensor, rollout: Rollout) -> tuple[Sequences, Sequences | None, Tensor]:
        """Return the sequences of the policy and of the critics, None if these have no memory, and the index [B] of
        each of their steps among the rollout's valid steps; `obs` and `seen` are those of `scan`."""
        steps, count = rollout.valid.shape
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
        along = (steps + 1, count, -1)
        of_policy = Sequences(cut(obs.view(along)[:-1]), cut(rollout.fresh[:-1]), starts, keep)
        of_critics = None
        if "critics" in self.gru:
            of_critics = of_policy if seen is obs else replace(of_policy, obs=cut(seen.view(along)[:-1]))
        return of_policy, of_critics, rows[keep]

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


def _parts_of_sequences(sequences: Sequences, order: Tensor, parts: int) -> Iterator[tuple[Sequences, Tensor]]:
    """Yield the sequences in `order` [C] in parts, and the rows [b] of their valid steps."""
    all_rows = _rows_of_steps(sequences)
    for columns in order.tensor_split(min(parts, len(order))):
        rows = all_rows[:, columns].flatten()
        keep = (rows >= 0).nonzero().squeeze(-1)
        if len(keep):
            yield _select_sequences(sequences, columns, keep), rows[keep]


def _select_sequences(sequences: Sequences, columns: Tensor, keep: Tensor) -> Sequences:
    """Return the sequences with indices `columns`; `keep` are the indices of their valid steps."""
    return replace(
        sequences,
        obs=sequences.obs[:, columns],
        fresh=sequences.fresh[:, columns],
        starts={name: start[columns] for name, start in sequences.starts.items()},
        keep=keep,
    )


def of_valid_steps(rollout: Rollout, states: Tensor) -> Tensor:
    """Return the rows [B, ...] of the valid steps among those of all states [T + 1, N, ...]."""
    return states[:-1][rollout.valid]
