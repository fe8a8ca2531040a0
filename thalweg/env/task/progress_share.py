"""Progress of an episode along its course, for `info` and critics."""

from typing import Any

import numpy as np

from thalweg.env.config import EnvConfig
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.priced.station import greatest_ways
from thalweg.env.task.rules import State


def progress_of(config: EnvConfig, courses: CourseArrays, state: State) -> np.ndarray:
    """Return the share [N] of the course that was visited, or in `Portage` the `nearness`."""
    if config.task_record.portage:
        return nearness(state.way, greatest_ways(courses, state.world))
    return state.visited_count / courses.segments[state.world]


def nearness(way: Any, paid_way: Any) -> Any:
    """Return 1 - way / paid_way [N], from 0 to 1, for the metres [N] left to the station and those that are paid in
    full [N], see `greatest_ways`; all arrays, or all tensors.

    An episode starts at 0 on a loop, and above 0 on an open course.
    """
    return (1.0 - way / paid_way).clip(0.0, 1.0)
