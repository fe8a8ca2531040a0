"""The objects of a task about a vehicle, for the renderer: swimmers, kayaks, buoys and the station, nearest first."""

import math

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.task.priced.swimmers import mover_at
from thalweg.env.task.progress import course_direction, interpolate, projection_at
from thalweg.render.records.props import KIND, PHASE, PROP_COLUMNS, YAW, PropKind, X, Y, Z

RANGE_M = 80.0
"""Objects further away than this are left out."""
STATION_INSET_M = 0.3
"""Distance of the station's staff from the bank."""
STATION = int(PropKind.STATION)


@kernel(fastmath=False, allocates=False)
def squared_distance(x, y, pose):
    """Return the square in m² of the distance of a place from a pose [4]."""
    return (x - pose[0]) * (x - pose[0]) + (y - pose[1]) * (y - pose[1])


@kernel(fastmath=False, allocates=False)
def insert(kind, x, y, z, yaw, phase, pose, count, out):
    """Insert an object, seen from a pose [4], into the `count` rows of out [P, 6], which are sorted by distance; return
    how many there are then. Columns as in `thalweg.render.records.props`."""
    # Squares sort as distances do, and take a fraction of the time.
    squared = squared_distance(x, y, pose)
    if squared > RANGE_M * RANGE_M:
        return count
    place = min(count, len(out) - 1)
    if count == len(out) and squared_distance(out[place, X], out[place, Y], pose) <= squared:
        return count
    while place > 0 and squared_distance(out[place - 1, X], out[place - 1, Y], pose) > squared:
        for column in range(PROP_COLUMNS):
            out[place, column] = out[place - 1, column]
        place -= 1
    out[place, KIND], out[place, X], out[place, Y], out[place, Z] = kind, x, y, z
    out[place, YAW], out[place, PHASE] = yaw, phase
    return min(count + 1, len(out))


@kernel(fastmath=False, allocates=False)
def props_of(row, courses, limits, world, pose, steps, scene, station, out):
    """Fill out[row] [P, 6] float32 with the objects nearest to a vehicle; rows that are left over are zero.

    world, steps, scene [M] int64, pose [M, 4] and station [M]: as in `thalweg.env.task.rules.State`.
    """
    here, rows = world[row], out[row]
    count = 0
    for index in range(courses.swimmers[here]):
        mover = mover_at(courses, here, scene[row], steps[row], index)
        count = insert(
            mover.kind, mover.x, mover.y, mover.level, mover.yaw, mover.phase, pose[row], count, rows
        )  # fmt: skip
    for buoy in range(courses.first_buoy[here], courses.first_buoy[here + 1]):
        kind, x, y = courses.buoy[buoy, KIND], courses.buoy[buoy, X], courses.buoy[buoy, Y]
        z, yaw, phase = courses.buoy[buoy, Z], courses.buoy[buoy, YAW], courses.buoy[buoy, PHASE]
        count = insert(kind, x, y, z, yaw, phase, pose[row], count, rows)
    if limits.task.portage != 0:
        place = projection_at(courses, here, station[row])
        course = course_direction(courses, here, place)
        aside = 0.5 * interpolate(courses, here, place, courses.width) - STATION_INSET_M
        # It stands at the bank to the right of the course, and looks over the water.
        x = interpolate(courses, here, place, courses.position[:, 0]) + aside * math.sin(course)
        y = interpolate(courses, here, place, courses.position[:, 1]) - aside * math.cos(course)
        level = interpolate(courses, here, place, courses.level)
        count = insert(STATION, x, y, level, course + 0.5 * math.pi, 0.0, pose[row], count, rows)
    for left in range(count, len(rows)):
        for column in range(PROP_COLUMNS):
            rows[left, column] = 0.0


@kernel(fastmath=False, allocates=False)
def all_props(courses, limits, world, pose, steps, scene, station, out):
    """Fill out [M, P, 6] float32 by `props_of`."""
    for row in range(len(out)):
        props_of(row, courses, limits, world, pose, steps, scene, station, out)


def props_in(courses, config, limits, at: tuple[np.ndarray, ...]) -> np.ndarray | None:
    """Return the objects [M, P, 6] float32 about M vehicles, or None in a task without any; limits: those of the
    config; at: world, pose, steps, scene and station, as in `thalweg.env.task.rules.State`."""
    if not config.task_record.props:
        return None
    found = np.empty((len(at[0]), config.task_record.props, PROP_COLUMNS), np.float32)
    all_props(courses, limits, *at, found)
    return found
