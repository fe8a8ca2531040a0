"""Share of a course that an episode has achieved, for `info` and critics."""

from typing import Any

import numpy as np

from thalweg.env.config import EnvConfig
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.priced.station import greatest_ways
from thalweg.env.task.rules import State


def progress_of(config: EnvConfig, courses: CourseArrays, state: State) -> np.ndarray:
    """Return the share [N] of the course that was visited, or in `Portage` that was gained towards the station."""
    if config.task_record.portage:
        return share_gained(state.way, greatest_ways(courses, state.world))
    return state.visited_count / courses.segments[state.world]


def share_gained(way: Any, greatest_way: Any) -> Any:
    """Return the share [N] that was gained towards the station, from the metres [N] left and the greatest way [N]; all
    arrays, or all tensors."""
    return (1.0 - way / greatest_way).clip(0.0, 1.0)
