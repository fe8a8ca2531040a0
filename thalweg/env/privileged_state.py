"""Privileged state: distances, heading error and height of a pose, which studies probe the codes of frames for.

The observation `privileged` is another set of numbers, see `thalweg.env.task.ideal_eye`. Here the direction of travel
follows from the heading.
"""

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.config import DEFAULT_CONFIG, EnvConfig
from thalweg.env.initial_poses import project_anywhere, travel_direction
from thalweg.env.task.course_arrays import CourseArrays, pack_courses
from thalweg.env.task.ideal_eye import arc_length
from thalweg.env.task.motion import wrap_angle
from thalweg.env.task.progress import course_direction, interpolate
from thalweg.world.record import World

PRIVILEGED_NAMES = ("left bank", "right bank", "heading error", "height", "bridge")
"""Metres to the left and right bank, perpendicular to the direction of travel; radians by which the heading points to
the left of that direction; metres above the water; metres along the course to the middle of the next bridge ahead."""
BRIDGE_RANGE_M = 60.0
"""Bridges further ahead than this do not count: the distance is NaN."""


def privileged_state(world: World, poses: np.ndarray, config: EnvConfig = DEFAULT_CONFIG) -> np.ndarray:
    """Return the privileged state [K, 5] float64 of poses [K, 4] in a world, with the columns `PRIVILEGED_NAMES`.

    The direction of travel is the direction along the course that is closer to the heading.
    """
    courses = pack_courses([world], config)
    values = np.full((len(poses), len(PRIVILEGED_NAMES)), np.nan)
    _fill_distances(courses, np.ascontiguousarray(poses, np.float64), values)
    values[:, 4] = _bridge_distances(courses, poses)
    return values


@kernel(fastmath=False, allocates=False)
def _fill_distances(courses, poses, values):
    """Fill all columns of values [K, 5] but the last, from poses [K, 4]."""
    for row in range(len(poses)):
        x, y, z, yaw = poses[row, 0], poses[row, 1], poses[row, 2], poses[row, 3]
        projection = project_anywhere(courses, 0, x, y)
        travel = travel_direction(courses, 0, projection, yaw)
        course = course_direction(courses, 0, projection) + (0.0 if travel > 0 else np.pi)
        dx = x - interpolate(courses, 0, projection, courses.position[:, 0])
        dy = y - interpolate(courses, 0, projection, courses.position[:, 1])
        left = dy * np.cos(course) - dx * np.sin(course)
        half_width = 0.5 * interpolate(courses, 0, projection, courses.width)
        values[row, 0] = half_width - left
        values[row, 1] = half_width + left
        values[row, 2] = wrap_angle(yaw - course)
        values[row, 3] = z - interpolate(courses, 0, projection, courses.level)


def _bridge_distances(courses: CourseArrays, poses: np.ndarray) -> np.ndarray:
    """Return the distances [K] in metres along the course to the middle of the next bridge ahead; NaN if there is none
    within `BRIDGE_RANGE_M`."""
    middles = 0.5 * (courses.bridge_box[:, :2] + courses.bridge_box[:, 3:5])
    bridges, _ = _arc_lengths(courses, middles, np.zeros(len(middles)))
    arcs, travels = _arc_lengths(courses, poses[:, :2], poses[:, 3])
    distances = np.full(len(poses), np.nan)
    for row, (arc, travel) in enumerate(zip(arcs, travels, strict=True)):
        ahead = travel * (bridges - arc)
        if courses.closed[0]:
            ahead = ahead % courses.length[0]
        near = ahead[(ahead >= 0) & (ahead <= BRIDGE_RANGE_M)]
        if len(near):
            distances[row] = near.min()
    return distances


def _arc_lengths(courses: CourseArrays, points: np.ndarray, yaws: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the arc lengths [K] in metres of the projections of points [K, 2], and the directions of travel [K] there
    for headings of yaws [K] radians."""
    arcs, travels = np.empty(len(points)), np.empty(len(points))
    _fill_arc_lengths(courses, np.array(points, np.float64), np.array(yaws, np.float64), arcs, travels)
    return arcs, travels


@kernel(fastmath=False, allocates=False)
def _fill_arc_lengths(courses, points, yaws, arcs, travels):
    """Fill arcs [K] and travels [K] of `_arc_lengths`."""
    for row in range(len(points)):
        projection = project_anywhere(courses, 0, points[row, 0], points[row, 1])
        arcs[row] = arc_length(courses, 0, projection)
        travels[row] = travel_direction(courses, 0, projection, yaws[row])
