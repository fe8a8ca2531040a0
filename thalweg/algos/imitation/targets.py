"""Targets of an imitation, from the worths that a teacher gives to all moves, not from its one choice.

Letters: B states, M moves, A branches of an action.
"""

import torch
from torch import Tensor


def regrets(worths: Tensor, worst: float) -> Tensor:
    """Return how much less each move is worth than the best one [B, M], at most `worst`, for worths [B, M]."""
    return (worths.amax(-1, keepdim=True) - worths).clamp(max=worst)


def soft_targets(regret: Tensor, temperature: float) -> Tensor:
    """Return probabilities [B, M] of moves with regrets [B, M]: their softmax, negated, at a temperature."""
    return torch.softmax(-regret / temperature, -1)


def move_log_probs(log_probs: list[Tensor], options: Tensor) -> Tensor:
    """Return the log probabilities of moves [B, M] under independent branches.

    Args:
        log_probs: A tensors [B, options of the branch].
        options: [M, A] int64, the option that each move takes in each branch.
    """
    return sum(
        (branch[:, options[:, index]] for index, branch in enumerate(log_probs)),
        start=torch.zeros((), dtype=torch.float32, device=options.device),
    )


def cross_entropy(targets: Tensor, log_probs: Tensor) -> Tensor:
    """Return the mean cross-entropy of the student's moves [B, M] against targets [B, M], in nats."""
    return -(targets * log_probs).sum(-1).mean()


def expected_regret(regret: Tensor, log_probs: Tensor, worst: float) -> Tensor:
    """Return the mean regret of what is drawn with the student's log probabilities [B, M] of moves.

    Where these do not add up to 1, options were drawn that are those of no move, such as the dead third option of the
    branch forward. Their regret is the `worst`: were it 0, a student that cannot tell what is fatal would flee to them.
    """
    probabilities = log_probs.exp()
    return ((probabilities * regret).sum(-1) + worst * (1.0 - probabilities.sum(-1))).mean()
