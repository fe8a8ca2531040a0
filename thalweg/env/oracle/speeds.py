"""Plans of fast steps: exact dynamic programming over steps and metres ahead, past swimmers along the centre line, and
for clearance along the best lane.

Where swimmers and kayaks will be is known, for it follows from the episode's scene.
"""

import math

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.oracle.ahead import frame_at
from thalweg.env.task.priced.swimmers import mover_at


@kernel(fastmath=False)
def fill_near(courses, world, scene, distance, start_arc, travel, near):
    """Fill near [T, G] uint8: 1 where a swimmer or kayak is within a distance (metres) of the centre line, after so
    many steps and so many metres ahead of a start."""
    near[:] = 0
    places = np.empty((near.shape[1], 2))
    for ahead in range(near.shape[1]):
        _, places[ahead, 0], places[ahead, 1], _ = frame_at(courses, world, start_arc, travel, float(ahead))
    for steps in range(near.shape[0]):
        for index in range(courses.swimmers[world]):
            mover = mover_at(courses, world, scene, steps, index)
            for ahead in range(near.shape[1]):
                if math.hypot(mover.x - places[ahead, 0], mover.y - places[ahead, 1]) <= distance:
                    near[steps, ahead] = 1


@kernel(fastmath=False, allocates=False)
def fill_speeds(near, along, completed_m, fast_m, metre_worth, price, value, speed):
    """Fill value [T, G] float32 and speed [T, G] int8: return less priced cost to be had until the last step, and the
    move by which it is had: 0 none, 1 a metre forward, 2 a fast step of fast_m metres, a whole number.

    A metre that is not yet visited is worth `metre_worth`; a fast step that ends where near [T, G] is 1 costs 1,
    and each step that ends there along [G]. The course ends completed_m ahead.
    """
    last, metres = near.shape[0] - 1, near.shape[1]
    for steps in range(last, -1, -1):
        for ahead in range(metres):
            best = 0.0
            fastest = 0
            if steps < last and ahead < completed_m:
                best = -1.0e30
                for forward in range(3):
                    reached = min(ahead + (fast_m if forward == 2 else forward), metres - 1)
                    gained = metre_worth * (min(float(reached), completed_m) - ahead)
                    cost = along[reached] + (1.0 if forward == 2 and near[steps + 1, reached] != 0 else 0.0)
                    total = gained - price * cost + value[steps + 1, reached]
                    if total > best + 1.0e-6:
                        best = total
                        fastest = forward
            value[steps, ahead] = best
            speed[steps, ahead] = fastest
