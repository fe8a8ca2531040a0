"""Straight-through Gumbel-softmax: one-hot choices with the gradient of their softmax relaxation.

The Gumbel trick samples option k of softmax(l) as argmax_k (l_k + g_k). The argmax has no gradient; that of a
softmax is used in its place.
"""

import torch
from torch import Tensor

from thalweg.algos.maths.shapes import rank, same_shape

TINY = 1e-20
"""Added before logarithms, which stay finite if a uniform number is 0."""


def gumbel(uniform: Tensor) -> Tensor:
    """Return standard Gumbel noise g = -log(-log u), from u in [0, 1) of any shape."""
    return -((uniform + TINY).log().neg() + TINY).log()


def straight_through(log_p: Tensor, noise: Tensor, temperature: float) -> tuple[Tensor, Tensor]:
    """Return one-hot choices [B, A, K] and the soft choices y [B, A, K] whose gradient is used for them.

    y = softmax((log π + g) / τ) (Jang, Gu, Poole 2017, equation 2 and section 2.2; Maddison, Mnih, Teh 2017).

    Args:
        log_p: log π [B, A, K].
        noise: g [B, A, K], from `gumbel`; with zeros, the most probable option is chosen.
        temperature: τ > 0; it affects the gradient only.
    """
    rank(3, log_p=log_p)
    same_shape(log_p=log_p, noise=noise)
    soft = ((log_p + noise) / temperature).softmax(-1)
    return one_hot(soft.argmax(-1), soft.shape[-1], soft.dtype), soft


def straight_through_grad(above: Tensor, soft: Tensor, temperature: float) -> Tensor:
    """Return the gradient of the logits from that of the choices [B, A, K]: y (g - Σ_k y_k g_k) / τ."""
    same_shape(above=above, soft=soft)
    return soft * (above - (above * soft).sum(-1, keepdim=True)) / temperature


def one_hot(actions: Tensor, options: int, dtype: torch.dtype = torch.float32) -> Tensor:
    """Return the one-hot encoding [B, A, K] of actions [B, A] int64 in 0..K-1."""
    hard = torch.zeros(*actions.shape, options, dtype=dtype, device=actions.device)
    return hard.scatter_(-1, actions.unsqueeze(-1), 1.0)
