"""Numbers that the ideal eye adds for a task to those of the river: swimmers, reserves, clearance, the station.

The paper's task adds nothing. Like the rest of the ideal eye it is what a perfect camera could tell, and the time that
is left, without which a deadline cannot be kept.
"""

import math

from thalweg.core.compute.jit import kernel
from thalweg.env.task.ashore import is_ashore
from thalweg.env.task.ideal_eye import FEATURES, arc_length, from_vehicle, metres_ahead, see_one
from thalweg.env.task.motion import Pose
from thalweg.env.task.priced.clearance import clearance
from thalweg.env.task.priced.reserves import reserve_at
from thalweg.env.task.priced.station import way_to
from thalweg.env.task.priced.swimmers import mover_at
from thalweg.env.task.progress import interpolate, projection_at, track_projection
from thalweg.env.tasks import rules_like
from thalweg.env.vehicle.boat_eye import BOAT_FEATURES

SWIMMERS_SEEN = 3
"""Number of swimmers and kayaks that are seen, the nearest ones."""
RANGE_M = 40.0
"""Swimmers, and reserves along the course, further away than this are not seen."""
CLEARANCE_RANGE_M = 4.0
"""Greatest clearance that is told apart."""
TASK_FEATURES: dict[str, tuple[str, ...]] = {
    "River": (),
    "Swimmers": (
        "time left",
        *(f"swimmer {k} {what}" for k in range(1, SWIMMERS_SEEN + 1) for what in ("distance", "ahead", "left")),
    ),
    "Nests": ("time left", "in a reserve", "reserve begins", "reserve ends"),
    "RacingLine": ("time left", "clearance"),
    "Portage": ("time left", "way to the station", "station ahead", "station left", "over land"),
}
"""Names of the numbers of each task.

* time left: share of the deadline, or of the step limit, in 1..0.
* swimmer: metres over the water to the nearest swimmers and kayaks, `RANGE_M` without one; how far they lie ahead and
  to the left, 0 without one.
* in a reserve: 1 or 0. Reserve begins, ends: metres along the course to the ends of the next one, 0 and what is left
  inside; both `RANGE_M` without one.
* clearance: metres, see `thalweg.env.task.priced.clearance`, at most `CLEARANCE_RANGE_M`.
* station: metres along the course to it, and where it is; over land: 1 or 0.
"""
_AT = len(FEATURES)


def features_of(task: str, vehicle: str = "uav") -> tuple[str, ...]:
    """Return the names of all numbers that the ideal eye of a vehicle sees in a task; both as in `EnvConfig`."""
    return (*FEATURES, *TASK_FEATURES[rules_like(task)], *(BOAT_FEATURES if vehicle == "asv" else ()))


@kernel(fastmath=False, allocates=False)
def see_in_task(row, courses, limits, world, pose, segment, travel, steps, scene, station, out):
    """Fill out[row] [FEATURES + those of the task] float32 as `ideal_eye.see_one`, and with what belongs to the task.

    world, segment, travel, steps, scene [M] int64, pose [M, 4] and station [M]: as in `rules.State`.
    """
    here, at = world[row], Pose(pose[row, 0], pose[row, 1], pose[row, 2], pose[row, 3])
    see_one(courses, limits.max_height, here, pose[row], segment[row], travel[row], out[row])
    _, projection = track_projection(courses, here, segment[row], at.x, at.y)
    out[row, _AT] = 1.0 - steps[row] / courses.max_steps[here]
    if limits.task.passing_distance > 0.0:
        see_swimmers(courses, here, pose[row], steps[row], scene[row], out[row])
    if limits.task.reserve_height > 0.0:
        see_reserve(courses, here, arc_length(courses, here, projection), travel[row], out[row])
    if limits.task.clearance > 0.0:
        out[row, _AT + 1] = clearance(courses, here, projection, at, CLEARANCE_RANGE_M)
    if limits.task.portage != 0:
        see_station(courses, here, projection, pose[row], station[row], out[row])


@kernel(fastmath=False, allocates=False)
def see_swimmers(courses, world, pose, steps, scene, out):
    """Fill the numbers of the nearest swimmers and kayaks in out."""
    first = _AT + 1
    for k in range(SWIMMERS_SEEN):
        out[first + 3 * k] = RANGE_M
        out[first + 3 * k + 1] = 0.0
        out[first + 3 * k + 2] = 0.0
    last = first + 3 * (SWIMMERS_SEEN - 1)
    for index in range(courses.swimmers[world]):
        mover = mover_at(courses, world, scene, steps, index)
        distance = math.hypot(mover.x - pose[0], mover.y - pose[1])
        if distance >= out[last]:
            continue
        # Those that are further away move one place back.
        place = last
        while place > first and out[place - 3] > distance:
            for column in range(3):
                out[place + column] = out[place - 3 + column]
            place -= 3
        out[place] = distance
        out[place + 1], out[place + 2] = from_vehicle(pose, mover.x, mover.y)


@kernel(fastmath=False, allocates=False)
def see_reserve(courses, world, arc, travel, out):
    """Fill the numbers of the reserve around an arc length in metres, or of the next one in the direction of travel."""
    begins = RANGE_M
    ends = RANGE_M
    inside = reserve_at(courses, world, arc)
    if inside >= 0:
        row = courses.first_reserve[world] + inside
        begins = 0.0
        ends = min(courses.reserve[row, 1] - arc if travel > 0 else arc - courses.reserve[row, 0], RANGE_M)
    else:
        for row in range(courses.first_reserve[world], courses.first_reserve[world + 1]):
            entry = courses.reserve[row, 0] if travel > 0 else courses.reserve[row, 1]
            ahead = metres_ahead(courses, world, arc, travel, entry, 0.0)
            if 0.0 <= ahead < begins:
                begins = ahead
                ends = min(ahead + courses.reserve[row, 1] - courses.reserve[row, 0], RANGE_M)
    out[_AT + 1] = 1.0 if inside >= 0 else 0.0
    out[_AT + 2] = begins
    out[_AT + 3] = ends


@kernel(fastmath=False, allocates=False)
def see_station(courses, world, projection, pose, station, out):
    """Fill the numbers of the station, so many metres along the course, in out; `projection` is that of the pose."""
    out[_AT + 1], _ = way_to(courses, world, arc_length(courses, world, projection), station)
    place = projection_at(courses, world, station)
    out[_AT + 2], out[_AT + 3] = from_vehicle(
        pose,
        interpolate(courses, world, place, courses.position[:, 0]),
        interpolate(courses, world, place, courses.position[:, 1]),
    )
    out[_AT + 4] = 1.0 if is_ashore(courses, world, projection, pose[0], pose[1]) else 0.0


@kernel(fastmath=False, allocates=False)
def see_all_in_task(courses, limits, world, pose, segment, travel, steps, scene, station, out):
    """Fill out [M, FEATURES + those of the task] float32 by `see_in_task`."""
    for row in range(len(out)):
        see_in_task(row, courses, limits, world, pose, segment, travel, steps, scene, station, out)
