"""What would a pilot like to know where it is? Distances, heading error and height, from the map.

No policy sees these: they are what is looked for in the codes of frames.
"""

import numpy as np

from thalweg.core.jit import kernel
from thalweg.env.config import DEFAULT_CONFIG, EnvConfig
from thalweg.env.initial_poses import heading_way, located
from thalweg.env.task.course_arrays import Courses, pack
from thalweg.env.task.motion import wrapped
from thalweg.env.task.progress import between, direction
from thalweg.world.record import World

BEARINGS = ("left bank", "right bank", "heading error", "height", "bridge")
"""Metres to either bank, straight across, in the direction of travel; radians by which the heading is to the left of
the course in that direction; metres above the water; metres along the course to the middle of the next bridge ahead."""
SIGHT_M = 60.0
"""Bridges further ahead than this count as not there: NaN."""


def bearings(world: World, poses: np.ndarray, config: EnvConfig = DEFAULT_CONFIG) -> np.ndarray:
    """What is true at poses [K, 4] in a world: [K, 5] float64, columns as in `BEARINGS`.

    The direction of travel is the one along the course that is nearer to the heading.
    """
    courses = pack([world], config)
    found = np.full((len(poses), len(BEARINGS)), np.nan)
    _fill(courses, np.ascontiguousarray(poses, np.float64), found)
    found[:, 4] = _to_bridge(courses, poses)
    return found


@kernel(fastmath=False)
def _fill(courses, poses, found):
    """The first four columns."""
    for row in range(len(poses)):
        x, y, z, yaw = poses[row, 0], poses[row, 1], poses[row, 2], poses[row, 3]
        segment, fraction, _ = located(courses, 0, x, y)
        travel = heading_way(courses, 0, segment, fraction, yaw)
        course = direction(courses, 0, segment, fraction) + (0.0 if travel > 0 else np.pi)
        dx = x - between(courses, 0, segment, fraction, courses.position[:, 0])
        dy = y - between(courses, 0, segment, fraction, courses.position[:, 1])
        left = dy * np.cos(course) - dx * np.sin(course)
        half = 0.5 * between(courses, 0, segment, fraction, courses.width)
        found[row, 0] = half - left
        found[row, 1] = half + left
        found[row, 2] = wrapped(yaw - course)
        found[row, 3] = z - between(courses, 0, segment, fraction, courses.level)


def _to_bridge(courses: Courses, poses: np.ndarray) -> np.ndarray:
    """[K] metres along the course to the middle of the next bridge ahead; NaN for none within `SIGHT_M`."""
    middles = 0.5 * (courses.bridge_box[:, :2] + courses.bridge_box[:, 3:5])
    bridges = np.array([_arc(courses, x, y)[0] for x, y in middles])
    found = np.full(len(poses), np.nan)
    for row, (x, y, _, yaw) in enumerate(poses):
        arc, travel = _arc(courses, x, y, yaw)
        ahead = travel * (bridges - arc)
        if courses.closed[0]:
            ahead = ahead % courses.length[0]
        near = ahead[(ahead >= 0) & (ahead <= SIGHT_M)]
        if len(near):
            found[row] = near.min()
    return found


def _arc(courses: Courses, x: float, y: float, yaw: float = 0.0) -> tuple[float, int]:
    """Metres of course to the place nearest to x, y, and the direction of travel there."""
    segment, fraction, _ = located(courses, 0, x, y)
    ends = np.append(courses.arc, courses.length[0])
    arc = ends[segment] + fraction * (ends[segment + 1] - ends[segment])
    return float(arc), int(heading_way(courses, 0, segment, fraction, yaw))
