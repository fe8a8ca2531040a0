"""The GPU kernel that draws one pixel a thread, from the same functions as the CPU, with spans of one ray.

A block of threads draws a tile of `TILE` pixels a side. Its threads walk the list of plants together, as many at a time
as there are threads: each looks at one plant and, if its billboard touches the tile, sets the plant's bit and puts what
all pixels of it share into shared memory. They stop once no pixel lets light through any more, or each shows ground
nearer than all plants that are left. Arrays of one element stay in registers.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import cuda, float32, int32, uint8, uint32

from thalweg.core.compute.jit import kernel
from thalweg.render.gpu.shared_billboards import (
    SHARED_FLOATS,
    SHARED_INTS,
    billboard_light,
    share_billboard,
    shared_billboard,
    touches_tile,
)
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
from thalweg.render.kernels.plants.billboard import make_billboard, nearest_depth
from thalweg.render.kernels.props import models
from thalweg.render.kernels.props.draw import HALF, LEAST_COVER, meet_parts
from thalweg.render.kernels.props.water import add_waves, mirror_prop, within_box
from thalweg.render.kernels.shading import ground, mirror, reduced_quality, sky, water
from thalweg.render.kernels.shading.background import SEEN, SHORE_M
from thalweg.render.kernels.shading.shore import covered_share, water_shares
from thalweg.render.kernels.table_lookup import bilinear, depth_map
from thalweg.render.kernels.terrain import azimuth_planes, heightfield_march
from thalweg.render.kernels.terrain.heightfield_march import SQUARE, TILE, Tangents, Track
from thalweg.render.kernels.terrain.primary_hits import MISS, class_of
from thalweg.render.records import classes, layout
from thalweg.render.records.props import CLASS_OFFSET, KIND
from thalweg.render.records.view import COLOURS, MASK, View

f32 = np.float32

THREADS = TILE * TILE
WORD = 32
"""Bits of a word."""
WORDS = THREADS // WORD
"""Words with one bit for each thread of a block."""
LESS_THAN_HALF = float(np.nextafter(f32(0.5), f32(0)))
"""Greatest number below a half: light above it is at least a half, and a pixel below it is one of plants for good."""


@cache
def tracer(reduced: bool, drawn: int, with_props: bool = False) -> Callable:
    """Return the kernel for a quality and for what is drawn (see `Output`): without colours, it finds only depth, class
    and mask; for the mask alone, bridges, props and plants only where they hide water. Frames that have no props are
    drawn by a kernel that knows none."""
    coloured, only_mask = drawn == COLOURS, drawn == MASK
    closed = LESS_THAN_HALF
    if coloured:
        closed = reduced_billboard.CLOSED if reduced else billboard.CLOSED

    def trace(scene, views, cameras, moments, nearness, plants, props, buffers):
        """One block a tile (x) of a camera (y): fill `Buffers` [N, H, W].

        moments: of `visible_plants.place_cameras`; nearness: of `ground_profiles.find_nearness`; plants: order,
        distance, boxes, counts of `visible_plants.find`; props: their rows, and what `placed_props.place` fills.
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
        corner = tile_r, tile_c
        behind, behind_depth = kind, depth[0]
        touched = cuda.shared.array(WORDS, uint32)
        stirred = cuda.shared.array(WORDS, uint32)
        cover, prop_r, prop_g, prop_b = f32(0), f32(0), f32(0), f32(0)
        if with_props:
            touch_props(props, n, corner, touched, stirred)
            kind, cover, prop_r, prop_g, prop_b = meet_props(
                scene, view, props, n, touched, r, c, depth, kind, only_mask, coloured
            )
        # Threads outside the image stay alive: they still load plants and meet the barriers.
        inside = r < height and c < width
        asked = inside and (not only_mask or kind == classes.WATER)
        red, green, blue, light, plant_depth = blend_plants(
            scene, view, plants, n, corner, r, asked, f32(closed), reduced, rays, depth
        )
        seen_depth = depth[0]
        passing = light * (f32(1) - cover)
        # As on the CPU, what dense foliage hides is not shaded.
        if coloured and passing > f32(SEEN):
            out = Radiance(cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32))
            depth[0] = behind_depth
            if behind == classes.BRIDGE:
                out.red[0] = stone_r
                out.green[0] = stone_g
                out.blue[0] = stone_b
            elif (
                with_props
                and not reduced
                and behind == classes.WATER
                and is_stirred(scene, view, props, n, stirred, r, c, rays, behind_depth)
            ):
                shade_stirred(scene, view, props, n, stirred, r, c, depth, out)
            else:
                shade_background(scene, view, behind, reduced, r, c, depth, out)
            red += passing * out.red[0]
            green += passing * out.green[0]
            blue += passing * out.blue[0]
        if coloured and with_props:
            red += light * prop_r
            green += light * prop_g
            blue += light * prop_b
        if inside:
            buffers.depth[n, r, c] = seen_depth
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
def touch_props(props, n, corner, touched, stirred):
    """Set a bit for each of a camera's props whose parts touch a tile, and for each whose water does."""
    _, _, _, boxes, zones, counts = props
    tile_r, tile_c = corner
    k = cuda.threadIdx.x
    if k < WORDS:
        touched[k] = uint32(0)
        stirred[k] = uint32(0)
    cuda.syncthreads()
    if k < counts[n]:
        bit = uint32(uint32(1) << uint32(k % WORD))
        if touches_tile(boxes, n, k, tile_r, tile_c):
            cuda.atomic.or_(touched, k // WORD, bit)
        mirrors = touches_tile(zones[..., :4], n, k, tile_r, tile_c)
        if mirrors or touches_tile(zones[..., 4:], n, k, tile_r, tile_c):
            cuda.atomic.or_(stirred, k // WORD, bit)
    cuda.syncthreads()


@kernel(inlined=True)
def meet_props(scene, view, props, n, touched, r, c, depth, kind, only_mask, coloured):
    """Return the class of pixel (r, c) with props drawn, the share that they cover, and their radiance times share.

    depth [1] becomes that of a prop that covers half of the pixel or more.
    """
    rows, parts, numbers, boxes, _, _ = props
    red, green, blue = f32(0), f32(0), f32(0)
    passing = f32(1)
    place = place_of(int32(0), int32(c))
    for word in range(WORDS):
        bits = touched[word]
        # From near to far, as they are numbered.
        while bits != uint32(0):
            k = word * WORD + cuda.ffs(bits) - 1
            bits = uint32(bits & uint32(bits - uint32(1)))
            if not within_box(boxes[n, k], r, place) or (only_mask and kind != classes.WATER):
                continue
            first = k * models.MOST_PARTS
            layers = meet_parts(
                scene, view, parts[n, first : first + numbers[n, k, 1]], r, c, depth[0], kind == classes.WATER, coloured
            )
            rest = f32(1) - layers.cover
            cover = layers.cover + rest * layers.back_cover
            if cover < f32(LEAST_COVER):
                continue
            red += passing * (layers.red + rest * layers.back_red)
            green += passing * (layers.green + rest * layers.back_green)
            blue += passing * (layers.blue + rest * layers.back_blue)
            passing *= f32(1) - cover
            if cover >= f32(HALF):
                depth[0] = layers.t if layers.cover >= f32(HALF) * cover else layers.back_t
                kind = int32(rows[n, numbers[n, k, 0], KIND]) + int32(CLASS_OFFSET)
    return kind, f32(1) - passing, red, green, blue


@kernel(inlined=True)
def is_stirred(scene, view, props, n, stirred, r, c, rays, depth):
    """Return whether pixel (r, c), which shows water at a depth, lies in the water around a prop, and off the shore."""
    zones = props[4]
    place = place_of(int32(0), int32(c))
    found = False
    for word in range(WORDS):
        bits = stirred[word]
        while bits != uint32(0):
            k = word * WORD + cuda.ffs(bits) - 1
            bits = uint32(bits & uint32(bits - uint32(1)))
            found = found or within_box(zones[n, k, :4], r, place) or within_box(zones[n, k, 4:], r, place)
    origin = map_origin(scene, view)
    at = depth_map(scene, view.world)
    return found and bilinear(at, origin.x + rays.x[0] * depth, origin.y + rays.y[0] * depth) >= f32(SHORE_M)


@kernel(inlined=True)
def shade_stirred(scene, view, props, n, stirred, r, c, depth, out):
    """Fill `Radiance` [1] with that of water around props at pixel (r, c), haze included."""
    rows, parts, numbers, _, zones, _ = props
    pixel = row_step(view.camera)
    place = cuda.local.array(1, int32)
    place[0] = place_of(int32(0), int32(c))
    points = empty_points()
    inv_cell = scene.constants[view.world, layout.INV_CELL]
    hit_points(view.camera, map_origin(scene, view), inv_cell, r, place, depth, points, 1)
    surface, mirrored = empty_surface(), empty_mirrored()
    water.ripple_surface(scene, view, points, pixel, surface, 1)
    for word in range(WORDS):
        bits = stirred[word]
        while bits != uint32(0):
            k = word * WORD + cuda.ffs(bits) - 1
            bits = uint32(bits & uint32(bits - uint32(1)))
            add_waves(scene, view, rows[n, numbers[n, k, 0]], zones[n, k, 4:], r, place, points, pixel, surface, 1)
    mirror.mirror_canopy(scene, view, points, pixel, surface, mirrored, out, 1)
    for back in range(WORDS):
        word = WORDS - 1 - back
        bits = stirred[word]
        # From far to near: the nearest is mirrored before all others.
        while bits != uint32(0):
            high = WORD - 1 - cuda.clz(bits)
            bits = uint32(bits ^ uint32(uint32(1) << uint32(high)))
            k = word * WORD + high
            first = k * models.MOST_PARTS
            own = parts[n, first : first + numbers[n, k, 1]]
            prop = rows[n, numbers[n, k, 0]]
            mirror_prop(scene, view, prop, own, zones[n, k, :4], r, place, points, pixel, surface, mirrored, 1)
    water.compose(scene, view, points, pixel, surface, mirrored, out, 1)
    sky.add_haze(scene, view, points, out, 1)


@kernel(inlined=True)
def blend_plants(scene, view, plants, n, corner, r, asked, closed, reduced, rays, depth):
    """Return the red, green and blue that plants add to a pixel, the light that they let through, and their depth.

    corner: row and column of the tile's first pixel; asked: whether the pixel counts; closed: light at which it no
    longer does.
    """
    order, distance, boxes, counts = plants
    tile_r, tile_c = corner
    camera = view.camera
    thread = cuda.threadIdx.x
    sharpen = f32(reduced_billboard.SHARPEN) if reduced else f32(billboard.SHARPEN)
    cell = f32(1) / scene.constants[view.world, layout.INV_CELL]
    # In the reduced quality two rows share their texels and look through the middle between them.
    off = f32(0)
    if reduced:
        off = (f32(r % reduced_billboard.ROWS) - f32(0.5 * reduced_billboard.ROWS - 0.5)) * row_step(camera)
    dx = rays.x[0] * cell + off * camera.up_x
    dy = rays.y[0] * cell + off * camera.up_y
    dz = rays.z[0] + off * camera.up_z
    red = f32(0)
    green = f32(0)
    blue = f32(0)
    light = f32(1)
    plant_depth = f32(MISS)
    floats = cuda.shared.array((SHARED_FLOATS, THREADS), float32)
    ints = cuda.shared.array((SHARED_INTS, THREADS), int32)
    touched = cuda.shared.array(WORDS, uint32)
    first_plant = scene.extents[view.world, layout.PLANT_FROM]
    total = counts[n]
    for first in range(0, total, THREADS):
        # The whole block stops together: a vote says whether any of its pixels still shows plants.
        nearest = nearest_depth(distance[n, order[n, first]], camera)
        if thread < WORDS:
            touched[thread] = uint32(0)
        if cuda.syncthreads_or(int32(asked and light > f32(0) and depth[0] > nearest)) == 0:
            break
        k = first + thread
        touching = k < total and touches_tile(boxes, n, k, tile_r, tile_c)
        if touching:
            cuda.atomic.or_(touched, thread // WORD, uint32(uint32(1) << uint32(thread % WORD)))
            # Each thread prepares one billboard, and all threads then draw it from shared memory.
            p = order[n, k]
            share_billboard(make_billboard(scene, view, first_plant + p, distance[n, p], sharpen), floats, ints, thread)
        cuda.syncthreads()
        # Only the plants that touch the tile are visited: a camera sees a thousand, a tile a few of them.
        for word in range(WORDS):
            bits = touched[word]
            # The same branch for all threads of the block, so that none waits for another.
            while bits != uint32(0):
                board = shared_billboard(floats, ints, word * WORD + cuda.ffs(bits) - 1)
                bits = uint32(bits & uint32(bits - uint32(1)))  # without the lowest one
                add_r, add_g, add_b, part, t = billboard_light(
                    scene.atlas, board, dx, dy, dz, camera.near_m, depth[0], light, closed, reduced
                )  # fmt: skip
                red += add_r
                green += add_g
                blue += add_b
                rest = light - part
                plant_depth = t if light >= f32(0.5) and rest < f32(0.5) else plant_depth
                light = rest
        # Shared memory is written anew in the next round, so all must be done with it.
        cuda.syncthreads()
    return red, green, blue, light, plant_depth


@kernel(inlined=True)
def shade_background(scene, view, kind, reduced, r, c, depth, out):
    """Fill `Radiance` [1] with that of sky, water or ground at pixel (r, c), haze included."""
    inv_cell = scene.constants[view.world, layout.INV_CELL]
    pixel = row_step(view.camera)
    place = cuda.local.array(1, int32)
    place[0] = place_of(int32(0), int32(c))
    points = empty_points()
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
        scratch = water.WaterScratch(empty_surface(), empty_mirrored())
        water.shade_water(scene, view, points, pixel, scratch, out, 1)


@kernel(inlined=True)
def empty_points():
    """Return the `HitPoints` of one pixel, in registers."""
    return HitPoints(
        cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32),
        cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32),
        cuda.local.array(1, float32),
    )  # fmt: skip


@kernel(inlined=True)
def empty_surface():
    """Return the `water.Surface` of one pixel, in registers."""
    return water.Surface(
        cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32),
        cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32),
        cuda.local.array(1, float32),
    )  # fmt: skip


@kernel(inlined=True)
def empty_mirrored():
    """Return the `mirror.Mirrored` of one pixel, in registers."""
    return mirror.Mirrored(
        cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32),
        cuda.local.array(1, float32),
    )  # fmt: skip
