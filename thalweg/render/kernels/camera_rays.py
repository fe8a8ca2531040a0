"""Kernels for the camera at a pose, the rays through its pixels, and the points that those rays meet."""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import int32

from thalweg.core.compute.jit import kernel
from thalweg.render.records import layout
from thalweg.render.records.appearance import HALF_H, HALF_W, PITCH
from thalweg.render.records.view import PosedCamera

f32 = np.float32


class Rays(NamedTuple):
    """Directions of rays, arrays [n] float32 per metre along the optical axis: x and y in nodes, z in metres."""

    x: Any
    y: Any
    z: Any


class Origin(NamedTuple):
    """Where the rays of a camera begin: x and y in nodes from the map's origin, z in metres."""

    x: Any
    y: Any
    z: Any


class HitPoints(NamedTuple):
    """Points that rays meet, arrays [n] float32."""

    x: Any
    """Nodes from the map's origin, as the next."""
    y: Any
    z: Any
    """Metres."""
    sight_x: Any
    """Unit direction of sight in metres, as the next two."""
    sight_y: Any
    sight_z: Any
    distance: Any
    """Metres from the camera."""


class Radiance(NamedTuple):
    """Radiance of n pixels, arrays [n] float32."""

    red: Any
    green: Any
    blue: Any


@kernel(allocates=False)
def pose_camera(pose, look, settings):
    """Return the `PosedCamera` at a pose [4]: x, y, z in metres, yaw in radians."""
    pitch = look[PITCH]
    half_w = look[HALF_W]
    cos_p = f32(math.cos(pitch))
    sin_p = f32(math.sin(pitch))
    # The yaw is float64: its sine and cosine are rounded once, at the end.
    cos_y = f32(math.cos(pose[3]))
    sin_y = f32(math.sin(pose[3]))
    return PosedCamera(
        f32(pose[0]), f32(pose[1]), f32(pose[2]),
        cos_y * cos_p, sin_y * cos_p, -sin_p,
        # The camera does not roll, so right is level and has no z.
        sin_y, -cos_y,
        cos_y * sin_p, sin_y * sin_p, cos_p,
        half_w, look[HALF_H], f32(2) * half_w / f32(settings.width), settings.near_m,
        settings.height, settings.width,
    )  # fmt: skip


@kernel(inlined=True, allocates=False)
def row_step(camera):
    """Return the height of a pixel on the image plane at distance one."""
    return f32(2) * camera.half_h / f32(camera.height)


@kernel(inlined=True, allocates=False)
def map_origin(scene, view):
    """Return the point where the rays of a view begin, in the coordinates of its world's map."""
    inv_cell = scene.constants[view.world, layout.INV_CELL]
    return Origin(
        (view.camera.x - scene.constants[view.world, layout.ORIGIN_X]) * inv_cell,
        (view.camera.y - scene.constants[view.world, layout.ORIGIN_Y]) * inv_cell,
        view.camera.z,
    )


@kernel(inlined=True, allocates=False)
def image_x(camera, column):
    """Return the position on the image plane, to the right of its middle, of the centre of a column."""
    return (f32(column) + f32(0.5)) * camera.column_step - camera.half_w


@kernel(inlined=True, allocates=False)
def image_y(camera, row, rows):
    """Return the height on the image plane, above its middle, of the centre of `rows` rows from `row` on."""
    return camera.half_h - (f32(row) + f32(0.5) * f32(rows)) * row_step(camera)


@kernel(inlined=True, allocates=False)
def ray_direction(camera, sx, sy):
    """Return the ray through a point of the image plane, in metres per metre along the optical axis: x, y, z."""
    # Not normalised: one unit of t is one metre of depth, which buffers and layers store.
    return (
        camera.forward_x + sy * camera.up_x + sx * camera.right_x,
        camera.forward_y + sy * camera.up_y + sx * camera.right_y,
        camera.forward_z + sy * camera.up_z,
    )


@kernel(inlined=True, allocates=False)
def ray_through(camera, row, column):
    """Return the `ray_direction` of the centre of a pixel."""
    return ray_direction(camera, image_x(camera, column), image_y(camera, row, 1))


@kernel(inlined=True, allocates=False)
def place_of(row, column):
    """Return the place of a pixel as one number: its row above 16 bits for its column, both int32."""
    return int32((row << int32(16)) | column)


@kernel(inlined=True, allocates=False)
def row_of(place):
    """Return the row of the pixel at a place."""
    return place >> int32(16)


@kernel(inlined=True, allocates=False)
def column_of(place):
    """Return the column of the pixel at a place."""
    return place & int32(0xFFFF)


@kernel(inlined=True, allocates=False)
def ray_at(camera, first, place):
    """Return `ray_through` of the pixel at a place whose row is counted from row `first` of the image."""
    return ray_through(camera, int32(first) + row_of(place), column_of(place))


@kernel(disjoint=True, allocates=False)
def row_rays(camera, row, first, inv_cell, rays, n):
    """Fill rays [n] with those through the centres of the pixels of a row, from column `first` on."""
    dx, dy, dz = rays
    for c in range(n):
        x, y, dz[c] = ray_through(camera, row, first + c)
        dx[c] = x * inv_cell
        dy[c] = y * inv_cell


@kernel(disjoint=True, allocates=False)
def square_rays(camera, row, size, inv_cell, rays, first, n):
    """Fill rays [n] with those through the middles of squares of `size` pixels a side, from number `first` on.

    row: the first row of the squares.
    """
    # The middle of a square lies between pixels where its size is even.
    dx, dy, dz = rays
    sy = image_y(camera, row, size)
    for k in range(n):
        sx = (f32(first + k) + f32(0.5)) * f32(size) * camera.column_step - camera.half_w
        x, y, dz[k] = ray_direction(camera, sx, sy)
        dx[k] = x * inv_cell
        dy[k] = y * inv_cell


@kernel(disjoint=True, allocates=False)
def hit_points(camera, origin, inv_cell, row, places, depth, points, n):
    """Fill `HitPoints` [n] for the pixels at `places` [n] int32, whose rows are counted from row `row` of the image.

    depth: [n] float32, metres along the optical axis.
    """
    x, y, z, dx, dy, dz, distance = points
    for k in range(n):
        vx, vy, vz = ray_at(camera, row, places[k])
        t = depth[k]
        # Depths count along the axis: the ray itself is longer by this factor.
        slant = math.sqrt(vx * vx + vy * vy + vz * vz)
        x[k] = origin.x + vx * inv_cell * t
        y[k] = origin.y + vy * inv_cell * t
        z[k] = origin.z + vz * t
        dx[k] = vx / slant
        dy[k] = vy / slant
        dz[k] = vz / slant
        distance[k] = t * slant
