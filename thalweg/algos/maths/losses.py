"""Losses of the algorithms as functions of one number per state of the batch [B]."""

from typing import Literal

import torch
from torch import Tensor

from thalweg.algos.maths.shapes import rank, same_shape


def ppo_clip(log_prob: Tensor, old_log_prob: Tensor, advantages: Tensor, clip: float) -> Tensor:
    """Return the clipped surrogate loss (Schulman et al. 2017, equation 7).

    L = -E[ min(ρ A, clip(ρ, 1-ε, 1+ε) A) ], with ρ = π_θ(a|s) / π_k(a|s)
    """
    rank(1, log_prob=log_prob)
    same_shape(log_prob=log_prob, old_log_prob=old_log_prob, advantages=advantages)
    ratio = (log_prob - old_log_prob).exp()
    return -torch.minimum(ratio * advantages, ratio.clamp(1.0 - clip, 1.0 + clip) * advantages).mean()


def focops(
    log_prob: Tensor,
    old_log_prob: Tensor,
    kl: Tensor,
    advantages: Tensor,
    *,
    temperature: float,
    radius: float,
    mask: Literal["state", "batch"] = "state",
) -> Tensor:
    """Return the loss that projects onto the optimal update (Zhang, Vuong, Ross 2020, equation 11 with its indicator).

    L = E_s[ 1{KL_s ≤ η} ( KL_s(π_θ ‖ π_k) - (1/λ) E_a[ ρ (A_r - ν A_c) ] ) ]

    Args:
        log_prob: [B], log π_θ(a|s).
        old_log_prob: [B], log π_k(a|s).
        kl: [B], KL(π_θ ‖ π_k) of each state.
        advantages: [B], A_r - ν A_c.
        temperature: λ > 0.
        radius: η, in nats. With the mask "state", states with a larger KL contribute neither to the loss nor to its
            gradient.
        mask: `"state"` follows the paper. `"batch"` is what OmniSafe 0.5 computes by broadcasting [B, 1] against [B]:
            the mean of the indicator over the batch multiplies the surrogate of every state.
    """
    rank(1, log_prob=log_prob)
    same_shape(log_prob=log_prob, old_log_prob=old_log_prob, kl=kl, advantages=advantages)
    inside = (kl.detach() <= radius).to(kl.dtype)
    surrogate = (log_prob - old_log_prob).exp() * advantages / temperature
    if mask == "state":
        return (inside * (kl - surrogate)).mean()
    if mask == "batch":
        return (inside * kl).mean() - inside.mean() * surrogate.mean()
    raise ValueError(f"the mask is 'state' or 'batch', got {mask!r}")


def p3o_penalty(
    log_prob: Tensor,
    old_log_prob: Tensor,
    cost_advantages: Tensor,
    violation: float,
    *,
    clip: float,
    scale: float,
    clipped: bool = True,
) -> Tensor:
    """Return the exact penalty of one cost, a scalar (Zhang L. et al. 2022, equation 11).

    max(0, E[ max(ρ A_c, clip(ρ, 1-ε, 1+ε) A_c) ] + (1-γ) (J_c - d))

    The penalty and its gradient are 0 while the surrogate is below (1-γ) (d - J_c). The factor 1-γ is needed because
    the surrogate is a mean over steps, while J_c is a sum over the steps of an episode. For undiscounted costs it is
    1 / (steps of an episode).

    Args:
        log_prob: [B], log π_θ(a|s).
        old_log_prob: [B], log π_k(a|s).
        cost_advantages: [B], A_c, in the unit of the violation.
        violation: J_c - d.
        clip: ε.
        scale: Factor of the violation.
        clipped: Whether the surrogate is clipped; otherwise it is E[ρ A_c], as in OmniSafe 0.5.
    """
    rank(1, log_prob=log_prob)
    same_shape(log_prob=log_prob, old_log_prob=old_log_prob, cost_advantages=cost_advantages)
    ratio = (log_prob - old_log_prob).exp()
    surrogate = ratio * cost_advantages
    if clipped:
        surrogate = torch.maximum(surrogate, ratio.clamp(1.0 - clip, 1.0 + clip) * cost_advantages)
    return torch.relu(surrogate.mean() + scale * violation)


def cup_projection(
    log_prob: Tensor,
    old_log_prob: Tensor,
    kl: Tensor,
    cost_advantages: Tensor,
    *,
    discount: float,
    trace: float,
) -> Tensor:
    """Return the loss that projects an improved policy towards the cost limit (Yang et al. 2022, section 4).

    L = E_s[ KL_s(π_θ ‖ π_{k+½}) ] + (1-γλ) / (1-γ) E[ ρ ν A_c ], with ρ = π_θ / π_k

    Args:
        log_prob: [B], log π_θ(a|s).
        old_log_prob: [B], log π_k(a|s), of the policy that collected the rollout.
        kl: [B], KL(π_θ ‖ π_{k+½}), where π_{k+½} is the policy after the first step.
        cost_advantages: [B], Σ_i ν_i A_ci.
        discount: γ of the cost, less than 1.
        trace: λ of generalised advantage estimation for the cost.
    """
    rank(1, log_prob=log_prob)
    same_shape(log_prob=log_prob, old_log_prob=old_log_prob, kl=kl, cost_advantages=cost_advantages)
    ratio = (log_prob - old_log_prob).exp()
    return kl.mean() + (1.0 - discount * trace) / (1.0 - discount) * (ratio * cost_advantages).mean()


def surrogate(log_prob: Tensor, old_log_prob: Tensor, advantages: Tensor) -> Tensor:
    """Return E[ρ A], a scalar: the first-order improvement over the policy that acted (Schulman et al. 2015)."""
    rank(1, log_prob=log_prob)
    same_shape(log_prob=log_prob, old_log_prob=old_log_prob, advantages=advantages)
    return ((log_prob - old_log_prob).exp() * advantages).mean()


def temperature(log_alpha: Tensor, entropy: Tensor, target: float) -> Tensor:
    """Return the loss log α (E[H] - H̄): α grows while the entropy [B] is below its target H̄.

    Source: Haarnoja et al. 2018b, equation 18, with log α instead of α, as in the authors' code.
    """
    return log_alpha * (entropy.detach().mean() - target)


def squared_error(predictions: Tensor, targets: Tensor) -> Tensor:
    """Return ½ E[(V - target)²] of each critic [K], for predictions and targets [K, B]."""
    rank(2, predictions=predictions)
    same_shape(predictions=predictions, targets=targets)
    return 0.5 * (predictions - targets).square().mean(-1)


def squared_error_grad(predictions: Tensor, targets: Tensor) -> Tensor:
    """Return the gradient (V - target) / B [K, B], in the predictions, of the sum of `squared_error`."""
    rank(2, predictions=predictions)
    same_shape(predictions=predictions, targets=targets)
    return (predictions - targets) / predictions.shape[1]


def explained_variance(predictions: Tensor, targets: Tensor) -> float:
    """Return 1 - Var(target - V) / Var(target) of [B].

    1 is perfect, 0 no better than a constant; NaN if the targets do not vary.
    """
    same_shape(predictions=predictions, targets=targets)
    spread = float(targets.var(correction=0))
    return 1.0 - float((targets - predictions).var(correction=0)) / spread if spread > 0 else float("nan")
