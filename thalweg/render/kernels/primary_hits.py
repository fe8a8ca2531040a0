"""The kernel that finds what each pixel's ray meets first: ground, water or sky. Bridges and plants come later."""

import numpy as np
from numba import uint32

from thalweg.core.jit import kernel
from thalweg.render.kernels import heightfield_march
from thalweg.render.kernels.camera_rays import Rays, map_origin, row_rays, square_rays
from thalweg.render.kernels.heightfield_march import SPAN, SQUARE, TILE, TangentPlanes, Track
from thalweg.render.records import layout
from thalweg.render.records.classes import GROUND, SKY, WATER

f32 = np.float32

MISS = 1e9
"""Depth of a ray that meets nothing."""


@kernel(disjoint=True)
def find_primary_hits(scene, view, top, reduced, depth, kind):
    """Fill depth [R, W'] along the axis (MISS for the sky) and kind [R, W'] uint8 with what every ray meets.

    Rows are those from `top` on of the image, as in all functions of a frame. In the reduced quality R is even, and a
    square of `SQUARE` pixels a side shares one march: its rays end on the plane that touches the surface where the
    march ends.
    """
    camera = view.camera
    rows, wide = depth.shape
    inv_cell = scene.constants[view.world, layout.INV_CELL]
    origin = map_origin(scene, view)
    rays = Rays(np.empty(wide, np.float32), np.empty(wide, np.float32), np.empty(wide, np.float32))
    planes = TangentPlanes(np.empty(wide, np.float32), np.empty(wide, np.float32), np.empty(wide, np.float32))
    t = np.empty(wide, np.float32)
    hit = np.empty(wide, np.float32)
    water = np.empty(wide, np.float32)
    march_t = np.empty(wide, np.float32)
    march_hit = np.empty(wide, np.float32)
    scratch = np.empty((5, SPAN), np.float32)
    track = Track(scratch[0], scratch[1], scratch[2], scratch[3], scratch[4])
    tiles = (wide + TILE - 1) // TILE
    start = np.empty(tiles, np.float32)
    spread = heightfield_march.bundle_spread(camera)
    size = SQUARE if reduced else 1
    for r in range(rows):
        # Once for each row of tiles: empty space that a whole tile crosses is crossed by one ray instead of 64.
        if r % TILE == 0:
            square_rays(camera, top + r, TILE, inv_cell, rays, 0, tiles)
            # Nothing nearer than the near plane is drawn, so rays begin on it.
            for k in range(tiles):
                start[k] = camera.near_m
            heightfield_march.advance_bundles(scene, view.world, origin, spread, rays, start, tiles)
        if r % size == 0:
            square_rays(camera, top + r, size, inv_cell, rays, 0, wide // size)
            march_row(scene, view.world, origin, rays, start, size, march_t, march_hit, track)
            if reduced:
                heightfield_march.touch_surface(scene, view.world, origin, rays, march_t, planes, wide // size)
        # Each pixel keeps its own direction and meets the tangent plane of its square: depth stays smooth within it.
        if reduced:
            row_rays(camera, top + r, 0, inv_cell, rays, wide)
            heightfield_march.meet_planes(planes, march_t, rays, t, wide)
            for c in range(wide):
                hit[c] = march_hit[uint32(c // SQUARE)]
        else:
            for c in range(wide):
                t[c] = march_t[c]
                hit[c] = march_hit[c]
        heightfield_march.water_depths(scene, view.world, origin, rays, t, water, wide)
        for c in range(wide):
            depth[r, c] = t[c] if hit[c] > f32(0) else f32(MISS)
            # The upper surface is water wherever the water is deeper than zero, so no second march is needed.
            surface = np.uint8(WATER) if water[c] > f32(0) else np.uint8(GROUND)
            kind[r, c] = surface if hit[c] > f32(0) else np.uint8(SKY)


@kernel(disjoint=True, allocates=False)
def march_row(scene, world, origin, rays, start, size, t, hit, track):
    """March the rays of one row of squares from where the bundles of their tiles start, `SPAN` at a time."""
    dx, dy, dz = rays
    n = len(t) // size
    for k in range(n):
        t[k] = start[uint32(k * size // TILE)]
    for k in range(0, n, SPAN):
        end = min(k + SPAN, n)
        part = Rays(dx[k:end], dy[k:end], dz[k:end])
        heightfield_march.march(scene, world, origin, part, t[k:end], hit[k:end], track, end - k)
