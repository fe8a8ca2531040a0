"""The GPU kernel that draws one pixel a thread, from the same functions as the CPU, with spans of one ray.

A block of threads draws a tile of `TILE` pixels a side, and blends its plants together (`tile_plants`). Arrays of one
element stay in registers.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import cuda, float32, int32, uint8

from thalweg.core.compute.jit import kernel
from thalweg.render.gpu.tile_plants import blend_plants
from thalweg.render.gpu.visible_plants import stored_camera
from thalweg.render.kernels import bridge_stone, bridges
from thalweg.render.kernels.camera_rays import (
    HitPoints,
    Radiance,
    Rays,
    hit_points,
    map_origin,
    place_of,
    row_rays,
    row_step,
    square_rays,
)
from thalweg.render.kernels.plants import billboard, reduced_billboard
from thalweg.render.kernels.shading import ground, mirror, reduced_quality, sky, water
from thalweg.render.kernels.shading.background import SEEN
from thalweg.render.kernels.shading.shore import covered_share, water_shares
from thalweg.render.kernels.terrain import azimuth_planes, heightfield_march
from thalweg.render.kernels.terrain.heightfield_march import SQUARE, TILE, Tangents, Track
from thalweg.render.kernels.terrain.primary_hits import MISS, class_of
from thalweg.render.records import classes, layout
from thalweg.render.records.view import COLOURS, MASK, View

f32 = np.float32

LESS_THAN_HALF = float(np.nextafter(f32(0.5), f32(0)))
"""Greatest number below a half: light above it is at least a half, and a pixel below it is one of plants for good."""


@cache
def tracer(reduced: bool, drawn: int) -> Callable:
    """Return the kernel for a quality and for what is drawn (see `Output`): without colours, it finds only depth, class
    and mask; for the mask alone, bridges and plants only where they hide water."""
    coloured, only_mask = drawn == COLOURS, drawn == MASK
    closed = LESS_THAN_HALF
    if coloured:
        closed = reduced_billboard.CLOSED if reduced else billboard.CLOSED

    def trace(scene, views, cameras, moments, nearness, plants, buffers):
        """One block a tile (x) of a camera (y): fill `Buffers` [N, H, W].

        moments: of `visible_plants.place_cameras`; nearness: of `ground_profiles.find_nearness`; plants: order,
        distance, boxes, counts of `visible_plants.find`.
        """
        n = cuda.blockIdx.y
        height, width = buffers.kind.shape[1:]
        tiles = (width + TILE - 1) // TILE
        tile_r = cuda.blockIdx.x // tiles * TILE
        tile_c = cuda.blockIdx.x % tiles * TILE
        r = tile_r + cuda.threadIdx.x // TILE
        c = tile_c + cuda.threadIdx.x % TILE
        camera = stored_camera(cameras, n, height, width)
        view = View(views.world_index[n], views.looks[n], camera, moments[n])
        depth = cuda.local.array(1, float32)
        rays = Rays(cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32))
        kind = primary_hit(scene, view, tile_r, tile_c, r, c, reduced, nearness[n], rays, depth)
        stone_r, stone_g, stone_b = f32(0), f32(0), f32(0)
        if not only_mask or kind == classes.WATER:
            kind, stone_r, stone_g, stone_b = nearest_bridge(scene, view, rays, depth, kind, coloured)
        # Threads outside the image stay alive: they still load plants and meet the barriers.
        inside = r < height and c < width
        asked = inside and (not only_mask or kind == classes.WATER)
        corner = tile_r, tile_c
        red, green, blue, light, plant_depth = blend_plants(
            scene, view, plants, n, corner, r, asked, f32(closed), reduced, rays, depth
        )
        # As on the CPU, what dense foliage hides is not shaded.
        if coloured and light > f32(SEEN):
            out = Radiance(cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32))
            if kind == classes.BRIDGE:
                out.red[0] = stone_r
                out.green[0] = stone_g
                out.blue[0] = stone_b
            else:
                shade_background(scene, view, kind, reduced, r, c, depth, out)
            red += light * out.red[0]
            green += light * out.green[0]
            blue += light * out.blue[0]
        if inside:
            buffers.depth[n, r, c] = depth[0]
            buffers.kind[n, r, c] = kind
            buffers.transmittance[n, r, c] = light
            buffers.plant_depth[n, r, c] = plant_depth
            if coloured:
                buffers.red[n, r, c] = red
                buffers.green[n, r, c] = green
                buffers.blue[n, r, c] = blue

    return trace


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
def empty_track():
    """Return the `Track` of one ray, in registers."""
    return Track(
        cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32),
        cuda.local.array(1, float32), cuda.local.array(1, float32),
    )  # fmt: skip


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
    middle = Rays(cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32))
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
        tangent = Tangents(cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32))
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


@kernel(inlined=True)
def shade_background(scene, view, kind, reduced, r, c, depth, out):
    """Fill `Radiance` [1] with that of sky, water or ground at pixel (r, c), haze included."""
    inv_cell = scene.constants[view.world, layout.INV_CELL]
    pixel = row_step(view.camera)
    place = cuda.local.array(1, int32)
    place[0] = place_of(int32(0), int32(c))
    points = HitPoints(
        cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32),
        cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32),
        cuda.local.array(1, float32),
    )  # fmt: skip
    hit_points(view.camera, map_origin(scene, view), inv_cell, r, place, depth, points, 1)
    if kind == classes.SKY:
        if reduced:
            reduced_quality.shade_sky(scene, view, points, out, 1)
        else:
            sky.shade_sky(scene, view, points, out, 1)
        # The sky map holds its own haze.
        return
    wet = f32(1) if kind == classes.WATER else f32(0)
    if not reduced:
        share = cuda.local.array(1, float32)
        kinds = cuda.local.array(1, uint8)
        kinds[0] = kind
        water_shares(scene, view, map_origin(scene, view), r, place, depth, kinds, share, 1)
        wet = covered_share(classes.WATER, share[0])
    # A pixel on the shore is the mean of water and ground.
    red = f32(0)
    green = f32(0)
    blue = f32(0)
    if wet > f32(0):
        shade_water(scene, view, points, pixel, reduced, out)
        red = wet * out.red[0]
        green = wet * out.green[0]
        blue = wet * out.blue[0]
    if wet < f32(1):
        if reduced:
            reduced_quality.shade_ground(scene, view, points, pixel, out, 1)
        else:
            ground.shade_ground(scene, view, points, pixel, out, 1)
        red += (f32(1) - wet) * out.red[0]
        green += (f32(1) - wet) * out.green[0]
        blue += (f32(1) - wet) * out.blue[0]
    out.red[0] = red
    out.green[0] = green
    out.blue[0] = blue
    sky.add_haze(scene, view, points, out, 1)


@kernel(inlined=True)
def shade_water(scene, view, points, pixel, reduced, out):
    """Fill `Radiance` [1] with that of water."""
    if reduced:
        reduced_quality.shade_water(scene, view, points, pixel, out, 1)
    else:
        surface = water.Surface(
            cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32),
            cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32),
            cuda.local.array(1, float32),
        )  # fmt: skip
        mirrored = mirror.Mirrored(
            cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32),
            cuda.local.array(1, float32),
        )  # fmt: skip
        water.shade_water(scene, view, points, pixel, water.WaterScratch(surface, mirrored), out, 1)
