"""Motion of the camera: each branch of an action moves it by a fixed step, without dynamics.

Order within a step: climb, turn, then move forward and sideways in the new heading, as one straight move. Turning first
lets the camera follow a bend without lag, and matches a body that is rotated before it is translated.
"""

import math
from typing import NamedTuple

from thalweg.core.compute.jit import kernel

ROUNDING = 1.0e-6
"""Share of a step by which float32 may make it longer."""


class Pose(NamedTuple):
    """Position and heading of one camera."""

    x: float
    """Metres, east."""
    y: float
    """Metres, north."""
    z: float
    """Metres, up."""
    yaw: float
    """Radians, counter-clockwise from +x."""


class UnitAction(NamedTuple):
    """Action of one environment, in shares of a step: numbers in -1..1."""

    up: float
    turn: float
    """Positive to the left."""
    forward: float
    """Negative: backward, or where the task has a fast step, forward by that share of it."""
    left: float


@kernel(fastmath=False, allocates=False)
def wrap_angle(angle):
    """Return the same direction in -pi..pi (radians)."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@kernel(fastmath=False, allocates=False)
def metres_forward(action, limits):
    """Return the distance forward of a `UnitAction`."""
    share = action.forward
    if share < 0.0:
        if limits.task.fast_step > 0.0:
            return -share * limits.task.fast_step
        if limits.allow_backward == 0:
            share = 0.0
    return share * limits.forward_step


@kernel(fastmath=False, allocates=False)
def move(pose, action, limits):
    """Return the `Pose` after one step from a `Pose` by a `UnitAction`."""
    forward = metres_forward(action, limits)
    yaw = wrap_angle(pose.yaw + action.turn * limits.yaw_step)
    left = action.left * limits.lateral_step
    cos = math.cos(yaw)
    sin = math.sin(yaw)
    return Pose(
        pose.x + forward * cos - left * sin,
        pose.y + forward * sin + left * cos,
        pose.z + action.up * limits.vertical_step,
        yaw,
    )
