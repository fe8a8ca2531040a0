"""Steps within a trust region, with and without a cost limit, and the conjugate gradient method."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

TINY = 1e-8


def conjugate_gradient(
    product: Callable[[Tensor], Tensor], right: Tensor, iterations: int, tolerance: float = 1e-10
) -> Tensor:
    """Return x [P] with H x ≈ b, given only products H v of a positive definite H (Hestenes, Stiefel 1952).

    Args:
        product: Function v [P] -> H v [P].
        right: b [P].
        iterations: Largest number of iterations; the result after P of them is exact except for rounding.
        tolerance: Iterations stop once |b - H x|² is at most this times |b|².
    """
    x, residual = torch.zeros_like(right), right.clone()
    direction, square = residual.clone(), residual.dot(residual)
    threshold = tolerance * square
    for _ in range(iterations):
        if square <= threshold:
            break
        curvature = product(direction)
        length = square / direction.dot(curvature)
        x = x + length * direction
        residual = residual - length * curvature
        square, before = residual.dot(residual), square
        direction = residual + (square / before) * direction
    return x


@dataclass(frozen=True)
class Direction:
    """The step x = (H⁻¹ g - ν H⁻¹ b) / λ, or the recovery step x = -√(2δ / s) H⁻¹ b."""

    along_reward: float
    """Factor of H⁻¹ g."""
    along_cost: float
    """Factor of H⁻¹ b."""
    feasible: bool
    """Whether a step within the trust region satisfies the limit; otherwise this is the recovery step."""


def natural_step(q: float, radius: float) -> float:
    """Return √(2δ / q), by which H⁻¹ g is scaled to a step of KL δ (Schulman et al. 2015); q = g' H⁻¹ g."""
    return math.sqrt(2.0 * radius / max(q, TINY))


def cpo_step(q: float, r: float, s: float, violation: float, radius: float) -> Direction:
    """Return the solution of max g'x subject to b'x + c ≤ 0 and ½ x'Hx ≤ δ.

    Source: Achiam et al. 2017, section 6 and theorem 2 of the supplement, which minimises. With ν(λ) = (λ c + r)₊ / s,
    the dual is the maximum over λ > 0 of two concave functions, one on each side of λ = -r / c:

        f_a(λ) = (r²/s - q) / 2λ + λ (c²/s - 2δ) / 2 + r c / s      where ν > 0
        f_b(λ) = -(q/λ + 2 δ λ) / 2                                 where ν = 0

    Args:
        q: g' H⁻¹ g, with g the gradient of the reward's surrogate.
        r: g' H⁻¹ b, with b the gradient of the cost's surrogate.
        s: b' H⁻¹ b.
        violation: c, by which the mean cost exceeds the limit, in the unit of the cost's surrogate.
        radius: δ.
    """
    c, edge = violation, 2.0 * radius
    if s <= TINY:  # no step changes the cost
        return Direction(natural_step(q, radius), 0.0, True)
    margin = edge - c * c / s
    if margin <= 0:  # the plane b'x + c = 0 does not cross the trust region
        if c > 0:
            return Direction(0.0, -math.sqrt(edge / s), False)
        return Direction(natural_step(q, radius), 0.0, True)  # the whole trust region satisfies the limit
    inner, outer = _ranges(r, c)
    # The unconstrained maximum of f_a and of f_b; each is then clipped to the range in which its function is the dual.
    binding = math.sqrt(max(q - r * r / s, 0.0) / margin)
    free = math.sqrt(max(q, TINY) / edge)
    best, scale = -math.inf, free
    if inner is not None:
        at = max(min(max(binding, inner[0]), inner[1]), TINY)
        best, scale = 0.5 * (r * r / s - q) / at - 0.5 * at * margin + r * c / s, at
    if outer is not None:
        at = max(min(max(free, outer[0]), outer[1]), TINY)
        if -0.5 * (q / at + edge * at) > best:
            scale = at
    multiplier = max(0.0, scale * c + r) / s  # ν
    return Direction(1.0 / scale, -multiplier / scale, True)


Range = tuple[float, float] | None


def _ranges(r: float, c: float) -> tuple[Range, Range]:
    """Return the ranges of λ > 0 in which the limit binds (λ c + r > 0) and in which it does not."""
    if c == 0:
        return ((0.0, math.inf), None) if r > 0 else (None, (0.0, math.inf))
    split = -r / c
    if c > 0:
        return (max(split, 0.0), math.inf), (0.0, split) if split > 0 else None
    return (0.0, split) if split > 0 else None, (max(split, 0.0), math.inf)
