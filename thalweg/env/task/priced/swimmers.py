"""Swimmers and kayaks: each moves about a place of the course, to and fro along it and from bank to bank.

Where they are is a function of the episode's scene, a seed, and of the number of its steps, so that neither a state nor
a random generator is needed. Both motions are sines of periods and phases of their own.
"""

import math
from typing import NamedTuple

from thalweg.core.compute.counter_random import uniform
from thalweg.core.compute.jit import kernel
from thalweg.env.task.motion import ROUNDING, metres_forward, wrap_angle
from thalweg.env.task.priced.packing import REACH_M
from thalweg.env.task.progress import course_direction, interpolate, projection_at
from thalweg.render.records.props import PropKind

SWIMMER, KAYAK = int(PropKind.SWIMMER), int(PropKind.KAYAK)

KAYAK_SHARE = 0.25
"""Share of kayaks."""
SWIMMER_REACH_M = 3.0
"""Greatest distance of a swimmer from its place, along the course; a kayak's is `REACH_M`."""
ACROSS_STEPS = (80.0, 160.0)
"""Range of the time from bank to bank and back, in steps: at most about 1 m/s, at 4 steps a second and 3 m aside."""
ALONG_STEPS = (120.0, 240.0)
"""The same of the time along the course: at most about 2 m/s for a kayak."""
BANK_GAP_M = 0.8
"""Least distance from a bank."""
STROKE_STEPS = 5.0
"""Time of a stroke of arms or paddle, in steps."""


class Mover(NamedTuple):
    """A swimmer or kayak at a time."""

    kind: int
    """`SWIMMER` or `KAYAK`."""
    x: float
    """Metres."""
    y: float
    level: float
    """Metres, height z of the water."""
    yaw: float
    """Radians, the direction of its motion."""
    phase: float
    """Radians, of its strokes."""


@kernel(fastmath=False, allocates=False)
def between(ends, share):
    """Return the number at a share in 0..1 of a range."""
    return ends[0] + share * (ends[1] - ends[0])


@kernel(fastmath=False, allocates=False)
def mover_at(courses, world, scene, steps, index):
    """Return the `Mover` with an index, after so many steps of an episode with a scene; all integers."""
    count = courses.first_haunt[world + 1] - courses.first_haunt[world]
    place = min(int((index + uniform(scene, index, 0)) * count / courses.swimmers[world]), count - 1)
    home = courses.haunt[courses.first_haunt[world] + place]
    kind = KAYAK if uniform(scene, index, 1) < KAYAK_SHARE else SWIMMER
    reach = REACH_M if kind == KAYAK else SWIMMER_REACH_M
    turn = 2.0 * math.pi
    along_rate = turn / between(ALONG_STEPS, uniform(scene, index, 2))
    across_rate = turn / between(ACROSS_STEPS, uniform(scene, index, 3))
    along = along_rate * steps + turn * uniform(scene, index, 4)
    across = across_rate * steps + turn * uniform(scene, index, 5)
    arc = home + reach * math.sin(along)
    if courses.closed[world] != 0:
        arc = arc % courses.length[world]
    centre = projection_at(courses, world, arc)
    room = max(0.5 * interpolate(courses, world, centre, courses.width) - BANK_GAP_M, 0.0)
    course = course_direction(courses, world, centre)
    aside = room * math.sin(across)
    heading = math.atan2(room * across_rate * math.cos(across), reach * along_rate * math.cos(along))
    return Mover(
        kind,
        interpolate(courses, world, centre, courses.position[:, 0]) - aside * math.sin(course),
        interpolate(courses, world, centre, courses.position[:, 1]) + aside * math.cos(course),
        interpolate(courses, world, centre, courses.level),
        wrap_angle(course + heading),
        wrap_angle(turn * (steps / STROKE_STEPS + uniform(scene, index, 6))),
    )


@kernel(fastmath=False, allocates=False)
def passing_cost(courses, world, limits, scene, steps, action, pose):
    """Return 1.0 for a fast step, by a `UnitAction`, that ended at a `Pose` near a swimmer or kayak, else 0.0."""
    if metres_forward(action, limits) <= limits.forward_step * (1.0 + ROUNDING):
        return 0.0
    for index in range(courses.swimmers[world]):
        mover = mover_at(courses, world, scene, steps, index)
        if math.hypot(mover.x - pose.x, mover.y - pose.y) <= limits.task.passing_distance:
            return 1.0
    return 0.0
