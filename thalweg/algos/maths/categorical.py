"""Probability, entropy, divergence and their gradients for actions of several independent categorical choices.

π(a|s) = Π_b π_b(a_b|s), with one categorical of K options for each of A branches. Every quantity is an exact sum over
branches. `log_p` [B, A, K] are normalised log-probabilities; an option that does not exist has -1e9, hence
probability 0.
"""

import torch
from torch import Tensor

from thalweg.algos.maths.shapes import rank, same_shape

ABSENT = -1e9
"""Logit of an option that a shorter branch does not have; not -inf, because 0 * -inf is NaN."""


def log_prob(log_p: Tensor, actions: Tensor) -> Tensor:
    """Return log π(a|s) [B] = Σ_b log π_b(a_b|s), for actions [B, A] int64 in 0..K-1."""
    rank(3, log_p=log_p)
    same_shape(actions=actions, branches=log_p[..., 0])
    return log_p.gather(-1, actions.unsqueeze(-1)).squeeze(-1).sum(-1)


def entropy(log_p: Tensor) -> Tensor:
    """Return H [B] = -Σ_b Σ_k π_b(k) log π_b(k), in nats."""
    rank(3, log_p=log_p)
    return -(log_p.exp() * log_p).sum((-1, -2))


def kl(log_p: Tensor, log_q: Tensor) -> Tensor:
    """Return the exact KL(p ‖ q) [B] = Σ_b Σ_k p_b(k) (log p_b(k) - log q_b(k)) of the joint distributions, in nats."""
    rank(3, log_p=log_p)
    same_shape(log_p=log_p, log_q=log_q)
    return (log_p.exp() * (log_p - log_q)).sum((-1, -2))


def log_prob_grad(log_p: Tensor, actions: Tensor) -> Tensor:
    """Return the gradient of `log_prob` in the logits [B, A, K]: 1{k = a_b} - π_b(k)."""
    rank(3, log_p=log_p)
    same_shape(actions=actions, branches=log_p[..., 0])
    return log_p.exp().neg_().scatter_add_(-1, actions.unsqueeze(-1), log_p.new_ones(*actions.shape, 1))


def entropy_grad(log_p: Tensor) -> Tensor:
    """Return the gradient of `entropy` in the logits [B, A, K]: -π_b(k) (log π_b(k) + H_b)."""
    p = log_p.exp()
    return -p * (log_p - (p * log_p).sum(-1, keepdim=True))


def kl_grad(log_p: Tensor, log_q: Tensor) -> Tensor:
    """Return the gradient of `kl` in the logits of p [B, A, K]: p_b(k) (log p_b(k) - log q_b(k) - KL_b)."""
    same_shape(log_p=log_p, log_q=log_q)
    p, log_ratio = log_p.exp(), log_p - log_q
    return p * (log_ratio - (p * log_ratio).sum(-1, keepdim=True))


def sample(log_p: Tensor, uniform: Tensor) -> Tensor:
    """Return actions [B, A] int64 by inverse transform sampling, from `uniform` [B, A] in [0, 1)."""
    same_shape(uniform=uniform, branches=log_p[..., 0])
    return drawn(log_p.exp(), uniform)


def drawn(probabilities: Tensor, uniform: Tensor) -> Tensor:
    """Return options [...] int64 by inverse transform sampling from probabilities [..., K].

    `uniform` [...] lies in [0, 1); it and the probabilities may be broadcast.
    """
    cumulative = probabilities.cumsum(-1)
    # The last sum may differ from 1 by rounding. Scaling by it makes sure that an absent option is never drawn.
    below = uniform.unsqueeze(-1) * cumulative[..., -1:] >= cumulative
    return below.sum(-1).clamp_(max=probabilities.shape[-1] - 1)


def mode(log_p: Tensor) -> Tensor:
    """Return the most probable action [B, A] int64; of equally probable options, the first."""
    return torch.argmax(log_p, -1)
