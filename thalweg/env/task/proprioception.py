"""Proprioception: what a vehicle measures of itself, by an altimeter, odometry and a gyroscope.

Motion is measured over the last step, whatever caused it, so that it also tells what wind and inertia do.
"""

from typing import NamedTuple

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.task.ideal_eye import from_vehicle
from thalweg.env.task.motion import wrap_angle
from thalweg.env.task.progress import interpolate, track_projection

PROPRIOCEPTION = (
    "height",
    "forward velocity",
    "left velocity",
    "climb rate",
    "yaw rate",
    "last up",
    "last turn",
    "last forward",
    "last left",
)
"""Names of the numbers.

* height: metres above the water under the vehicle, as the rules measure it.
* forward velocity, left velocity, climb rate: metres per second, the mean of the last step, along and across the
  heading after it, and upwards.
* yaw rate: radians per second, the mean of the last step, positive to the left.
* last up, turn, forward, left: the action of the last step in -1..1, +1 = up, turn left, forward, left, as it was
  commanded, whether or not the vehicle could follow. In a task with a fast step, last forward is a `UnitAction.forward`
  and not the action itself: from 0 to 1 a share of the plain step, and below 0 a share of the fast step.

At the beginning of an episode all but the height are 0.
"""


class LastStep(NamedTuple):
    """What is remembered of the last step of N episodes: arrays, or tensors."""

    pose: np.ndarray
    """[N, 4] float64, poses before the step: x, y, z (metres), yaw (radians); the present one in a new episode."""
    action: np.ndarray
    """[N, 4] float64, unit actions with the columns of `thalweg.env.task.motion.UnitAction`; 0 in a new episode."""


def no_last_step(count: int) -> LastStep:
    """Return what is remembered before the first episodes of N environments."""
    return LastStep(np.zeros((count, 4)), np.zeros((count, 4)))


@kernel(fastmath=False, allocates=False)
def feel_one(courses, step_s, world, pose, segment, last_pose, last_action, out):
    """Fill out [PROPRIOCEPTION] float32 at a pose [4], after a step of `step_s` seconds from last_pose [4] by the unit
    action last_action [4].

    world and segment: integers, those of the episode, see `rules.State`.
    """
    _, projection = track_projection(courses, world, segment, pose[0], pose[1])
    back, right = from_vehicle(pose, last_pose[0], last_pose[1])
    out[0] = pose[2] - interpolate(courses, world, projection, courses.level)
    # Subtracted from 0, which a vehicle that stands still has instead of -0.
    out[1] = (0.0 - back) / step_s
    out[2] = (0.0 - right) / step_s
    out[3] = (pose[2] - last_pose[2]) / step_s
    out[4] = wrap_angle(pose[3] - last_pose[3]) / step_s
    for k in range(4):
        out[5 + k] = last_action[k]


@kernel(fastmath=False, allocates=False)
def feel_all(courses, step_s, world, pose, segment, last_pose, last_action, out):
    """Fill out [M, PROPRIOCEPTION] float32 for M episodes, whose rows the other arrays hold; see `feel_one`."""
    for row in range(len(out)):
        feel_one(courses, step_s, world[row], pose[row], segment[row], last_pose[row], last_action[row], out[row])
