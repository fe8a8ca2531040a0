"""The GPU kernel that walks over the ground in vertical planes, one thread a plane, for `terrain.azimuth_planes`."""

import numpy as np
from numba import cuda, float32

from thalweg.core.compute.jit import kernel
from thalweg.render.gpu.visible_plants import stored_camera
from thalweg.render.kernels.camera_rays import Rays, map_origin, square_rays
from thalweg.render.kernels.table_lookup import bilinear, top_map
from thalweg.render.kernels.terrain import azimuth_planes
from thalweg.render.kernels.terrain.azimuth_planes import first_row_below, ray_slope, secant
from thalweg.render.kernels.terrain.heightfield_march import FAR_M, TILE, advance_bundles, bundle_spread
from thalweg.render.records import layout
from thalweg.render.records.view import View

f32 = np.float32

THREADS = 128
"""Threads of a block."""


def find_nearness(scene, views, settings, cameras, nearness):
    """One block a camera: nearness [N, H, planes] of the ground that the rays of each row meet in each plane.

    As `azimuth_planes.meet_profiles`; planes are as many as `azimuth_planes.most_planes`. Cameras that planes can't
    serve are left out.
    """
    n = cuda.blockIdx.x
    thread = cuda.threadIdx.x
    camera = stored_camera(cameras, n, settings.height, settings.width)
    view = View(views.world_index[n], views.looks[n], camera, f32(0))
    if not azimuth_planes.can_serve(camera):
        return
    starts = cuda.shared.array(THREADS, float32)
    starts[thread] = nearest_bundle(scene, view, thread)
    cuda.syncthreads()
    start = f32(FAR_M)
    for k in range(THREADS):
        start = min(start, starts[k])
    start = start * azimuth_planes.least_reach(camera)
    fan = azimuth_planes.fan_of(camera, scene.constants[view.world, layout.INV_CELL])
    for plane in range(thread, fan.planes, THREADS):
        walk_plane(scene, view, fan, plane, start, nearness[n])


@kernel(inlined=True)
def nearest_bundle(scene, view, thread):
    """The depth before which no ray of a thread's share of the lowest tiles meets anything."""
    camera = view.camera
    inv_cell = scene.constants[view.world, layout.INV_CELL]
    middle = Rays(cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32))
    depth = cuda.local.array(1, float32)
    row = (camera.height - 1) // TILE * TILE
    least = f32(FAR_M)
    for tile in range(thread, (camera.width + TILE - 1) // TILE, THREADS):
        square_rays(camera, row, TILE, inv_cell, middle, tile, 1)
        depth[0] = camera.near_m
        advance_bundles(scene, view.world, map_origin(scene, view), bundle_spread(camera), middle, depth, 1)
        least = min(least, depth[0])
    return least


@kernel(inlined=True)
def walk_plane(scene, view, fan, plane, start, nearness):
    """Fill column `plane` of nearness [H, planes] with where each row meets the ground, from near to far."""
    camera = view.camera
    origin = map_origin(scene, view)
    top = top_map(scene, view.world)
    cell = f32(1) / scene.constants[view.world, layout.INV_CELL]
    q = fan.first + f32(plane) * fan.step
    far = azimuth_planes.far_distance(camera)
    free = camera.height
    ahead = start
    before = start
    slope_before = f32(0)
    walking = True
    while walking:
        x = origin.x + (fan.heading_x + q * fan.right_x) * ahead
        y = origin.y + (fan.heading_y + q * fan.right_y) * ahead
        slope = (bilinear(top, x, y) - origin.z) * (f32(1) / ahead)
        # The first sample has none before it.
        slope_before = slope if ahead == start else slope_before
        row = first_row_below(fan, slope, 0, camera.height)
        while free > row:
            free -= 1
            nearness[free, plane] = f32(1) / secant(ray_slope(camera, free), before, slope_before, ahead, slope)
        # The last sample is the first that is not before `far`.
        walking = ahead < far
        before = ahead
        slope_before = slope
        ahead = azimuth_planes.next_distance(ahead, cell, camera.height)
    while free > 0:
        free -= 1
        nearness[free, plane] = f32(0)
