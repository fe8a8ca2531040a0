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
    """x [P] with H x ≈ b, from products H v of a positive definite H alone (Hestenes, Stiefel 1952).

    Args:
        product: v [P] -> H v [P].
        right: b [P].
        iterations: At most so many; P of them are exact but for rounding.
        tolerance: Of |b - H x|², relative to |b|².
    """
    x, residual = torch.zeros_like(right), right.clone()
    direction, square = residual.clone(), residual.dot(residual)
    enough = tolerance * square
    for _ in range(iterations):
        if square <= enough:
            break
        across = product(direction)
        length = square / direction.dot(across)
        x = x + length * direction
        residual = residual - length * across
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
    """False for a recovery step: no step within the trust region keeps the limit."""


def natural_step(q: float, radius: float) -> float:
    """The factor √(2δ / q) of H⁻¹ g that a step of the size δ has (Schulman et al. 2015), with q = g' H⁻¹ g."""
    return math.sqrt(2.0 * radius / max(q, TINY))


def cpo_step(q: float, r: float, s: float, violation: float, radius: float) -> Direction:
    """The step that solves max g'x subject to b'x + c ≤ 0 and ½ x'Hx ≤ δ (Achiam et al. 2017, section 6 and theorem 2
    of its supplement, there for a minimum).

    With ν(λ) = (λ c + r)₊ / s its dual is the maximum over λ > 0 of two concave functions on either side of λ = -r / c:

        f_a(λ) = (r²/s - q) / 2λ + λ (c²/s - 2δ) / 2 + r c / s      where ν > 0
        f_b(λ) = -(q/λ + 2 δ λ) / 2                                 where ν = 0

    Args:
        q: g' H⁻¹ g, with g the gradient of the reward's surrogate.
        r: g' H⁻¹ b, with b the gradient of the cost's surrogate.
        s: b' H⁻¹ b.
        violation: c, how far the mean cost is above the limit, in the units of the cost's surrogate.
        radius: δ.
    """
    c, edge = violation, 2.0 * radius
    if s <= TINY:  # the cost cannot be changed from here
        return Direction(natural_step(q, radius), 0.0, True)
    room = edge - c * c / s
    if room <= 0:
        if c > 0:
            return Direction(0.0, -math.sqrt(edge / s), False)
        return Direction(natural_step(q, radius), 0.0, True)  # the whole trust region keeps the limit
    inner, outer = _ranges(r, c)
    binding = math.sqrt(max(q - r * r / s, 0.0) / room)
    free = math.sqrt(max(q, TINY) / edge)
    best, scale = -math.inf, free
    if inner is not None:
        at = max(min(max(binding, inner[0]), inner[1]), TINY)
        best, scale = 0.5 * (r * r / s - q) / at - 0.5 * at * room + r * c / s, at
    if outer is not None:
        at = max(min(max(free, outer[0]), outer[1]), TINY)
        if -0.5 * (q / at + edge * at) > best:
            scale = at
    price = max(0.0, scale * c + r) / s
    return Direction(1.0 / scale, -price / scale, True)


Range = tuple[float, float] | None


def _ranges(r: float, c: float) -> tuple[Range, Range]:
    """Where along λ > 0 the limit binds (λ c + r > 0), and where it does not."""
    if c == 0:
        return ((0.0, math.inf), None) if r > 0 else (None, (0.0, math.inf))
    split = -r / c
    if c > 0:
        return (max(split, 0.0), math.inf), (0.0, split) if split > 0 else None
    return (0.0, split) if split > 0 else None, (max(split, 0.0), math.inf)
