"""Numbers of the ideal eye at poses that belong to no episode, which studies probe the codes of frames for.

The direction of travel follows from the heading: it is the one along the course that is closer to it.
"""

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.config import DEFAULT_CONFIG, EnvConfig
from thalweg.env.initial_poses import UnsafePoseError, project_anywhere, travel_direction
from thalweg.env.task.course_arrays import pack_courses
from thalweg.env.task.ideal_eye import FEATURES, see_all
from thalweg.world.record import World


def privileged_state(world: World, poses: np.ndarray, config: EnvConfig = DEFAULT_CONFIG) -> np.ndarray:
    """Return what the ideal eye sees [K, FEATURES] float32 from poses [K, 4] (x, y, z in metres, yaw in radians).

    Raises `UnsafePoseError` for poses of another shape, and for one that is not finite.
    """
    given = np.ascontiguousarray(poses, np.float64)
    if given.ndim != 2 or given.shape[1] != 4:
        raise UnsafePoseError(f"poses must be [K, 4], not {list(given.shape)}")
    count = len(given)
    for row in np.flatnonzero(~np.isfinite(given).all(axis=1)):
        raise UnsafePoseError(f"a pose is four finite numbers x, y, z, yaw, not {given[row].tolist()} (row {row})")
    courses = pack_courses([world], config)
    segment, travel = np.empty(count, np.int64), np.empty(count, np.int64)
    _place_all(courses, given, segment, travel)
    seen = np.empty((count, len(FEATURES)), np.float32)
    see_all(courses, config.limits.max_height, np.zeros(count, np.int64), given, segment, travel, seen)
    return seen


@kernel(fastmath=False, allocates=False)
def _place_all(courses, poses, segment, travel):
    """Fill segment [K] and travel [K], as those of an episode that starts there, for poses [K, 4]."""
    for row in range(len(poses)):
        projection = project_anywhere(courses, 0, poses[row, 0], poses[row, 1])
        segment[row] = projection.segment
        travel[row] = travel_direction(courses, 0, projection, poses[row, 3])
