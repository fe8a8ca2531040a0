"""The law by which pilots pursue a point ahead (pure pursuit; Coulter, 1992), as a function for their kernels."""

import math

from thalweg.core.compute.jit import kernel
from thalweg.env.task.motion import UnitAction


@kernel(fastmath=False, allocates=False)
def pursue(limits, yaw, error, dx, dy):
    """Return the `UnitAction` of the law but for the climb: to the pursued point, forward when it is in front, and
    aside to it.

    yaw: heading in radians; error: radians to turn to the pursued point, which lies dx, dy metres away.
    """
    turn = sign_beyond(error, 0.5 * limits.yaw_step)
    # The lateral distance counts from the heading after the turn.
    heading = yaw + turn * limits.yaw_step
    lateral = dy * math.cos(heading) - dx * math.sin(heading)
    return UnitAction(0.0, turn, 1.0 if abs(error) < 1.0 else 0.0, sign_beyond(lateral, limits.lateral_step))


@kernel(fastmath=False, allocates=False)
def sign_beyond(value, least):
    """Return the sign of a value, 0.0 within the least that counts."""
    if value > least:
        return 1.0
    return -1.0 if value < -least else 0.0
