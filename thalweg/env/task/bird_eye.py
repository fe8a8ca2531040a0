"""The bird's eye: a small map of the channel ahead of a pose, in the frame of the vehicle.

It is a target of learning. A cell is open where the rules permit flight, between the banks and off the islands.
"""

import math

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.progress import track_projection
from thalweg.env.task.rules import State
from thalweg.env.task.termination import island_at, metres_past_bank

ROWS, COLUMNS = 16, 16
"""Cells ahead and across."""
CELL_M = 1.0
"""Edge of a cell."""
BEHIND_M = 2.0
"""Metres behind the vehicle at which the first row begins."""


@kernel(fastmath=False, allocates=False)
def map_one(courses, world, pose, segment, out):
    """Fill out [ROWS, COLUMNS] uint8 with 1 for each cell whose centre is open, seen from a pose [4].

    Row 0 is the nearest, column 0 the leftmost. world, segment: integers, those of the episode, see `rules.State`.
    """
    cos = math.cos(pose[3])
    sin = math.sin(pose[3])
    for row in range(ROWS):
        ahead = (row + 0.5) * CELL_M - BEHIND_M
        for column in range(COLUMNS):
            left = (0.5 * COLUMNS - column - 0.5) * CELL_M
            x = pose[0] + ahead * cos - left * sin
            y = pose[1] + ahead * sin + left * cos
            _, projection = track_projection(courses, world, segment, x, y)
            dry = metres_past_bank(courses, world, projection) > 0.0 or island_at(courses, world, x, y) >= 0
            out[row, column] = 0 if dry else 1


@kernel(fastmath=False, allocates=False)
def map_all(courses, world, pose, segment, out):
    """Fill out [M, ROWS, COLUMNS] uint8 for poses [M, 4] in worlds [M], with the segment [M] of each."""
    for index in range(len(out)):
        map_one(courses, world[index], pose[index], segment[index], out[index])


def open_water(courses: CourseArrays, state: State) -> np.ndarray:
    """Return the maps [N, ROWS, COLUMNS] uint8 of a state of N episodes."""
    maps = np.empty((len(state.world), ROWS, COLUMNS), np.uint8)
    map_all(courses, state.world, state.pose, state.segment, maps)
    return maps
