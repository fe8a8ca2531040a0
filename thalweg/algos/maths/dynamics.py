"""Losses of a probabilistic dynamics model, with one number per step of the batch [..., B]."""

import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from thalweg.algos.maths.shapes import same_shape


def bounded_variance(raw: Tensor, low: Tensor, high: Tensor) -> Tensor:
    """Return σ² [..., D] from a network's output, softly bounded by e^low and e^high (Chua et al. 2018, appendix A.1).

    In the paper, the log-variance passes v ← high - softplus(high - v), then v ← low + softplus(v - low). This equals:

        σ² = e^low + e^high / (1 + e^(high - raw))

    Args:
        raw: [..., D].
        low: [D].
        high: [D].
    """
    return low.exp() + high.exp() * torch.sigmoid(raw - high)


def gaussian_nll(mean: Tensor, variance: Tensor, targets: Tensor) -> Tensor:
    """Return ½ ((y - μ)² / σ² + log σ²) [..., D]: -log N(y; μ, σ²) without its constant."""
    same_shape(mean=mean, variance=variance, targets=targets)
    return 0.5 * ((targets - mean).square() / variance + variance.log())


def balanced_cross_entropy(logits: Tensor, targets: Tensor, weight: Tensor) -> Tensor:
    """Return a cross-entropy [..., B] in which rare events count w times but z remains the logit of their frequency.

        L = -(w y log p + (1 - y) log(1 - p)),    p = σ(z + log w)

    The weighted loss alone would have its minimum at p/(1-p) = w E[y]/(1 - E[y]); adding log w to the logit corrects
    this (King, Zeng 2001, section 4.1; Menon et al. 2021, equation 10). Targets may lie anywhere in 0..1: the minimum
    is at σ(z) = E[y], so the mean of any bounded quantity can be learnt (Papke, Wooldridge 1996, equation 5).

    Args:
        logits: z [..., B].
        targets: y [..., B] in 0..1.
        weight: w > 0, broadcast.
    """
    same_shape(logits=logits, targets=targets)
    shifted = logits + weight.log()
    return binary_cross_entropy_with_logits(shifted, targets, reduction="none", pos_weight=weight)


def rarity(rate: Tensor, most: float) -> Tensor:
    """Return w of `balanced_cross_entropy` for events of a rate: both classes count alike; w is clipped to 1..most."""
    return ((1.0 - rate) / rate.clamp(min=1e-8)).clamp(1.0, most)
