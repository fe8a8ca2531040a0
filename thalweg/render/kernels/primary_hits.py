"""What does each ray meet: ground, water or sky? A march for every pixel, or for every square of four."""

import numpy as np
from numba import uint32

from thalweg.core.jit import kernel
from thalweg.render.kernels import heightfield_march as march
from thalweg.render.kernels.camera_rays import aim, aim_squares
from thalweg.render.records import scene as table
from thalweg.render.records.classes import GROUND, SKY, WATER

f32 = np.float32

MISS = 1e9
"""Depth of a ray that meets nothing."""


@kernel(disjoint=True)
def survey(scene, w, eye, height, top, fast, depth, kind):
    """Where every ray meets ground or water: depth [R, W'] along the axis (MISS if nowhere), and what it is: kind
    [R, W'] uint8.

    Rows are those from `top` on of an image of `height` rows; so in all functions of a frame. fast: whether one march
    is enough for a square of `march.SQUARE` pixels a side, whose rays then settle on the plane that touches the surface
    at the point it found; R is even then.
    """
    rows, wide = depth.shape
    inv_cell = scene.number[w, table.INV_CELL]
    node_x = (eye[0] - scene.number[w, table.ORIGIN_X]) * inv_cell
    node_y = (eye[1] - scene.number[w, table.ORIGIN_Y]) * inv_cell
    dx = np.empty(wide, np.float32)
    dy = np.empty(wide, np.float32)
    dz = np.empty(wide, np.float32)
    t = np.empty(wide, np.float32)
    hit = np.empty(wide, np.float32)
    wet = np.empty(wide, np.float32)
    span = np.empty((march.TRACK, march.SPAN), np.float32)
    track = (span[0], span[1], span[2], span[3], span[4])
    tiles = (wide + march.TILE - 1) // march.TILE
    start = np.empty(tiles, np.float32)
    tilt_x = np.empty(wide, np.float32)
    tilt_y = np.empty(wide, np.float32)
    gap = np.empty(wide, np.float32)
    met = np.empty(wide, np.float32)
    met_hit = np.empty(wide, np.float32)
    spread = march.bundle_spread(eye, height)
    size = march.SQUARE if fast else 1
    for r in range(rows):
        if r % march.TILE == 0:
            aim_squares(eye, height, top + r, march.TILE, inv_cell, dx, dy, dz, 0, tiles)
            for k in range(tiles):
                start[k] = eye[14]
            march.approach(scene, w, node_x, node_y, eye[2], spread, dx, dy, dz, start, tiles)
        if r % size == 0:
            rays = wide // size
            aim_squares(eye, height, top + r, size, inv_cell, dx, dy, dz, 0, rays)
            for k in range(rays):
                met[k] = start[uint32(k * size // march.TILE)]
            for k in range(0, rays, march.SPAN):
                end = min(k + march.SPAN, rays)
                ray = dx[k:end], dy[k:end], dz[k:end], met[k:end], met_hit[k:end]
                march.march(scene, w, node_x, node_y, eye[2], *ray, track, end - k)
            if fast:
                march.touch(scene, w, node_x, node_y, eye[2], dx, dy, met, tilt_x, tilt_y, gap, rays)
        if fast:
            aim(eye, height, top + r, 0, inv_cell, dx, dy, dz, wide)
            march.settle(tilt_x, tilt_y, gap, met, dx, dy, dz, t, wide)
            for c in range(wide):
                hit[c] = met_hit[uint32(c // march.SQUARE)]
        else:
            for c in range(wide):
                t[c] = met[c]
                hit[c] = met_hit[c]
        march.wetness(scene, w, node_x, node_y, dx, dy, t, wet, wide)
        for c in range(wide):
            depth[r, c] = t[c] if hit[c] > f32(0) else f32(MISS)
            surface = np.uint8(WATER) if wet[c] > f32(0) else np.uint8(GROUND)
            kind[r, c] = surface if hit[c] > f32(0) else np.uint8(SKY)
