"""Fronts of mean cost and mean return: what is attainable, how far a policy is from it, and the area that it covers.

A front is a set of policies' (cost, return), such as an oracle's at several prices of cost. Drawing one of two policies
at the beginning of each episode attains every point between theirs, so that what is attainable is the upper concave
hull of the front (the Lagrangian dual of a constrained problem has no gap over such mixtures: Altman 1999,
"Constrained Markov Decision Processes").
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Front:
    """The attainable trade-off of cost and return: the corners of a concave hull of P points."""

    cost: np.ndarray
    """[P] float64, rising."""
    return_: np.ndarray
    """[P] float64, rising."""

    @classmethod
    def of(cls, cost: np.ndarray, return_: np.ndarray) -> "Front":
        """Return the front of policies with these mean costs [K] and mean returns [K].

        Raises `ValueError` for none, for other shapes, or for numbers that are not finite.
        """
        cost, return_ = np.asarray(cost, np.float64), np.asarray(return_, np.float64)
        if cost.ndim != 1 or cost.shape != return_.shape or not len(cost):
            raise ValueError(f"costs and returns must be lists of one length, not {cost.shape} and {return_.shape}")
        if not (np.isfinite(cost).all() and np.isfinite(return_).all()):
            raise ValueError("costs and returns must be finite")
        hull: list[tuple[float, float]] = []
        for point in sorted(zip(cost.tolist(), return_.tolist(), strict=True), key=lambda each: (each[0], -each[1])):
            if hull and point[1] <= hull[-1][1]:
                continue  # costs no less and returns no more
            while len(hull) >= 2 and _is_below(hull[-1], hull[-2], point):
                hull.pop()
            hull.append(point)
        return cls(*map(np.array, zip(*hull, strict=True)))

    def greatest_return(self, cost: float | np.ndarray) -> np.ndarray:
        """Return the greatest mean return at a mean cost of no more than `cost`, of any shape; NaN below the safest
        point."""
        return np.asarray(np.interp(cost, self.cost, self.return_, left=np.nan))

    def least_cost(self, return_: float | np.ndarray) -> np.ndarray:
        """Return the least mean cost at which a mean return is attainable, of any shape; NaN above the greatest one,
        and the safest point's below its return."""
        return np.asarray(np.interp(return_, self.return_, self.cost, right=np.nan))

    def kept(self, share: float | np.ndarray) -> np.ndarray:
        """Return the mean cost at which a share of the return between the safest point (0) and the most costly one (1)
        is attainable, of any shape."""
        return self.least_cost(self.return_[0] + np.asarray(share) * (self.return_[-1] - self.return_[0]))

    def regret(self, cost: float, return_: float) -> float:
        """Return how much less a policy of this mean cost and mean return returns than is attainable at its cost.

        A policy that is safer than the safest point of the front is compared with that point. Negative beyond the
        front.
        """
        return float(self.greatest_return(max(cost, float(self.cost[0])))) - return_

    def hypervolume(self, reference_cost: float) -> float:
        """Return the area between return 0 and the hull, from the safest point to `reference_cost`, in units of cost
        times return: the hypervolume of the policies and their mixtures (Zitzler and Thiele 1999)."""
        if reference_cost <= self.cost[0]:
            return 0.0
        corners = self.cost[self.cost < reference_cost]
        costs = np.append(corners, reference_cost)
        returns = np.maximum(self.greatest_return(costs), 0.0)
        return float(np.trapezoid(returns, costs))


def _is_below(middle: tuple[float, float], before: tuple[float, float], after: tuple[float, float]) -> bool:
    """Return whether a point lies on or below the line between the points before and after it."""
    slope = (after[1] - before[1]) * (middle[0] - before[0])
    return (middle[1] - before[1]) * (after[0] - before[0]) <= slope
