"""How does the camera move? No dynamics: each branch of an action moves it by its step at once.

Order inside a step: climb, turn, then forward and to the side in the new heading, as one straight move. Turning first
lets the camera follow a bend with no lag, and matches a body that is rotated before it is translated.
"""

import math

from thalweg.core.jit import kernel


@kernel(fastmath=False)
def wrapped(angle):
    """The same direction in -pi..pi (radians)."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@kernel(fastmath=False)
def moved(x, y, z, yaw, up, left, forward, leftward, limits):
    """Pose (x, y, z, yaw) after one step; up, left (turn), forward, leftward in -1..1, shares of a step."""
    if forward < 0.0 and limits.allow_backward == 0:
        forward = 0.0
    yaw = wrapped(yaw + left * limits.yaw_step)
    ahead = forward * limits.forward_step
    aside = leftward * limits.lateral_step
    cos = math.cos(yaw)
    sin = math.sin(yaw)
    return x + ahead * cos - aside * sin, y + ahead * sin + aside * cos, z + up * limits.vertical_step, yaw
