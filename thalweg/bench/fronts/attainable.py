"""Warnings of cost limits that the oracle does not attain: below the safest point of its front."""

import warnings
from collections.abc import Iterable
from typing import Any

from thalweg.algos import LimitWarning
from thalweg.bench.fronts.fronts import FIXED, UNSEEN, front_of, packaged_points


def below_safest(task: str, level: str, cost_limit: float) -> str:
    """Return a warning of a cost limit of an episode below the cost of the oracle's safest point on a level, whichever
    of fixed and unseen rivers it costs less on; empty for a limit that it attains, and where no front comes with the
    package."""
    fronts = [front_of(points) for rivers in (FIXED, UNSEEN) if (points := packaged_points(task, level, rivers))]
    safest = min(fronts, key=lambda front: front.cost[0], default=None)
    if safest is None or cost_limit >= safest.cost[0]:
        return ""
    return (
        f"cost_limit={cost_limit:g} is below the oracle's safest point in {task} on {level}, a cost of"
        f" {safest.cost[0]:.3g} at a return of {safest.return_[0]:.3g}: no pilot is known to hold it"
    )


def warn_of_limits(task: str, trained: Iterable[tuple[str, str, Any]]) -> None:
    """Warn once of each limit of a task that the oracle does not attain.

    `trained`: name and level of what is trained, and the config of its algorithm, which may know no limit.
    """
    names: dict[tuple[str, float], list[str]] = {}
    for name, level, config in trained:
        if (limit := getattr(config, "cost_limit", None)) is not None:
            names.setdefault((level, limit), []).append(name)
    for (level, limit), own in names.items():
        if found := below_safest(task, level, limit):
            warnings.warn(f"{', '.join(dict.fromkeys(own))}: {found}", LimitWarning, stacklevel=3)
