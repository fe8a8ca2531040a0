"""Points of the oracle's fronts as a CSV file: mean cost and mean return of flights that know the map, by price.

The file that comes with the package is written by `thalweg oracle`.
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from math import isfinite
from pathlib import Path

import numpy as np

from thalweg.bench.csv_files import ResultsError, csv_text, read_csv
from thalweg.bench.results.front import Front
from thalweg.core import versions
from thalweg.core.atomic_io import write_atomic

PACKAGED_FRONTS = Path(__file__).with_name("fronts.csv")
FIXED, UNSEEN = "fixed", "unseen"
"""Rivers that were flown: the fixed one of the level, or others."""
KEPT = (0.1, 0.25, 0.5)
"""Shares of the front's span of return that the oracle keeps at a tight, a middle and a generous cost limit."""


@dataclass(frozen=True)
class FrontPoint:
    """Flights of the oracle at one price of cost."""

    task: str
    level: str
    rivers: str
    """`FIXED` or `UNSEEN`."""
    price: float
    """Return that it gives up at most to save a cost of one; infinite where it saves all cost that it can."""
    episodes: int
    return_: float
    """Mean return of an episode, with the ends of its confidence interval; the column is called `return`."""
    return_low: float
    return_high: float
    cost: float
    """Mean cost of an episode, with the ends of its confidence interval."""
    cost_low: float
    cost_high: float
    tasks: int
    """Version of the tasks."""


COLUMNS = tuple(field.name.rstrip("_") for field in fields(FrontPoint))


def write_fronts(path: Path, points: Sequence[FrontPoint]) -> None:
    """Write the points as CSV, atomically."""
    write_atomic(path, csv_text(COLUMNS, [astuple(point) for point in points]))


def read_fronts(path: Path = PACKAGED_FRONTS) -> list[FrontPoint]:
    """Return the points of a file; raises `ResultsError` for one that is half-written, of another kind, or not
    finite."""
    parse = {"int": int, "float": float, "str": str}
    points = []
    for number, row in enumerate(read_csv(path, COLUMNS), start=2):
        try:
            values = [
                parse[getattr(field.type, "__name__", "str")](row[field.name.rstrip("_")])
                for field in fields(FrontPoint)
            ]
        except ValueError as error:
            raise ResultsError(f"{path.name} line {number}: {error}") from error
        point = FrontPoint(*values)
        if not (isfinite(point.return_) and isfinite(point.cost)):
            raise ResultsError(f"{path.name} line {number}: return and cost must be finite")
        points.append(point)
    return points


def points_of(points: Sequence[FrontPoint], task: str, level: str, rivers: str = FIXED) -> list[FrontPoint]:
    """Return the points of a task on some rivers of a level, by rising cost."""
    found = [point for point in points if (point.task, point.level, point.rivers) == (task, level, rivers)]
    return sorted(found, key=lambda point: point.cost)


def packaged_points(task: str, level: str, rivers: str = FIXED) -> list[FrontPoint]:
    """Return the points of a task on some rivers of a level that come with the package, by rising cost; none where one
    of them is of another version of the tasks than today's, since what is left of a front ends elsewhere.

    A level with other banks has the points of the same one with forest, since no rule knows banks.
    """
    points = points_of(read_fronts(), task, level.partition("+")[0], rivers)
    return points if all(point.tasks == versions.TASKS for point in points) else []


def front_of(points: Sequence[FrontPoint]) -> Front:
    """Return the front of some points; raises `ValueError` for none."""
    return Front.of(np.array([point.cost for point in points]), np.array([point.return_ for point in points]))


def cost_limits(front: Front) -> tuple[float, ...]:
    """Return the mean costs at which the oracle keeps the shares `KEPT` of the front's span of return, to two
    significant digits."""
    return tuple(float(f"{cost:.2g}") for cost in front.kept(np.array(KEPT)))
