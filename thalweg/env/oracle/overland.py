"""The cheapest way to a gauge station over water and land, on a grid, by Dijkstra's algorithm."""

import numpy as np
import scipy.ndimage
import scipy.sparse
import scipy.sparse.csgraph

from thalweg.core.compute.jit import kernel
from thalweg.env.oracle.ahead import arc_at
from thalweg.env.task.ashore import is_ashore, project_anywhere
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.ideal_eye import arc_length

CELL_M = 1.0
"""Edge of a cell."""
BORDER_M = 4.0
"""Land around the river that may be flown over."""
NEAR_M, NEAR_WEIGHT = 1.5, 0.3
"""Metres within which water is near land, and how much longer a step there seems."""
SHIFTS = tuple((dy, dx) for dy in range(-2, 3) for dx in range(-2, 3) if np.gcd(dy, dx) == 1)
"""Moves between cells: 16 directions."""
BEHIND_M, BEHIND_WEIGHT = (2.0, 6.0), 1000.0
"""Metres behind the start within which water is as good as barred, and how many times as long a step there seems: who
flies along a river must not turn back."""
UNREACHED = 1.0e6
"""Steps from a cell from which no way leads to the station."""


class LandGrid:
    """Cells over a river and the land beside it."""

    def __init__(self, courses: CourseArrays, world: int) -> None:
        first, end = int(courses.first_sample[world]), int(courses.first_sample[world + 1])
        position, margin = courses.position[first:end], 0.5 * courses.width[first:end].max() + BORDER_M
        self.origin = position.min(axis=0) - margin
        """[2] metres: x and y of the centre of the first cell."""
        columns, rows = np.ceil((np.ptp(position, axis=0) + 2 * margin) / CELL_M).astype(int) + 1
        self.ashore = np.zeros((rows, columns), np.uint8)
        """[Y, X], 1 over land."""
        self.arc = np.zeros((rows, columns))
        """[Y, X] metres along the course of the nearest water."""
        _survey(courses, world, self.origin, self.ashore, self.arc)
        self._length, self._closed = float(courses.length[world]), bool(courses.closed[world])

    def ways_to(
        self, station: float, reached_m: float, price_steps: float, pace: float, start: float, travel: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the steps [Y, X] float32 to a station, metres along the course, and the next cell [Y, X] int32, of a
        flight from `start`, metres along the course, that travels along it (1) or against it (-1).

        A step that ends over land takes `price_steps` more; pace: metres a step.
        """
        rows, columns = self.ashore.shape
        # Ways over water keep off the land by more than a step aside where that is no detour to speak of.
        offshore = np.asarray(scipy.ndimage.distance_transform_edt(self.ashore == 0, sampling=CELL_M))
        near = np.where(self.ashore, 0.0, NEAR_WEIGHT * np.clip(1.0 - offshore / NEAR_M, 0.0, 1.0))
        behind = (start - self.arc) * travel
        behind = behind % self._length if self._closed else behind
        barred = (self.ashore == 0) & (behind > BEHIND_M[0]) & (behind < BEHIND_M[1])
        weight = (
            (1.0 + BEHIND_WEIGHT * barred + price_steps * self.ashore + min(price_steps, 1.0) * near) / pace
        ).ravel()
        numbers = np.arange(rows * columns).reshape(rows, columns)
        begins, ends, lengths = [], [], []
        for dy, dx in SHIFTS:
            here = numbers[max(-dy, 0) : rows - max(dy, 0), max(-dx, 0) : columns - max(dx, 0)].ravel()
            begins.append(here)
            ends.append(here + dy * columns + dx)
            lengths.append(np.full(len(here), CELL_M * np.hypot(dy, dx)))
        begin, end, length = map(np.concatenate, (begins, ends, lengths))
        # Ways are searched from the station, so each move is entered backwards.
        graph = scipy.sparse.csr_matrix((length * weight[end], (end, begin)), shape=(numbers.size, numbers.size))
        away = np.abs(self.arc - station)
        away = np.minimum(away, self._length - away) if self._closed else away
        goals = numbers[(away <= reached_m) & (self.ashore == 0)]
        steps, onward, _ = scipy.sparse.csgraph.dijkstra(graph, indices=goals, min_only=True, return_predecessors=True)
        steps[~np.isfinite(steps)] = UNREACHED
        onward = np.where(onward < 0, numbers.ravel(), onward)
        return steps.reshape(rows, columns).astype(np.float32), onward.reshape(rows, columns).astype(np.int32)


@kernel(fastmath=False, allocates=False)
def _survey(courses, world, origin, ashore, arc):
    """Fill ashore [Y, X] and arc [Y, X] of the cells of a grid with an origin [2]."""
    for row in range(ashore.shape[0]):
        for column in range(ashore.shape[1]):
            x = origin[0] + CELL_M * column
            y = origin[1] + CELL_M * row
            projection = project_anywhere(courses, world, x, y)
            ashore[row, column] = 1 if is_ashore(courses, world, projection, x, y) else 0
            arc[row, column] = arc_at(courses, world, 0.0, 1, arc_length(courses, world, projection))
