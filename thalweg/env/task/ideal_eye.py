"""The ideal eye: what a perfect camera could tell of the river at a pose, in metres and radians.

It separates seeing from learning: a policy that sees these numbers needs no frames. They are local, as a view is. What
was visited so far, and on which river the vehicle flies, is absent on purpose.

The direction of travel is that of the episode. "Ahead" and "left" are along and across the heading.
"""

import math

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.task.motion import wrap_angle
from thalweg.env.task.progress import (
    Projection,
    course_direction,
    interpolate,
    sample_rows,
    segment_at_offset,
    track_projection,
)

POINTS_M = (2.0, 4.0, 7.0, 11.0, 16.0, 24.0)
"""Distances along the course, from the vehicle, of the points of the course that are seen."""
RANGE_M = 16.0
"""Bridges and islands further along the course than this are not seen. Learners standardise each number: where distant
islands are seen too, these fill the scale, and policies fly into islands."""
FEATURES = (
    "heading error",
    "left bank",
    "right bank",
    "height",
    "room above",
    *(f"{name} at {metres:g} m" for metres in POINTS_M for name in ("ahead", "left", "half width", "level")),
    "bridge",
    "bridge underside",
    "bridge top",
    "island",
    "island ahead",
    "island left",
    "island half length",
    "island half width",
)
"""Names of the numbers.

* heading error: radians by which the heading points to the left of the direction of travel.
* left bank, right bank: metres to the banks, across the direction of travel; negative beyond a bank.
* height, room above: metres above the water, and to the greatest height that is allowed.
* ahead, left, half width and level at a point of the course: where it is from the vehicle, half the distance between
  the banks there, and the water's level relative to that at the vehicle. Past the end of an open course they are those
  of its end.
* bridge: metres along the course to the middle of the next bridge, `RANGE_M` without one, which counts until its middle
  is `BEHIND_M` behind. Underside and top: the lowest and highest point of the bridge, grown by half the body, above the
  vehicle's centre; 0 without one.
* island: metres along the course to the centre of the next island, `RANGE_M` without one, which counts until its middle
  is half its length behind. Then where the centre is, and half of its axes; 0 without one.
"""
MIRRORED = {
    name: (
        {"left bank": "right bank", "right bank": "left bank"}.get(name, name),
        -1.0 if name in ("heading error", "island left") or name.startswith("left at") else 1.0,
    )
    for name in FEATURES
}
"""What each number is in the mirror image of a view: another number, or itself, and its sign."""
BEHIND_M = 3.0
"""Metres behind the vehicle up to which the middle of a bridge still counts as that of the next."""
_POINTS = np.array(POINTS_M)
_POINT_AT, _BRIDGE_AT, _ISLAND_AT = 5, 5 + 4 * len(POINTS_M), 8 + 4 * len(POINTS_M)


def mirrored(numbers: np.ndarray) -> np.ndarray:
    """Return the numbers [..., FEATURES] of mirror images of views."""
    order, signs = zip(*((FEATURES.index(name), sign) for name, sign in MIRRORED.values()), strict=True)
    return numbers[..., list(order)] * np.array(signs, numbers.dtype)


@kernel(fastmath=False, allocates=False)
def see_one(courses, max_height, world, pose, segment, travel, out):
    """Fill out [FEATURES] float32 with what is seen from a pose [4].

    max_height: metres above the water; world, segment and travel: integers, those of the episode, see `rules.State`.
    """
    x, y, z, yaw = pose[0], pose[1], pose[2], pose[3]
    _, projection = track_projection(courses, world, segment, x, y)
    course = course_direction(courses, world, projection) + (0.0 if travel > 0 else math.pi)
    dx = x - interpolate(courses, world, projection, courses.position[:, 0])
    dy = y - interpolate(courses, world, projection, courses.position[:, 1])
    left = dy * math.cos(course) - dx * math.sin(course)
    half_width = 0.5 * interpolate(courses, world, projection, courses.width)
    level = interpolate(courses, world, projection, courses.level)
    out[0] = wrap_angle(yaw - course)
    out[1] = half_width - left
    out[2] = half_width + left
    out[3] = z - level
    out[4] = max_height - (z - level)
    see_course(courses, world, projection, travel, pose, level, out)
    arc = arc_length(courses, world, projection)
    see_bridge(courses, world, arc, travel, z, out)
    see_island(courses, world, arc, travel, pose, out)


@kernel(fastmath=False, allocates=False)
def see_course(courses, world, projection, travel, pose, level, out):
    """Fill the numbers of the points of the course in out [FEATURES]; level: that of the water at the vehicle."""
    point = projection
    passed = 0.0
    for k in range(len(_POINTS)):
        point = point_ahead(courses, world, point, travel, _POINTS[k] - passed)
        passed = _POINTS[k]
        at = _POINT_AT + 4 * k
        out[at], out[at + 1] = from_vehicle(
            pose,
            interpolate(courses, world, point, courses.position[:, 0]),
            interpolate(courses, world, point, courses.position[:, 1]),
        )
        out[at + 2] = 0.5 * interpolate(courses, world, point, courses.width)
        out[at + 3] = interpolate(courses, world, point, courses.level) - level


@kernel(fastmath=False, allocates=False)
def from_vehicle(pose, x, y):
    """Return how far a point lies ahead and to the left of a pose [4]."""
    dx = x - pose[0]
    dy = y - pose[1]
    cos = math.cos(pose[3])
    sin = math.sin(pose[3])
    return dx * cos + dy * sin, dy * cos - dx * sin


@kernel(fastmath=False, allocates=False)
def segment_length(courses, world, segment):
    """Return the length of a segment in metres, along the course."""
    a, b = sample_rows(courses, world, segment)
    end = courses.arc[b] if b > a else courses.length[world]
    return end - courses.arc[a]


@kernel(fastmath=False, allocates=False)
def arc_length(courses, world, projection):
    """Return the arc length of a `Projection` in metres."""
    a, _ = sample_rows(courses, world, projection.segment)
    return courses.arc[a] + projection.fraction * segment_length(courses, world, projection.segment)


@kernel(fastmath=False, allocates=False)
def point_ahead(courses, world, projection, travel, metres):
    """Return the `Projection` that lies so many metres further in the direction of travel, or the end of the course;
    from a fraction that is NaN, one of NaN."""
    segment = projection.segment
    fraction = projection.fraction
    while True:
        length = segment_length(courses, world, segment)
        left = (1.0 - fraction if travel > 0 else fraction) * length
        if not metres > left:  # NaN ends the search too, which would never end on a loop
            return Projection(segment, fraction + travel * metres / length, 0.0)
        following = segment_at_offset(courses, world, segment, travel)
        if following < 0:
            return Projection(segment, 1.0 if travel > 0 else 0.0, 0.0)
        metres -= left
        segment = following
        fraction = 0.0 if travel > 0 else 1.0


@kernel(fastmath=False, allocates=False)
def metres_ahead(courses, world, arc, travel, other, behind):
    """Return how far the arc length `other` lies ahead of `arc` in metres; on a loop from -behind on."""
    ahead = travel * (other - arc)
    if courses.closed[world] != 0:
        ahead = (ahead + behind) % courses.length[world] - behind
    return ahead


@kernel(fastmath=False, allocates=False)
def see_bridge(courses, world, arc, travel, z, out):
    """Fill the numbers of the next bridge in out [FEATURES]; z: height of the vehicle in metres."""
    nearest = RANGE_M
    underside = 0.0
    top = 0.0
    for b in range(courses.first_bridge[world], courses.first_bridge[world + 1]):
        ahead = metres_ahead(courses, world, arc, travel, courses.bridge_arc[b], BEHIND_M)
        if -BEHIND_M <= ahead < nearest:
            nearest = ahead
            underside = courses.bridge_box[b, 2] - z
            top = courses.bridge_box[b, 5] - z
    out[_BRIDGE_AT] = nearest
    out[_BRIDGE_AT + 1] = underside
    out[_BRIDGE_AT + 2] = top


@kernel(fastmath=False, allocates=False)
def see_island(courses, world, arc, travel, pose, out):
    """Fill the numbers of the next island in out [FEATURES]."""
    nearest = RANGE_M
    for k in range(_ISLAND_AT + 1, _ISLAND_AT + 5):
        out[k] = 0.0
    for i in range(courses.first_island[world], courses.first_island[world + 1]):
        # The axes are divided by their half lengths.
        half_length = 1.0 / math.hypot(courses.island[i, 2], courses.island[i, 3])
        ahead = metres_ahead(courses, world, arc, travel, courses.island_arc[i], half_length)
        if -half_length <= ahead < nearest:
            nearest = ahead
            out[_ISLAND_AT + 1], out[_ISLAND_AT + 2] = from_vehicle(pose, courses.island[i, 0], courses.island[i, 1])
            out[_ISLAND_AT + 3] = half_length
            out[_ISLAND_AT + 4] = 1.0 / math.hypot(courses.island[i, 4], courses.island[i, 5])
    out[_ISLAND_AT] = nearest


@kernel(fastmath=False, allocates=False)
def see_all(courses, max_height, world, pose, segment, travel, out):
    """Fill out [M, FEATURES] float32 for poses [M, 4] in worlds [M], with the segment [M] and travel [M] of each."""
    for row in range(len(out)):
        see_one(courses, max_height, world[row], pose[row], segment[row], travel[row], out[row])
