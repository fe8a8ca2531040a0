"""Straight-through Gumbel-softmax: one-hot choices with the gradient of their softmax relaxation.

The Gumbel trick draws option k of softmax(l) as argmax_k (l_k + g_k); a softmax in place of the argmax has a gradient.
"""

import torch
from torch import Tensor

from thalweg.algos.maths.shapes import rank, same_shape

TINY = 1e-20
"""Keeps the logarithm of a uniform number that is 0 finite."""


def gumbel(uniform: Tensor) -> Tensor:
    """Standard Gumbel noise g = -log(-log u), from u in [0, 1) of any shape."""
    return -((uniform + TINY).log().neg() + TINY).log()


def straight_through(log_p: Tensor, noise: Tensor, temperature: float) -> tuple[Tensor, Tensor]:
    """One-hot choices [B, A, K], and the soft ones y = softmax((log π + g) / τ) [B, A, K] whose gradient stands for
    theirs (Jang, Gu, Poole 2017, equation 2 and section 2.2; Maddison, Mnih, Teh 2017).

    Args:
        log_p: log π [B, A, K].
        noise: g [B, A, K], from `gumbel`; zeros choose the most probable option.
        temperature: τ > 0; it changes the gradient only.
    """
    rank(3, log_p=log_p)
    same_shape(log_p=log_p, noise=noise)
    soft = ((log_p + noise) / temperature).softmax(-1)
    return one_hot(soft.argmax(-1), soft.shape[-1], soft.dtype), soft


def straight_through_grad(above: Tensor, soft: Tensor, temperature: float) -> Tensor:
    """From the gradient of the choices [B, A, K] that of the logits: y (g - Σ_k y_k g_k) / τ, as of the soft ones."""
    same_shape(above=above, soft=soft)
    return soft * (above - (above * soft).sum(-1, keepdim=True)) / temperature


def one_hot(actions: Tensor, options: int, dtype: torch.dtype = torch.float32) -> Tensor:
    """[B, A, K] with a 1 at the option of each branch, for actions [B, A] int64 in 0..K-1."""
    hard = torch.zeros(*actions.shape, options, dtype=dtype, device=actions.device)
    return hard.scatter_(-1, actions.unsqueeze(-1), 1.0)
