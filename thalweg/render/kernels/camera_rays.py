"""Where does each pixel look? The camera at a pose, and the rays through its pixels."""

import math

import numpy as np
from numba import uint32

from thalweg.core.jit import kernel
from thalweg.render.records.appearance import HALF_H, HALF_W, PITCH

f32 = np.float32


@kernel(inlined=True)
def open_eye(x, y, z, yaw, look, width, near):
    """The camera at a pose: origin, forward, right and up vectors, half width and height, width of a pixel, near plane.

    x, y, z in metres, yaw in radians, width in pixels, near in metres. The right vector has no height, for the camera
    does not roll.
    """
    pitch = look[PITCH]
    half_w = look[HALF_W]
    cos_p = f32(math.cos(pitch))
    sin_p = f32(math.sin(pitch))
    cos_y = f32(math.cos(yaw))
    sin_y = f32(math.sin(yaw))
    return (
        f32(x), f32(y), f32(z),
        cos_y * cos_p, sin_y * cos_p, -sin_p,
        sin_y, -cos_y,
        cos_y * sin_p, sin_y * sin_p, cos_p,
        half_w, look[HALF_H], f32(2) * half_w / f32(width), near,
    )  # fmt: skip


@kernel
def eye_of(pose, look, camera):
    """The camera at a pose [4], as of `open_eye`; camera: as of `batch.draw`."""
    return open_eye(pose[0], pose[1], pose[2], pose[3], look, camera[1], camera[2])


@kernel(disjoint=True)
def aim(eye, height, r, first, inv_cell, dx, dy, dz, n):
    """The rays of row r from column `first` on: dx, dy [n] in nodes and dz [n] in metres per metre along the axis."""
    _, _, _, fx, fy, fz, rx, ry, ux, uy, uz, half_w, half_h, per_column, _ = eye
    sy = half_h - (f32(r) + f32(0.5)) * (f32(2) * half_h / f32(height))
    for c in range(n):
        sx = (f32(first + c) + f32(0.5)) * per_column - half_w
        dx[c] = (fx + sy * ux + sx * rx) * inv_cell
        dy[c] = (fy + sy * uy + sx * ry) * inv_cell
        dz[c] = fz + sy * uz


@kernel(disjoint=True)
def aim_squares(eye, height, r, size, inv_cell, dx, dy, dz, first, n):
    """As `aim`, for the middles of n squares of `size` pixels a side, from number `first` on, whose first row is r."""
    _, _, _, fx, fy, fz, rx, ry, ux, uy, uz, half_w, half_h, per_column, _ = eye
    sy = half_h - (f32(r) + f32(0.5) * f32(size)) * (f32(2) * half_h / f32(height))
    for k in range(n):
        sx = (f32(first + k) + f32(0.5)) * f32(size) * per_column - half_w
        dx[k] = (fx + sy * ux + sx * rx) * inv_cell
        dy[k] = (fy + sy * uy + sx * ry) * inv_cell
        dz[k] = fz + sy * uz


@kernel(disjoint=True)
def reach(node_x, node_y, oz, inv_cell, ray_x, ray_y, ray_z, depth, at, x, y, z, dx, dy, dz, far, n):
    """For the pixels at[:n] of a row: the point met (x, y in nodes, z), the unit direction of sight, the distance."""
    cell = f32(1) / inv_cell
    for k in range(n):
        c = uint32(at[k])
        vx = ray_x[c]
        vy = ray_y[c]
        vz = ray_z[c]
        t = depth[c]
        slant = math.sqrt((vx * vx + vy * vy) * cell * cell + vz * vz)
        x[k] = node_x + vx * t
        y[k] = node_y + vy * t
        z[k] = oz + vz * t
        dx[k] = vx * cell / slant
        dy[k] = vy * cell / slant
        dz[k] = vz / slant
        far[k] = t * slant
