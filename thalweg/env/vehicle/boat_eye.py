"""Numbers that the ideal eye of a boat adds to those of the UAV: water below the keels, rocks and arches, in metres.

"Ahead" and "left" are along and across the heading, as for `thalweg.env.task.ideal_eye`.
"""

import math

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.vehicle.hull import depth_at, least_depth

AHEAD_M = (2.0, 4.0, 7.0)
LEFT_M = (1.5, 0.0, -1.5)
"""Where the water is measured, from the middle of the boat."""
RANGE_M = 16.0
"""Rocks and bridges further away than this are not seen."""
DEEP_M, DRY_M = 2.0, -1.0
"""Range of the depths that are told: learners standardise each number, and how deep a pool is or how high land
decides nothing."""
BOAT_FEATURES = (
    "keel",
    *(f"keel at {ahead:g} m, {left:g} m left" for ahead in AHEAD_M for left in LEFT_M),
    "rock",
    "rock ahead",
    "rock left",
    "rock radius",
    "arch ahead",
    "arch left",
    "arch half opening",
)
"""Names of the numbers.

* keel: water below the keels, the least under any part of the hull. Keel at: the same at a point, `DRY_M` to `DEEP_M`.
* rock: from the middle of the boat to the nearest rock ahead of the stern, to its edge, `RANGE_M` without one. Then
  where its centre is, and its radius; 0 without one.
* arch: where the middle of the nearest bridge ahead of the stern is, and half of the opening that hull and mast have;
  0 without one within `RANGE_M`.
"""
_AHEAD, _LEFT = np.array(AHEAD_M), np.array(LEFT_M)


@kernel(fastmath=False, allocates=False)
def see_boat(courses, limits, world, pose, out):
    """Fill the last of out [FEATURES + BOAT_FEATURES] float32 with what is seen from a pose [4]."""
    x, y, yaw = pose[0], pose[1], pose[3]
    cos = math.cos(yaw)
    sin = math.sin(yaw)
    at = len(out) - (8 + len(_AHEAD) * len(_LEFT))
    out[at] = _told(least_depth(courses, world, x, y, yaw, limits) - limits.draught)
    at += 1
    for i in range(len(_AHEAD)):
        for j in range(len(_LEFT)):
            depth = depth_at(courses, world, x + _AHEAD[i] * cos - _LEFT[j] * sin, y + _AHEAD[i] * sin + _LEFT[j] * cos)
            out[at] = _told(depth - limits.draught)
            at += 1
    _see_rock(courses, limits, world, pose, at, out)
    _see_arch(courses, limits, world, pose, at + 4, out)


@kernel(fastmath=False, allocates=False)
def _told(depth):
    """Return a depth within the range that is told."""
    return min(max(depth, DRY_M), DEEP_M)


@kernel(fastmath=False, allocates=False)
def _see_rock(courses, limits, world, pose, at, out):
    """Fill the four numbers of the nearest rock from out[at] on."""
    nearest = RANGE_M
    for k in range(1, 4):
        out[at + k] = 0.0
    for rock in range(courses.first_rock[world], courses.first_rock[world + 1]):
        dx = courses.rock[rock, 0] - pose[0]
        dy = courses.rock[rock, 1] - pose[1]
        ahead = dx * math.cos(pose[3]) + dy * math.sin(pose[3])
        distance = math.hypot(dx, dy) - courses.rock[rock, 2]
        if ahead > -limits.half_length and distance < nearest:
            nearest = distance
            out[at + 1] = ahead
            out[at + 2] = dy * math.cos(pose[3]) - dx * math.sin(pose[3])
            out[at + 3] = courses.rock[rock, 2]
    out[at] = nearest


@kernel(fastmath=False, allocates=False)
def _see_arch(courses, limits, world, pose, at, out):
    """Fill the three numbers of the nearest bridge from out[at] on."""
    nearest = RANGE_M
    for k in range(3):
        out[at + k] = 0.0
    for bridge in range(courses.first_bridge[world], courses.first_bridge[world + 1]):
        dx = courses.arch[bridge, 0] - pose[0]
        dy = courses.arch[bridge, 1] - pose[1]
        ahead = dx * math.cos(pose[3]) + dy * math.sin(pose[3])
        distance = math.hypot(dx, dy)
        if ahead > -limits.half_length - courses.arch[bridge, 5] and distance < nearest:
            nearest = distance
            out[at] = ahead
            out[at + 1] = dy * math.cos(pose[3]) - dx * math.sin(pose[3])
            out[at + 2] = min(courses.arch[bridge, 6], courses.arch[bridge, 7] + limits.half_beam)


@kernel(fastmath=False, allocates=False)
def see_boats(courses, limits, world, pose, out):
    """Fill the last of out [M, FEATURES + BOAT_FEATURES] for poses [M, 4] in worlds [M]."""
    for row in range(len(out)):
        see_boat(courses, limits, world[row], pose[row], out[row])
