"""The kernel that finds what each pixel's ray meets first: ground, water or sky. Bridges and plants come later.

Rays that `azimuth_planes` can serve are found by its planes; the march of `heightfield_march` takes the pixels that are
doubtful there, and whole frames of cameras that look too steeply up or down.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import uint32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.camera_rays import Rays, map_origin, row_rays, square_rays
from thalweg.render.kernels.terrain import azimuth_planes, heightfield_march
from thalweg.render.kernels.terrain.heightfield_march import FAR_M, SPAN, SQUARE, TILE, Tangents, Track
from thalweg.render.records import layout
from thalweg.render.records.classes import GROUND, SKY, WATER

f32 = np.float32

MISS = 1e9
"""Depth of a ray that meets nothing."""


class Doubtful(NamedTuple):
    """Pixels that wait for a march, [SPAN] each, and scratch for it."""

    row: Any
    """int32."""
    column: Any
    """int32."""
    rays: Any
    """`Rays` of float32."""
    t: Any
    """float32, as the next two: depth, whether it is a hit, and depth of the water there."""
    hit: Any
    water: Any
    track: Any
    """A `Track`."""


class PlaneScratch(NamedTuple):
    """Scratch of `meet_rows` for a row [W']."""

    rays: Any
    """`Rays` of float32."""
    t: Any
    """float32."""
    doubt: Any
    """uint8."""
    nearness: Any
    """[planes] float32."""
    waiting: Any
    """`Doubtful` pixels."""


@kernel
def find_primary_hits(scene, view, top, reduced, depth, kind, water):
    """Fill depth [R, W'] along the axis (MISS for the sky) and kind [R, W'] uint8 with what every ray meets, and water
    [R, W'] with the metres of water there, negative on land.

    Rows are those from `top` on of the image, as in all functions of a frame. In the reduced quality R is even.
    """
    if azimuth_planes.can_serve(view.camera):
        find_by_planes(scene, view, top, reduced, depth, kind, water)
    else:
        find_by_march(scene, view, top, reduced, depth, kind, water)


@kernel
def find_by_planes(scene, view, top, reduced, depth, kind, water):
    """As `find_primary_hits`, by the profiles of vertical planes; the reduced quality interpolates only."""
    camera = view.camera
    rows, wide = depth.shape
    inv_cell = scene.constants[view.world, layout.INV_CELL]
    origin = map_origin(scene, view)
    fan = azimuth_planes.fan_of(camera, inv_cell)
    line = np.empty((4, wide), np.float32)
    scratch = np.empty((11, SPAN), np.float32)
    places = np.empty((2, SPAN), np.int32)
    work = PlaneScratch(
        Rays(line[0], line[1], line[2]), line[3], np.empty(wide, np.uint8), np.empty(fan.planes, np.float32),
        Doubtful(
            places[0], places[1], Rays(scratch[0], scratch[1], scratch[2]), scratch[3], scratch[4], scratch[5],
            Track(scratch[6], scratch[7], scratch[8], scratch[9], scratch[10]),
        ),
    )  # fmt: skip
    start = first_distance(scene, view, origin, work.rays, work.t)
    # Bands of rows use the same samples as the whole image.
    far = azimuth_planes.far_distance(camera)
    samples = azimuth_planes.count_samples(start, far, f32(1) / inv_cell, camera.height)
    profiles = azimuth_planes.empty_profiles(fan, samples, rows)
    azimuth_planes.place_samples(profiles.distance, start, f32(1) / inv_cell, camera.height)
    azimuth_planes.sample_slopes(scene, view.world, origin, fan, profiles.distance, profiles.slope)
    azimuth_planes.find_visible(fan, profiles, top, top + rows)
    meet_rows(scene, view, top, reduced, fan, profiles, work, depth, kind, water)


@kernel(allocates=False)
def meet_rows(scene, view, top, reduced, fan, profiles, work, depth, kind, water):
    """Fill depth, kind and water [R, W'] of the rows from `top` on from `Profiles`, with `PlaneScratch`."""
    origin = map_origin(scene, view)
    inv_cell = scene.constants[view.world, layout.INV_CELL]
    rays, t, doubt, nearness = work.rays, work.t, work.doubt, work.nearness
    rows, wide = depth.shape
    count = 0
    for r in range(rows):
        row = top + r
        if not azimuth_planes.any_met(profiles, r):
            clear_row(depth[r], kind[r], water[r])
            continue
        azimuth_planes.meet_profiles(fan, profiles, r, azimuth_planes.ray_slope(view.camera, row), nearness)
        row_rays(view.camera, row, 0, inv_cell, rays, wide)
        if reduced:
            azimuth_planes.interpolate_row(view, fan, row, 0, nearness, t, wide)
        else:
            azimuth_planes.settle_row(scene, view, origin, fan, row, 0, rays, nearness, t, doubt, wide)
        heightfield_march.water_depths(scene, view.world, origin, rays, t, water[r], wide)
        classify_row(t, water[r], depth[r], kind[r], wide)
        if reduced:
            continue
        for c in range(wide):
            if doubt[c] == np.uint8(1):
                count = hold_back(work.waiting, count, r, c, rays, t[c])
                if count == SPAN:
                    march_doubtful(scene, view.world, origin, work.waiting, count, depth, kind, water)
                    count = 0
    march_doubtful(scene, view.world, origin, work.waiting, count, depth, kind, water)


@kernel(allocates=False)
def first_distance(scene, view, origin, rays, t):
    """Distance of the first sample of all profiles, before which no ray of the image meets anything.

    rays, t: scratch.
    """
    camera = view.camera
    tiles = (camera.width + TILE - 1) // TILE
    inv_cell = scene.constants[view.world, layout.INV_CELL]
    # In one plane a lower ray meets the surface no farther away: the lowest tiles stand for all rows.
    square_rays(camera, (camera.height - 1) // TILE * TILE, TILE, inv_cell, rays, 0, tiles)
    for k in range(tiles):
        t[k] = camera.near_m
    heightfield_march.advance_bundles(
        scene, view.world, origin, heightfield_march.bundle_spread(camera), rays, t, tiles
    )
    least = f32(FAR_M)
    for k in range(tiles):
        least = min(least, t[k])
    return least * azimuth_planes.least_reach(camera)


@kernel(inlined=True, allocates=False)
def hold_back(waiting, count, r, c, rays, t):
    """Add a pixel to those that wait, with a depth t before the surface; returns their number."""
    waiting.row[count] = r
    waiting.column[count] = c
    waiting.rays.x[count] = rays.x[c]
    waiting.rays.y[count] = rays.y[c]
    waiting.rays.z[count] = rays.z[c]
    waiting.t[count] = t
    return count + 1


@kernel(inlined=True, allocates=False)
def class_of(met, water):
    """Class of what a ray meets, from the depth of the water there; the sky's if it meets nothing."""
    # The upper surface is water wherever the water is deeper than zero, so no second search is needed.
    surface = np.uint8(WATER) if water > f32(0) else np.uint8(GROUND)
    return surface if met else np.uint8(SKY)


@kernel(allocates=False)
def march_doubtful(scene, world, origin, waiting, count, depth, kind, water):
    """March the first `count` pixels that wait, and write what they meet to depth, kind and water [R, W']."""
    rays, t, hit, wet = waiting.rays, waiting.t, waiting.hit, waiting.water
    heightfield_march.march(scene, world, origin, rays, t, hit, waiting.track, count)
    heightfield_march.water_depths(scene, world, origin, rays, t, wet, count)
    for k in range(count):
        r = waiting.row[k]
        c = waiting.column[k]
        depth[r, c] = t[k] if hit[k] > f32(0) else f32(MISS)
        water[r, c] = wet[k]
        kind[r, c] = class_of(hit[k] > f32(0), wet[k])


@kernel(disjoint=True, allocates=False)
def clear_row(depth, kind, water):
    """Fill depth, kind and water [W'] of a row that shows nothing but sky."""
    for c in range(len(depth)):
        depth[c] = f32(MISS)
        kind[c] = np.uint8(SKY)
        water[c] = f32(0)


@kernel(disjoint=True, allocates=False)
def classify_row(t, water, depth, kind, n):
    """Fill depth and kind [n] from t [n] and the depth of the water there; what is too far away is sky."""
    for c in range(n):
        met = t[c] < f32(FAR_M)
        depth[c] = t[c] if met else f32(MISS)
        kind[c] = class_of(met, water[c])


class MarchScratch(NamedTuple):
    """Scratch of `march_rows` for a row [W'], float32."""

    rays: Any
    """`Rays`."""
    tangents: Any
    """`Tangents`."""
    t: Any
    """Of the pixels, as the next: depth, and whether it is a hit."""
    hit: Any
    march_t: Any
    """Of the rays that march, as the next."""
    march_hit: Any
    start: Any
    """[tiles]."""
    track: Any
    """A `Track` of `SPAN` rays."""


@kernel
def find_by_march(scene, view, top, reduced, depth, kind, water):
    """As `find_primary_hits`, by the march of every ray.

    In the reduced quality a square of `SQUARE` pixels a side shares one march: its rays end on the plane that touches
    the surface where the march ends.
    """
    wide = depth.shape[1]
    line = np.empty((10, wide), np.float32)
    scratch = np.empty((5, SPAN), np.float32)
    work = MarchScratch(
        Rays(line[0], line[1], line[2]), Tangents(line[3], line[4], line[5]), line[6], line[7], line[8], line[9],
        np.empty((wide + TILE - 1) // TILE, np.float32),
        Track(scratch[0], scratch[1], scratch[2], scratch[3], scratch[4]),
    )  # fmt: skip
    march_rows(scene, view, top, reduced, work, depth, kind, water)


@kernel(disjoint=True, allocates=False)
def march_rows(scene, view, top, reduced, work, depth, kind, water):
    """As `find_by_march`, with `MarchScratch`."""
    camera = view.camera
    rows, wide = depth.shape
    inv_cell = scene.constants[view.world, layout.INV_CELL]
    origin = map_origin(scene, view)
    rays, tangents, t, hit, march_t, march_hit, start, track = work
    tiles = len(start)
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
                heightfield_march.touch_surface(scene, view.world, origin, rays, march_t, tangents, wide // size)
        # Each pixel keeps its own direction and meets the tangent plane of its square: depth stays smooth within it.
        if reduced:
            row_rays(camera, top + r, 0, inv_cell, rays, wide)
            heightfield_march.meet_tangents(tangents, march_t, rays, t, wide)
            for c in range(wide):
                hit[c] = march_hit[uint32(c // SQUARE)]
        else:
            for c in range(wide):
                t[c] = march_t[c]
                hit[c] = march_hit[c]
        heightfield_march.water_depths(scene, view.world, origin, rays, t, water[r], wide)
        for c in range(wide):
            depth[r, c] = t[c] if hit[c] > f32(0) else f32(MISS)
            kind[r, c] = class_of(hit[c] > f32(0), water[r, c])


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
