"""What do a rollout's steps say about each action? From time-major rollouts to flat samples with advantages.

The minibatch loop is absent on purpose: it stands in each algorithm, where it can be read.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from thalweg.algos.errors import NotFiniteError
from thalweg.algos.interface import Rollout
from thalweg.algos.maths.advantages import gae
from thalweg.algos.networks import Critics
from thalweg.algos.normaliser import Normaliser


@dataclass(frozen=True)
class Signal:
    """One stream that a critic predicts: the reward, or a cost."""

    values: Tensor
    """[T, N]."""
    discount: float
    trace: float


@dataclass(frozen=True)
class Samples:
    """B valid steps of a rollout; K critics."""

    obs: Tensor
    """[B, D] float32, normalised."""
    actions: Tensor
    """[B, A], raw."""
    advantages: Tensor
    """[K, B]."""
    targets: Tensor
    """[K, B], advantage + value: what each critic should have said."""
    values: Tensor
    """[K, B], what it said."""


@torch.no_grad()
def samples_of(rollout: Rollout, critics: Critics, normaliser: Normaliser, signals: Sequence[Signal]) -> Samples:
    """The rollout's valid steps with the advantages of each signal; critic k predicts signal k."""
    steps, count, size = rollout.obs.shape[0] - 1, rollout.obs.shape[1], rollout.obs.shape[2]
    obs = normaliser(rollout.obs.reshape(-1, size))
    values = critics(obs).view(-1, steps + 1, count)
    next_values = values[:, 1:].clone()
    if len(rollout.final_index):
        next_values.view(len(signals), -1)[:, rollout.final_index] = critics(normaliser(rollout.final_obs))
    # A step that only resets passes nothing back: the one before it ended an episode.
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
    return Samples(
        obs=obs[: steps * count][keep],
        actions=rollout.actions.reshape(steps * count, -1)[keep],
        advantages=flat_advantages,
        targets=flat_advantages + flat_values,
        values=flat_values,
    )


def minibatches(tensors: Sequence[Tensor], size: int, generator: torch.Generator) -> Iterator[tuple[Tensor, ...]]:
    """The rows of tensors that share their first dimension, shuffled, in parts of about `size` rows each.

    Shuffled once and cut into views, which is cheaper than gathering for every part; no part is a small rest.
    """
    rows = len(tensors[0])
    order = torch.randperm(rows, generator=generator)
    parts = max(1, round(rows / size))
    yield from zip(*(tensor[order].tensor_split(parts) for tensor in tensors), strict=True)


def valid_obs(rollout: Rollout) -> Tensor:
    """Raw observations [B, D] of the valid steps."""
    return rollout.obs[:-1][rollout.valid]


def require_finite(**numbers: float) -> None:
    """Raises `NotFiniteError` naming the first number that is NaN or infinite."""
    for name, number in numbers.items():
        if not math.isfinite(number):
            raise NotFiniteError(f"{name} has become {number}")
