"""Altimeter: the height of the vehicle above the water under it, which any vehicle can measure."""

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.progress import interpolate, track_projection
from thalweg.env.task.rules import State


def heights_above_water(courses: CourseArrays, state: State) -> np.ndarray:
    """Return the heights [N] float64 in metres of a state of N episodes, as the rules measure them."""
    heights = np.empty(len(state.world))
    _fill_heights(courses, state.world, state.pose, state.segment, heights)
    return heights


@kernel(fastmath=False, allocates=False)
def _fill_heights(courses, worlds, poses, segments, heights):
    """Fill heights [N] of poses [N, 4] in worlds [N], with the segment [N] of each."""
    for row in range(len(heights)):
        world = worlds[row]
        _, projection = track_projection(courses, world, segments[row], poses[row, 0], poses[row, 1])
        heights[row] = poses[row, 2] - interpolate(courses, world, projection, courses.level)
