"""How does a Lagrange multiplier answer to the cost of the last episodes? Pure steps on plain numbers.

The dual of max J_r subject to J_c ≤ d is min over λ ≥ 0 of λ (d - J_c): its gradient step raises λ where the cost
is over the limit.
"""

import math


def projected_gradient(value: float, cost: float, limit: float, rate: float, upper: float) -> float:
    """λ ← clip(λ + α (J_c - d), 0, upper) (Zhang, Vuong, Ross 2020, algorithm 1)."""
    return min(max(value + rate * (cost - limit), 0.0), upper)


def adam(
    value: float, moments: tuple[float, float], count: int, cost: float, limit: float, rate: float, upper: float
) -> tuple[float, tuple[float, float]]:
    """λ after one step of Adam on the loss -λ (J_c - d), clipped to 0..upper, and Adam's new moments.

    g = -(J_c - d); m ← β₁ m + (1-β₁) g; v ← β₂ v + (1-β₂) g²; λ ← λ - α m̂ / (√v̂ + ε), hats for bias correction
    (Kingma, Ba 2015, algorithm 1, with its β₁ = 0.9, β₂ = 0.999, ε = 1e-8).

    Args:
        value: λ.
        moments: m and v.
        count: The number of this step, from 1.
        cost: J_c, the mean cost of an episode.
        limit: d.
        rate: α. The first steps are ±α whatever the size of the violation.
        upper: The largest λ allowed.
    """
    gradient = -(cost - limit)
    first = 0.9 * moments[0] + 0.1 * gradient
    second = 0.999 * moments[1] + 0.001 * gradient * gradient
    step = rate * (first / (1.0 - 0.9**count)) / (math.sqrt(second / (1.0 - 0.999**count)) + 1e-8)
    return min(max(value - step, 0.0), upper), (first, second)


def with_proportion(moving: float, cost: float, limit: float, gain: float, upper: float) -> float:
    """λ = clip(I + K_P (J_c - d), 0, upper) (Stooke, Achiam, Abbeel 2020, algorithm 2, without its derivative).

    A multiplier I that only integrates answers late and overshoots: the violation itself, at once, damps that.
    """
    return min(max(moving + gain * (cost - limit), 0.0), upper)
