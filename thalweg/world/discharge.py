"""Speed and direction of the current of a river, by the continuity of its discharge.

The same volume passes every cross-section in a second. The bed has the same shape everywhere, scaled by width and depth
(`thalweg.world.generate.terrain`), so that the area of a section is proportional to their product and the speed to its
inverse. Islands and side arms, which divide the water, are not considered.
"""

import numpy as np

from thalweg.world.record import River


def downstream(river: River) -> int:
    """Return the direction of the current along the course, 1 or -1: that in which the water level falls.

    The ends decide on an open course. A loop ends where it begins, and climbs in a short rapid what it fell before
    (`thalweg.world.generate.hydrology`), so that the longer way decides. Still water is given the direction of growing
    arc length.
    """
    if not river.closed:
        return 1 if river.level_m[0] >= river.level_m[-1] else -1
    rise = np.sign(np.roll(river.level_m, -1) - river.level_m)
    length = np.diff(river.arc_m, append=river.length_m)
    return 1 if (rise * length).sum() <= 0 else -1


def relative_speed(river: River) -> np.ndarray:
    """Return the speed [S] of the water in the middle of each section over its mean along the course, positive towards
    growing arc length."""
    speed = 1.0 / (river.width_m * river.depth_m)
    length = np.diff(river.arc_m, append=river.length_m)
    if not river.closed:
        length = np.diff(river.arc_m)
        return downstream(river) * speed / np.average(0.5 * (speed[1:] + speed[:-1]), weights=length)
    mean = np.average(0.5 * (speed + np.roll(speed, -1)), weights=length)
    return downstream(river) * speed / mean
