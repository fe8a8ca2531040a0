"""Update rules of a Lagrange multiplier, and the advantage that combines reward and cost.

The dual of max J_r subject to J_c ≤ d is min over λ ≥ 0 of λ (d - J_c). A gradient step on it raises λ while the cost
exceeds the limit.
"""

import math
from collections.abc import Sequence

from torch import Tensor

from thalweg.algos.maths.shapes import same_shape, tensor_like


def relative_violation(cost: float, limit: float) -> float:
    """Return δ = (J_c - d) / max(J_c, d), in -1..1: -1 without any cost, 0 at the limit, towards 1 far above it.

    J_c - d itself is bounded by -d below the limit and by the largest cost above it, so that a multiplier that adds it
    up rises several times as fast as it falls. δ treats half of the limit and twice the limit alike (-½ and ½), and has
    no unit. It is 0 if both are 0.
    """
    larger = max(cost, limit)
    return (cost - limit) / larger if larger > 0 else 0.0


def projected_gradient(value: float, violation: float, rate: float, upper: float) -> float:
    """Return clip(λ + α δ, 0, upper) (Zhang, Vuong, Ross 2020, algorithm 1, with δ = J_c - d)."""
    return min(max(value + rate * violation, 0.0), upper)


def adam(
    value: float, moments: tuple[float, float], count: int, violation: float, rate: float, upper: float
) -> tuple[float, tuple[float, float]]:
    """Return λ after one step of Adam on the loss -λ δ, clipped to 0..upper, and Adam's new moments.

    g = -δ; m ← β₁ m + (1-β₁) g; v ← β₂ v + (1-β₂) g²; λ ← λ - α m̂ / (√v̂ + ε), where hats mark bias correction
    (Kingma, Ba 2015, algorithm 1, with its β₁ = 0.9, β₂ = 0.999, ε = 1e-8).

    Args:
        value: λ.
        moments: m and v.
        count: The number of this step, from 1.
        violation: δ, by which the mean cost of an episode exceeds the limit.
        rate: α. The first step is ±α for any size of the violation.
        upper: Upper bound of λ.
    """
    gradient = -violation
    first = 0.9 * moments[0] + 0.1 * gradient
    second = 0.999 * moments[1] + 0.001 * gradient * gradient
    step = rate * (first / (1.0 - 0.9**count)) / (math.sqrt(second / (1.0 - 0.999**count)) + 1e-8)
    return min(max(value - step, 0.0), upper), (first, second)


def smoothed(before: float, cost: float, keep: float) -> float:
    """Return the exponential mean β before + (1 - β) cost, where `keep` is β."""
    return keep * before + (1.0 - keep) * cost


def pid(integral: float, violation: float, growth: float, *, gain: float, derivative: float) -> float:
    """Return λ = I + K_P δ + K_D max(0, ∂) before it is clipped (Stooke, Achiam, Abbeel 2020, algorithm 2).

    A purely integral multiplier I responds late and overshoots. The violation δ adds an immediate response, and its
    growth ∂ a response before the limit is exceeded.
    """
    return integral + gain * violation + derivative * max(growth, 0.0)


def winds_up(output: float, violation: float, upper: float) -> bool:
    """Return whether the integral part must not change: λ is at its upper bound already, and δ would raise it further.

    What is added to I then has no effect until the violation ends, and takes as long to be removed. Not adding it is
    conditional integration (Åström, Hägglund 1995, section 3.5). At the lower bound I itself is clipped at 0.
    """
    return output >= upper and violation > 0


def combined(rewards: Tensor, costs: Tensor, multipliers: Sequence[float], *, normalised: bool) -> Tensor:
    """Return A_r - Σ_i λ_i A_ci [B], divided by 1 + Σ_i λ_i if `normalised`.

    The division keeps the length of the Lagrangian's gradient from growing with λ (Ray, Achiam, Amodei 2019).

    Args:
        rewards: A_r [B].
        costs: A_c [M, B].
        multipliers: λ [M].
        normalised: Whether to divide.
    """
    same_shape(rewards=rewards, one_cost=costs[0])
    if len(costs) != len(multipliers):
        raise ValueError(f"each cost needs one multiplier, got {len(costs)} costs and {len(multipliers)} multipliers")
    total = rewards - (costs * tensor_like(multipliers, costs).unsqueeze(-1)).sum(0)
    return total / (1.0 + sum(multipliers)) if normalised else total
