"""Probability, entropy, divergence and their gradients for diagonal Gaussians, including squashed and discretised ones.

`mean` and `log_std` are [B, A]; every quantity is a sum over the A dimensions.
"""

import math

import torch
from torch import Tensor

from thalweg.algos.maths.shapes import rank, same_shape

LOG_2_PI = math.log(2.0 * math.pi)


def log_prob(mean: Tensor, log_std: Tensor, actions: Tensor) -> Tensor:
    """Return log π(a|s) [B] = Σ_i -½ ((a_i - μ_i) / σ_i)² - log σ_i - ½ log 2π, for actions [B, A]."""
    rank(2, mean=mean)
    same_shape(mean=mean, log_std=log_std, actions=actions)
    return (-0.5 * ((actions - mean) * (-log_std).exp()).square() - log_std - 0.5 * LOG_2_PI).sum(-1)


def entropy(log_std: Tensor) -> Tensor:
    """Return H [B] = Σ_i log σ_i + ½ log 2πe, in nats."""
    rank(2, log_std=log_std)
    return (log_std + 0.5 * (LOG_2_PI + 1.0)).sum(-1)


def kl(mean_p: Tensor, log_std_p: Tensor, mean_q: Tensor, log_std_q: Tensor) -> Tensor:
    """Return KL(p ‖ q) [B] = Σ_i log σq/σp + (σp² + (μp - μq)²) / 2σq² - ½, in nats."""
    rank(2, mean_p=mean_p)
    same_shape(mean_p=mean_p, log_std_p=log_std_p, mean_q=mean_q, log_std_q=log_std_q)
    variance_ratio = (2.0 * (log_std_p - log_std_q)).exp()
    shift = ((mean_p - mean_q) * (-log_std_q).exp()).square()
    return (log_std_q - log_std_p + 0.5 * (variance_ratio + shift) - 0.5).sum(-1)


def log_prob_grad(mean: Tensor, log_std: Tensor, actions: Tensor) -> Tensor:
    """Return the gradient of `log_prob` in mean and log standard deviation, concatenated [B, 2 A].

    They are (a - μ) / σ² and ((a - μ) / σ)² - 1.
    """
    same_shape(mean=mean, log_std=log_std, actions=actions)
    precision = (-log_std).exp()
    deviation = (actions - mean) * precision
    return torch.cat([deviation * precision, deviation.square() - 1.0], -1)


def entropy_grad(log_std: Tensor) -> Tensor:
    """Return the gradient of `entropy` in mean and log standard deviation [B, 2 A]: 0 and 1."""
    return torch.cat([torch.zeros_like(log_std), torch.ones_like(log_std)], -1)


def kl_grad(mean_p: Tensor, log_std_p: Tensor, mean_q: Tensor, log_std_q: Tensor) -> Tensor:
    """Return the gradient of `kl` in mean and log standard deviation of p [B, 2 A]: (μp - μq) / σq², σp² / σq² - 1."""
    same_shape(mean_p=mean_p, log_std_p=log_std_p, mean_q=mean_q, log_std_q=log_std_q)
    shift = (mean_p - mean_q) * (-2.0 * log_std_q).exp()
    return torch.cat([shift, (2.0 * (log_std_p - log_std_q)).exp() - 1.0], -1)


def squashed_log_prob(mean: Tensor, log_std: Tensor, before: Tensor) -> Tensor:
    """Return log π(a|s) [B] of a = tanh(u), for u [B, A] sampled from the Gaussian (Haarnoja et al. 2018, appendix C).

    It is log N(u; μ, σ) - Σ_i log(1 - tanh² u_i). The last term is computed as 2 (log 2 - u - softplus(-2u)), which is
    exact where tanh u rounds to ±1.
    """
    stretch = 2.0 * (math.log(2.0) - before - torch.nn.functional.softplus(-2.0 * before))
    return log_prob(mean, log_std, before) - stretch.sum(-1)


def squashed_grads(actions: Tensor, spread: Tensor, of_actions: Tensor, of_log_prob: Tensor) -> tuple[Tensor, Tensor]:
    """Return the gradients of μ and log σ [B, A] from those of a = tanh(u), with u = μ + σ ε, and of log π(a|s).

    For constant ε, log π = Σ_i -½ ε_i² - log σ_i - ½ log 2π - log(1 - a_i²). The gradient of u, and of μ, is therefore
    (1 - a²) g_a + 2 a g_π; that of log σ is the same times σ ε, minus g_π.

    Args:
        actions: a [B, A].
        spread: σ ε [B, A].
        of_actions: g_a [B, A].
        of_log_prob: g_π [B].
    """
    same_shape(actions=actions, spread=spread, of_actions=of_actions)
    same_shape(of_log_prob=of_log_prob, states=actions[..., 0])
    each = of_log_prob.unsqueeze(-1)
    mean = (1.0 - actions.square()) * of_actions + 2.0 * actions * each
    return mean, mean * spread - each


def discretised(samples: Tensor, sizes: Tensor, *, scaled: bool) -> Tensor:
    """Return the options [B, A] int64 of continuous samples [B, A]: rounded and clamped to 0..sizes-1.

    Args:
        samples: [B, A].
        sizes: [A] int64, number of options of each branch.
        scaled: Whether -1..1 is first mapped to 0..sizes-1, so that a sample of 0 is the middle of three options.
            Without it, a standard normal selects the options of a branch of three with probabilities 0.69, 0.24 and
            0.07, and numbers in -1..1 never select the last.

    Ties are rounded to even. Source: Wang and Mahmoudian 2024 (a discretised diagonal Gaussian). Learning uses the
    probability of the continuous sample, not that of the option.
    """
    last = (sizes - 1).to(samples.dtype)
    rounded = torch.round((samples + 1.0) * (0.5 * last) if scaled else samples)
    return torch.minimum(rounded.clamp_(min=0), last).to(torch.int64)
