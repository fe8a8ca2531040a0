"""Probabilities and expectations over all joint actions of several independent choices.

With A branches of a few options each, the J = Π sizes joint actions can be enumerated, and an expectation is a finite
sum. The number of a joint action has its options as digits; the last branch is the least significant.
"""

import torch
from torch import Tensor

from thalweg.algos.maths.gumbel_softmax import one_hot
from thalweg.algos.maths.shapes import rank, same_shape


def enumerated(sizes: tuple[int, ...]) -> Tensor:
    """Return all joint actions [J, A] int64, in the order of their numbers."""
    return torch.cartesian_prod(*(torch.arange(size) for size in sizes)).view(-1, len(sizes))


def selection(sizes: tuple[int, ...]) -> Tensor:
    """Return [A * K, J] float32, 1 where a joint action includes an option, else 0; K is the largest size."""
    return one_hot(enumerated(sizes), max(sizes)).flatten(1).T.contiguous()


def numbers(actions: Tensor, sizes: tuple[int, ...]) -> Tensor:
    """Return the number [B] int64 of each joint action [B, A]."""
    rank(2, actions=actions)
    number = torch.zeros_like(actions[:, 0])
    for branch, size in enumerate(sizes):
        number = number * size + actions[:, branch]
    return number


def log_prob(log_p: Tensor, selected: Tensor) -> Tensor:
    """Return log π(a|s) of every joint action [B, J] = Σ_b log π_b(a_b|s), from log π_b [B, A, K] and `selection`."""
    rank(3, log_p=log_p)
    return log_p.flatten(1) @ selected


def expectation(log_p: Tensor, values: Tensor) -> Tensor:
    """Return Σ_a π(a|s) x(s, a) [B], from log π [B, J] and x [B, J]."""
    rank(2, log_p=log_p)
    same_shape(log_p=log_p, values=values)
    return (log_p.exp() * values).sum(-1)
