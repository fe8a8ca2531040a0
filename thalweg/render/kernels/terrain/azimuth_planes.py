"""Kernels that find the ground by vertical planes: one walk over the heights serves a whole column of rays.

The camera does not roll, so all rays of one azimuth lie in one vertical plane through the camera. In such a plane the
surface is a profile of heights over the distance, and a ray is a straight line through the camera: it meets the first
sample whose slope, seen from the camera, reaches its own. This is the visibility by running maxima of slopes of
Timonen, Westerholm, "Scalable Height Field Self-Shadowing", 2010, and of the floating horizon of Wright, "A Two-Space
Solution to the Hidden Line Problem", 1973. Pixels between two planes interpolate their distances and settle on the
surface by a Newton step; doubtful ones are left to `heightfield_march`.

Distances are measured along the camera's heading in the horizontal plane, in metres. A plane's number q is the tangent
of its azimuth from the heading: its points are heading + q * right, times the distance.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import int32, uint32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.camera_rays import image_x, image_y, row_step
from thalweg.render.kernels.table_lookup import bilinear, clamp, sloped, top_map
from thalweg.render.kernels.terrain.heightfield_march import FAR_M
from thalweg.render.records import layout
from thalweg.render.records.view import LANES

f32 = np.float32

PLANES_PER_COLUMN = 0.6
"""Planes for each column of the image, where a column covers most azimuth."""
STEP_SHARE = 0.03
"""`step_share` of an image of 128 rows."""
STEP_NODES = 0.5
"""Least distance between samples, in nodes of the map."""
LEAST_ASPECT = 0.25
"""The planes serve a view whose rays, per metre of depth, get horizontally at least this share of the farthest."""
NEARNESS_LEAST = 1e-6
"""Nearness, in a metre's inverse, below which nothing is met."""
APART = 0.06
"""A pixel is doubtful where the nearness of its two planes differs by more than this share: an edge may lie between."""
APART_REDUCED = 0.3
"""The same for the reduced quality, which then shows the nearer of the two."""
SETTLE_M = 0.08
SETTLE_SHARE = 0.02
"""A pixel is doubtful where the Newton step is longer than SETTLE_M plus this share of its depth."""


class Fan(NamedTuple):
    """Vertical planes through the camera, and the rows that are seen in them."""

    heading_x: Any
    """Nodes per metre ahead, as the next three."""
    heading_y: Any
    right_x: Any
    right_y: Any
    cos_pitch: Any
    sin_pitch: Any
    """Positive for a camera that looks down."""
    half_h: Any
    per_row: Any
    first: Any
    """q of the first plane, and from each to the next."""
    step: Any
    planes: Any
    """Number of planes, an integer: a multiple of `LANES`."""


class Profiles(NamedTuple):
    """The surface in the planes of a fan, as the camera sees it, and scratch for finding what is visible of it."""

    distance: Any
    """[S] float32, of the samples."""
    slope: Any
    """[S * planes] float32, rise from the camera per metre of distance."""
    first: Any
    """[R + 1, planes] int32: the first sample that the rays of each row meet in a plane, S for none. Row 0 is the first
    row of interest; the last one takes what is hidden."""
    free: Any
    """[planes] int32: rows above this one, itself not included, have met nothing so far."""
    target: Any
    """[planes] int32, the row of `first` that a sample is written to."""


@kernel(inlined=True, allocates=False)
def horizontal_reach(camera, row):
    """Metres ahead, along the heading, per metre of depth, of the rays of a row."""
    sy = image_y(camera, row, 1)
    return camera.up_z + sy * (-camera.forward_z)


@kernel(inlined=True, allocates=False)
def ray_slope(camera, row):
    """Rise of the rays of a row per metre ahead in the horizontal plane."""
    sy = image_y(camera, row, 1)
    return (sy * camera.up_z + camera.forward_z) / horizontal_reach(camera, row)


@kernel(inlined=True, allocates=False)
def least_reach(camera):
    """Least `horizontal_reach` of any row, which is that of the first or the last."""
    return min(horizontal_reach(camera, 0), horizontal_reach(camera, camera.height - 1))


@kernel(inlined=True, allocates=False)
def most_reach(camera):
    """Greatest `horizontal_reach` of any row."""
    return max(horizontal_reach(camera, 0), horizontal_reach(camera, camera.height - 1))


@kernel(inlined=True, allocates=False)
def can_serve(camera):
    """Whether planes of azimuth serve a camera: no row looks nearly straight up or down."""
    return least_reach(camera) > f32(LEAST_ASPECT) * most_reach(camera)


def most_planes(width):
    """The greatest number of planes of a camera with so many columns."""
    return int(width * PLANES_PER_COLUMN / LEAST_ASPECT) + 1 + LANES


@kernel(inlined=True, allocates=False)
def fan_of(camera, inv_cell):
    """The `Fan` of a camera that `can_serve` accepts."""
    # Columns cover least azimuth where rays get farthest; the planes reach over the widest row.
    step = camera.column_step / most_reach(camera) * f32(1 / PLANES_PER_COLUMN)
    widest = camera.half_w / least_reach(camera)
    planes = (int32(f32(2) * widest / step) + int32(1 + LANES)) // int32(LANES) * int32(LANES)
    # The camera's right is level and perpendicular to its heading, which has no unit vector of its own here.
    heading_x = -camera.right_y
    heading_y = camera.right_x
    return Fan(
        heading_x * inv_cell, heading_y * inv_cell, camera.right_x * inv_cell, camera.right_y * inv_cell,
        camera.up_z, -camera.forward_z, camera.half_h, row_step(camera),
        f32(-0.5) * f32(planes - int32(1)) * step, step, planes,
    )  # fmt: skip


@kernel(inlined=True, allocates=False)
def step_share(rows):
    """Distance from one sample of a profile to the next, as a share of the distance; rows: those of the image."""
    # The error of a profile between samples is quadratic in their distance: finer images need a root finer steps.
    return f32(STEP_SHARE) * math.sqrt(f32(128) / f32(rows))


@kernel(inlined=True, allocates=False)
def next_distance(distance, cell, rows):
    """The distance of the sample after one at a distance, in metres; cell: side of a cell; rows: those of the image."""
    return distance + max(f32(STEP_NODES) * cell, step_share(rows) * distance)


@kernel(inlined=True, allocates=False)
def far_distance(camera):
    """The distance past which all that rays meet is farther along the axis than `FAR_M`."""
    return f32(FAR_M) * most_reach(camera)


@kernel(allocates=False)
def count_samples(start, far, cell, rows):
    """The number of samples from a distance to the first one that is not before `far`."""
    count = 1
    distance = start
    while distance < far:
        distance = next_distance(distance, cell, rows)
        count += 1
    return count


@kernel(allocates=False)
def place_samples(distance, start, cell, rows):
    """Fill distance [S] with those of the samples from `start` on, as `count_samples` counts them."""
    for j in range(len(distance)):
        distance[j] = start
        start = next_distance(start, cell, rows)


@kernel(inlined=True)
def empty_profiles(fan, samples, rows):
    """`Profiles` of a fan without values, for so many rows."""
    planes = fan.planes
    return Profiles(
        np.empty(samples, np.float32),
        np.empty(samples * planes, np.float32),
        np.empty((rows + 1, planes), np.int32),
        np.empty(planes, np.int32),
        np.empty(planes, np.int32),
    )


@kernel(disjoint=True, allocates=False)
def sample_slopes(scene, world, origin, fan, distance, slope):
    """Fill slope [S * planes] with the rise from the camera to the surface, per metre, at each distance [S]."""
    top = top_map(scene, world)
    for j in range(len(distance)):
        ahead = distance[j]
        inverse = f32(1) / ahead
        base = int32(j) * fan.planes
        for i in range(fan.planes):
            q = fan.first + f32(i) * fan.step
            x = origin.x + (fan.heading_x + q * fan.right_x) * ahead
            y = origin.y + (fan.heading_y + q * fan.right_y) * ahead
            slope[uint32(base + int32(i))] = (bilinear(top, x, y) - origin.z) * inverse


@kernel(inlined=True, allocates=False)
def first_row_below(fan, slope, top, bottom):
    """The first row whose rays are not above a slope, limited to top..bottom."""
    # Straight above or below the camera the tangent turns over; the limit keeps it on the right side.
    sy = (slope * fan.cos_pitch + fan.sin_pitch) / max(fan.cos_pitch - slope * fan.sin_pitch, f32(1e-6))
    row = (fan.half_h - sy) / fan.per_row - f32(0.5)
    # Rounded up, counted from `top` because truncation rounds negative numbers the other way.
    return int32(clamp(row - f32(top), f32(0), f32(bottom - top)) + f32(0.99999)) + int32(top)


@kernel(disjoint=True, allocates=False)
def show_sample(fan, profiles, j, top, bottom):
    """Find the rows that sample j is the first to cover in each plane: moves `free` up, and sets `target`."""
    slope, free, target = profiles.slope, profiles.free, profiles.target
    base = int32(j) * fan.planes
    for i in range(fan.planes):
        row = first_row_below(fan, slope[uint32(base + int32(i))], top, bottom)
        old = free[i]
        # The sample is noted at the lowest of its rows only; `carry_up` fills the others.
        target[i] = old - int32(top) - int32(1) if row < old else int32(bottom - top)
        free[i] = min(row, old)


@kernel(disjoint=True, allocates=False)
def carry_up(fan, profiles, row, top):
    """Fill the entries of a row of `first` at which no sample begins with those of the row below; row 0 is `top`."""
    own, below, free = profiles.first[row], profiles.first[row + 1], profiles.free
    none = int32(len(profiles.distance))
    number = int32(row + top)
    for i in range(fan.planes):
        entry = below[i] if own[i] < int32(0) else own[i]
        own[i] = entry if number >= free[i] else none


@kernel(allocates=False)
def find_visible(fan, profiles, top, bottom):
    """Fill `first` of `Profiles` for the rows top to bottom."""
    first, free, target = profiles.first, profiles.free, profiles.target
    for i in range(fan.planes):
        free[i] = bottom
    for r in range(bottom - top + 1):
        for i in range(fan.planes):
            first[r, i] = -1
    for j in range(len(profiles.distance)):
        show_sample(fan, profiles, j, top, bottom)
        for i in range(fan.planes):
            first[target[i], i] = j
    for r in range(bottom - top - 1, -1, -1):
        carry_up(fan, profiles, r, top)


@kernel(inlined=True, allocates=False)
def any_met(profiles, row):
    """Whether any ray of a row of `first` meets a profile."""
    least = int32(len(profiles.distance))
    own = profiles.first[row]
    for i in range(len(own)):
        least = min(least, own[i])
    return least < int32(len(profiles.distance))


@kernel(inlined=True, allocates=False)
def secant(slope, s0, m0, s1, m1):
    """Distance between s0 and s1 at which a ray of this slope meets the surface, whose slopes there are m0 and m1."""
    g0 = (slope - m0) * s0
    g1 = (slope - m1) * s1
    return s0 + (s1 - s0) * clamp(g0 / max(g0 - g1, f32(1e-6)), f32(0), f32(1))


@kernel(disjoint=True, allocates=False)
def meet_profiles(fan, profiles, row, slope, nearness):
    """Fill nearness [planes] with one over the distance at which the rays of a row, which rise by `slope`, meet each
    profile; 0 where they meet nothing.

    row: its number in `first`.
    """
    # Nearness and not distance, because on level or sloping ground it is linear from plane to plane.
    own, samples, slopes = profiles.first[row], profiles.distance, profiles.slope
    last = int32(len(samples)) - int32(1)
    for i in range(fan.planes):
        after = min(own[i], last)
        before = max(after - int32(1), int32(0))
        met = secant(
            slope,
            samples[uint32(before)],
            slopes[uint32(before * fan.planes + int32(i))],
            samples[uint32(after)],
            slopes[uint32(after * fan.planes + int32(i))],
        )
        nearness[i] = f32(1) / met if own[i] <= last else f32(0)


@kernel(inlined=True, allocates=False)
def between_planes(fan, nearness, position):
    """The nearness at a place between two planes, the greater of the two, and by how much they differ.

    position: counted in planes; nearness [planes]: of `meet_profiles`.
    """
    position = clamp(position, f32(0), f32(fan.planes) - f32(1.001))
    i = int32(position)
    left = nearness[uint32(i)]
    right = nearness[uint32(i + int32(1))]
    middle = left + (right - left) * (position - f32(i))
    return middle, max(left, right), abs(right - left)


@kernel(inlined=True, allocates=False)
def plane_position(camera, fan, row):
    """Position among the planes of the first pixel of a row, and the step from each pixel to the next."""
    inverse = f32(1) / horizontal_reach(camera, row)
    first = image_x(camera, 0) * inverse
    return (first - fan.first) / fan.step, camera.column_step * inverse / fan.step


@kernel(disjoint=True, allocates=False)
def settle_row(scene, view, origin, fan, row, column, rays, nearness, t, doubt, n):
    """Fill t [n] with the depths at which the rays of a row meet the surface, more than `FAR_M` for none.

    rays: from `column` on; nearness [planes]: of `meet_profiles`. doubt [n] uint8: 1 where t is only a depth before the
    surface, from which a march has to look for it.
    """
    dx, dy, dz = rays
    top = top_map(scene, view.world)
    # Two samples.
    least = f32(2 * STEP_NODES) / scene.constants[view.world, layout.INV_CELL]
    share = f32(1) - f32(2) * step_share(view.camera.height)
    near = view.camera.near_m
    inverse = f32(1) / horizontal_reach(view.camera, row)
    first, per_column = plane_position(view.camera, fan, row)
    for c in range(n):
        middle, nearer, apart = between_planes(fan, nearness, first + f32(column + c) * per_column)
        ti = inverse / max(middle, f32(NEARNESS_LEAST))
        # Newton: the height above the surface, by the rate at which the ray sinks towards it.
        height, slope_x, slope_y = sloped(top, origin.x + dx[c] * ti, origin.y + dy[c] * ti)
        rate = slope_x * dx[c] + slope_y * dy[c] - dz[c]
        move = (origin.z + dz[c] * ti - height) / max(rate, f32(1e-3))
        room = f32(SETTLE_M) + f32(SETTLE_SHARE) * ti
        unsure = ((apart > f32(APART) * middle) | (abs(move) > room)) & (nearer > f32(0))
        # Two samples before the nearer plane's distance: the surface may be nearer between the planes.
        before = max((share / max(nearer, f32(NEARNESS_LEAST)) - least) * inverse, near)
        t[c] = before if unsure else max(ti + clamp(move, -room, room), near)
        doubt[c] = np.uint8(1) if unsure else np.uint8(0)


@kernel(disjoint=True, allocates=False)
def interpolate_row(view, fan, row, column, nearness, t, n):
    """As `settle_row`, without the step onto the surface and without doubt, for the reduced quality."""
    near = view.camera.near_m
    inverse = f32(1) / horizontal_reach(view.camera, row)
    first, per_column = plane_position(view.camera, fan, row)
    for c in range(n):
        middle, nearer, apart = between_planes(fan, nearness, first + f32(column + c) * per_column)
        # Between planes that meet different things the nearer one is shown.
        shown = nearer if apart > f32(APART_REDUCED) * middle else middle
        t[c] = max(inverse / max(shown, f32(NEARNESS_LEAST)), near)
