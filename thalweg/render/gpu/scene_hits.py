"""Hits of the ray of a pixel on ground, water and bridges, from the functions of the CPU, with spans of one ray."""

import numpy as np
from numba import cuda, float32, int32, uint8

from thalweg.core.compute.jit import kernel
from thalweg.render.gpu.pixel_records import empty_rays, empty_tangents, empty_track
from thalweg.render.kernels import bridge_stone, bridges
from thalweg.render.kernels.camera_rays import map_origin, row_rays, row_step, square_rays
from thalweg.render.kernels.terrain import azimuth_planes, heightfield_march
from thalweg.render.kernels.terrain.heightfield_march import SQUARE, TILE
from thalweg.render.kernels.terrain.primary_hits import MISS, class_of
from thalweg.render.records import classes, layout

f32 = np.float32


@kernel(inlined=True)
def primary_hit(scene, view, tile_r, tile_c, r, c, reduced, nearness, rays, depth):
    """Return the class that the ray of pixel (r, c) meets, except for bridges and plants; fills ray and depth [1].

    nearness [H, planes]: of `ground_profiles.find_nearness`.
    """
    inv_cell = scene.constants[view.world, layout.INV_CELL]
    origin = map_origin(scene, view)
    row_rays(view.camera, r, c, inv_cell, rays, 1)
    # The same branch for all threads of the block: it depends on the camera alone.
    if azimuth_planes.can_serve(view.camera):
        met = hit_by_planes(scene, view, r, c, reduced, nearness, rays, depth)
    else:
        met = hit_by_march(scene, view, tile_r, tile_c, r, c, reduced, rays, depth)
    wet = cuda.local.array(1, float32)
    heightfield_march.water_depths(scene, view.world, origin, rays, depth, wet, 1)
    if not met:
        depth[0] = f32(MISS)
    return int32(class_of(met, wet[0]))


@kernel(inlined=True)
def hit_by_planes(scene, view, r, c, reduced, nearness, rays, depth):
    """Return whether a ray meets ground or water, and fill depth [1], from where the two planes beside it meet it."""
    origin = map_origin(scene, view)
    fan = azimuth_planes.fan_of(view.camera, scene.constants[view.world, layout.INV_CELL])
    # Threads outside the image compute with the last row.
    own = nearness[min(r, view.camera.height - 1)]
    if reduced:
        azimuth_planes.interpolate_row(view, fan, r, c, own, depth, 1)
        return depth[0] < f32(heightfield_march.FAR_M)
    doubt = cuda.local.array(1, uint8)
    azimuth_planes.settle_row(scene, view, origin, fan, r, c, rays, own, depth, doubt, 1)
    if doubt[0] == uint8(1):
        hit = cuda.local.array(1, float32)
        heightfield_march.march(scene, view.world, origin, rays, depth, hit, empty_track(), 1)
        return hit[0] > f32(0)
    return depth[0] < f32(heightfield_march.FAR_M)


@kernel(inlined=True)
def hit_by_march(scene, view, tile_r, tile_c, r, c, reduced, rays, depth):
    """Return whether a ray meets ground or water, and fill depth [1], by a march; all threads of a block call it."""
    camera = view.camera
    inv_cell = scene.constants[view.world, layout.INV_CELL]
    origin = map_origin(scene, view)
    middle = empty_rays()
    hit = cuda.local.array(1, float32)
    track = empty_track()
    # All rays of a tile start where its bundle gets to.
    start = cuda.shared.array(1, float32)
    # One thread marches for the tile; the others wait at the barrier below for its result.
    if cuda.threadIdx.x == 0:
        square_rays(camera, tile_r, TILE, inv_cell, middle, tile_c // TILE, 1)
        depth[0] = camera.near_m
        spread = heightfield_march.bundle_spread(camera)
        heightfield_march.advance_bundles(scene, view.world, origin, spread, middle, depth, 1)
        start[0] = depth[0]
    cuda.syncthreads()
    depth[0] = start[0]
    if reduced:
        tangent = empty_tangents()
        met = cuda.local.array(1, float32)
        met[0] = depth[0]
        square_rays(camera, r // SQUARE * SQUARE, SQUARE, inv_cell, middle, c // SQUARE, 1)
        heightfield_march.march(scene, view.world, origin, middle, met, hit, track, 1)
        heightfield_march.touch_surface(scene, view.world, origin, middle, met, tangent, 1)
        heightfield_march.meet_tangents(tangent, met, rays, depth, 1)
    else:
        heightfield_march.march(scene, view.world, origin, rays, depth, hit, track, 1)
    return hit[0] > f32(0)


@kernel(inlined=True)
def nearest_bridge(scene, view, rays, depth, kind, coloured):
    """Return the class of a pixel and the radiance of its stone with bridges drawn; depth [1] becomes the nearest."""
    cell = f32(1) / scene.constants[view.world, layout.INV_CELL]
    dx = rays.x[0] * cell
    dy = rays.y[0] * cell
    dz = rays.z[0]
    red = f32(0)
    green = f32(0)
    blue = f32(0)
    for b in range(scene.extents[view.world, layout.BRIDGE_FROM], scene.extents[view.world, layout.BRIDGE_TO]):
        row = scene.bridges[b]
        # Nearer stone only, so that the last hit is the nearest.
        ray = bridges.bridge_ray(row, view.camera, dx, dy, dz)
        hit = bridges.meet_bridge(row, ray, view.camera.near_m, min(depth[0], f32(bridges.FAR_M)))
        if hit.t > f32(0):
            depth[0] = hit.t
            kind = int32(classes.BRIDGE)
            if coloured:
                slant = f32((dx * dx + dy * dy + dz * dz) ** f32(0.5))
                red, green, blue = bridge_stone.shade_stone(
                    scene, view, row, hit, ray, row_step(view.camera), slant, f32(1)
                )
    return kind, red, green, blue
