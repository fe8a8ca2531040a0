"""A head of students over whole moves: one logit for each, in place of one for each branch of the action.

`heads.py` compares both.
"""

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from thalweg.algos.common.state import CPU
from thalweg.algos.imitation.config import ImitationConfig
from thalweg.algos.imitation.student import Student
from thalweg.algos.policy.actions import Actions
from thalweg.env.moves import MOVE_OPTIONS
from thalweg.env.task.bird_eye import COLUMNS as MAP_COLUMNS
from thalweg.env.task.bird_eye import ROWS as MAP_ROWS
from thalweg.env.task.ideal_eye import FEATURES
from thalweg.train.imitation.imitate import Imitation


@dataclass(frozen=True)
class JointMoves:
    """A distribution over whole moves at B states."""

    log_p: Tensor
    """[B, M]."""
    moves: Tensor
    """[M, A] options of each move."""

    def sample(self, generator: torch.Generator | None) -> Tensor:
        """Return the options [B, A] of drawn moves."""
        return self.moves[torch.multinomial(self.log_p.exp(), 1, generator=generator)[:, 0]]

    def mode(self) -> Tensor:
        """Return the options [B, A] of the most probable moves."""
        return self.moves[self.log_p.argmax(-1)]

    def log_prob(self, actions: Tensor) -> Tensor:
        """Return the log-probability [B] of options [B, A]; -inf for those of no move."""
        same = (actions[:, None] == self.moves).all(-1)
        return torch.where(same, self.log_p, -torch.inf).amax(-1)

    def entropy(self) -> Tensor:
        """Return the entropy [B], in nats."""
        return -(self.log_p.exp() * self.log_p).sum(-1)

    def kl(self, other: "JointMoves") -> Tensor:
        """Return KL(self ‖ other) [B], in nats."""
        return (self.log_p.exp() * (self.log_p - other.log_p)).sum(-1)


class JointActions(Actions):
    """An action space whose policy has one logit for each move."""

    @property
    def outputs(self) -> int:
        """M."""
        return len(MOVE_OPTIONS)

    def distribution(self, parameters: Tensor) -> JointMoves:
        """Return the distribution over moves at each state, from logits [B, M]."""
        return JointMoves(parameters.log_softmax(-1), torch.from_numpy(MOVE_OPTIONS))


class JointStudent(Student):
    """A student whose policy has one logit for each move."""

    def log_probs(self, logits: Tensor) -> Tensor:
        """Return the log probabilities [B, M] of moves from their logits [B, M]."""
        return logits.log_softmax(-1)


class JointImitation(Imitation):
    """An imitation by a `JointStudent`."""

    def new_student(
        self, config: ImitationConfig, actions: Actions, context: dict[str, Any], device: torch.device = CPU
    ) -> JointStudent:
        """Return the student before it has learnt anything."""
        sizes = len(FEATURES), MAP_ROWS * MAP_COLUMNS
        return JointStudent(config, JointActions(**vars(actions)), MOVE_OPTIONS, sizes, self.seed, context, device)
