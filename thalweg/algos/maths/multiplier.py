"""Update rules of a Lagrange multiplier, and the advantage that combines reward and cost.

The dual of max J_r subject to J_c ≤ d is min over λ ≥ 0 of λ (d - J_c). A gradient step on it raises λ while the cost
exceeds the limit.
"""

import math
from collections.abc import Sequence

from torch import Tensor

from thalweg.algos.maths.shapes import same_shape, tensor_like


def projected_gradient(value: float, cost: float, limit: float, rate: float, upper: float) -> float:
    """Return clip(λ + α (J_c - d), 0, upper) (Zhang, Vuong, Ross 2020, algorithm 1)."""
    return min(max(value + rate * (cost - limit), 0.0), upper)


def adam(
    value: float, moments: tuple[float, float], count: int, cost: float, limit: float, rate: float, upper: float
) -> tuple[float, tuple[float, float]]:
    """Return λ after one step of Adam on the loss -λ (J_c - d), clipped to 0..upper, and Adam's new moments.

    g = -(J_c - d); m ← β₁ m + (1-β₁) g; v ← β₂ v + (1-β₂) g²; λ ← λ - α m̂ / (√v̂ + ε), where hats mark bias correction
    (Kingma, Ba 2015, algorithm 1, with its β₁ = 0.9, β₂ = 0.999, ε = 1e-8).

    Args:
        value: λ.
        moments: m and v.
        count: The number of this step, from 1.
        cost: J_c, the mean cost of an episode.
        limit: d.
        rate: α. The first step is ±α for any size of the violation.
        upper: Upper bound of λ.
    """
    gradient = -(cost - limit)
    first = 0.9 * moments[0] + 0.1 * gradient
    second = 0.999 * moments[1] + 0.001 * gradient * gradient
    step = rate * (first / (1.0 - 0.9**count)) / (math.sqrt(second / (1.0 - 0.999**count)) + 1e-8)
    return min(max(value - step, 0.0), upper), (first, second)


def smoothed(before: float, cost: float, keep: float) -> float:
    """Return the exponential mean β before + (1 - β) cost, where `keep` is β."""
    return keep * before + (1.0 - keep) * cost


def pid(integral: float, violation: float, growth: float, *, gain: float, derivative: float, upper: float) -> float:
    """Return λ = clip(I + K_P δ + K_D max(0, ∂), 0, upper) (Stooke, Achiam, Abbeel 2020, algorithm 2).

    A purely integral multiplier I responds late and overshoots. The violation δ = J_c - d adds an immediate response,
    and the growth ∂ of the cost a response before the limit is exceeded.
    """
    return min(max(integral + gain * violation + derivative * max(growth, 0.0), 0.0), upper)


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
