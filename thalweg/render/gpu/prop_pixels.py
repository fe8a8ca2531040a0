"""Props at a pixel: what they cover of it, and the water around them, from the same functions as the CPU.

The threads of a block first set a bit for each prop that touches their tile, or whose water does; each pixel then
visits those only.
"""

import numpy as np
from numba import cuda, int32, uint32

from thalweg.core.compute.jit import kernel
from thalweg.render.gpu.pixel_records import empty_mirrored, empty_points, empty_surface
from thalweg.render.gpu.tile import WORD, WORDS, touches_tile
from thalweg.render.kernels.camera_rays import hit_points, map_origin, place_of, row_step
from thalweg.render.kernels.props import models
from thalweg.render.kernels.props.boxes import within_box
from thalweg.render.kernels.props.layers import (
    HALF,
    LEAST_COVER,
    is_hidden,
    layered,
    no_layers,
    pixel_sight,
    seen_depth,
    sharpness,
    total_cover,
    total_radiance,
    uncut_share,
)
from thalweg.render.kernels.props.mirror_rays import (
    mapped_ray,
    mirrored_radiance,
    mirrored_strength,
    passes_by,
    put_before,
    stopped,
    water_ray,
)
from thalweg.render.kernels.props.paint import sight_radiance
from thalweg.render.kernels.props.pose import C0, C1, FADE, R0, R1, SHAPE, TAPER, solid_ray
from thalweg.render.kernels.props.solids import meet_solid
from thalweg.render.kernels.props.water import add_waves
from thalweg.render.kernels.shading import mirror, sky, water
from thalweg.render.kernels.shading.background import SHORE_M
from thalweg.render.kernels.table_lookup import bilinear, depth_map
from thalweg.render.records import classes, layout
from thalweg.render.records.props import CLASS_OFFSET, KIND

f32 = np.float32


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
def meet_props_at_pixel(scene, view, props, n, touched, r, c, depth, kind, only_mask, coloured):
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
            cover = total_cover(layers)
            if cover < f32(LEAST_COVER):
                continue
            own_red, own_green, own_blue = total_radiance(layers)
            red += passing * own_red
            green += passing * own_green
            blue += passing * own_blue
            passing *= f32(1) - cover
            if cover >= f32(HALF):
                depth[0] = seen_depth(layers, cover)
                kind = int32(rows[n, numbers[n, k, 0], KIND]) + int32(CLASS_OFFSET)
    return kind, f32(1) - passing, red, green, blue


@kernel(inlined=True)
def meet_parts(scene, view, parts, row, column, behind, on_water, coloured):
    """Return the `Layers` of posed parts in a pixel of the image.

    behind: depth of what they are before, which is water if on_water; coloured: whether their radiance counts.
    """
    sight = pixel_sight(view.camera, row, column)
    sharp = sharpness(view.camera, sight.z, behind, on_water)
    layers = no_layers()
    x, y = f32(column), f32(row)
    for k in range(len(parts)):
        if x >= parts[k, C0] and x < parts[k, C1] and y >= parts[k, R0] and y < parts[k, R1]:
            layers = with_part(scene, view, parts[k], sight, behind, sharp, coloured, layers)
    return layers


@kernel(inlined=True)
def with_part(scene, view, part, sight, behind, sharp, coloured, layers):
    """Return `Layers` with a posed part added if a `PixelSight` meets it; behind, sharp: as in `uncut_share`."""
    camera = view.camera
    hit = meet_solid(part[SHAPE], part[TAPER], solid_ray(part, camera, sight.sx, sight.sy))
    cover = hit.cover * part[FADE] * uncut_share(camera, hit.t, behind, sharp)
    if cover < f32(LEAST_COVER):
        return layers
    red, green, blue = f32(0), f32(0), f32(0)
    if coloured and not is_hidden(layers, hit.t):
        red, green, blue = sight_radiance(scene, view, part, row_step(camera), sight, hit)
    return layered(layers, cover, hit.t, cover * red, cover * green, cover * blue)


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
def shade_stirred_at_pixel(scene, view, props, n, stirred, r, c, depth, out):
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
            add_waves(scene, view, rows[n, numbers[n, k, 0]], zones[n, k, 4:], r, place, points, pixel, surface, 0, 1)
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
            if within_box(zones[n, k, :4], r, place[0]):
                mirror_prop_at_pixel(scene, view, prop, own, points, surface, mirrored)
    water.compose(scene, view, points, pixel, surface, mirrored, out, 1)
    sky.add_haze(scene, view, points, out, 1)


@kernel(inlined=True)
def mirror_prop_at_pixel(scene, view, prop, parts, points, surface, mirrored):
    """Put a prop before what the mirrored ray of a `water.Surface` [1] at `HitPoints` [1] meets, in `Mirrored` [1].

    parts: its posed ones.
    """
    camera = view.camera
    pixel = row_step(camera)
    strength = mirrored_strength(camera, prop)
    ray = water_ray(scene, view.world, points, pixel, surface, 0)
    for k in range(int32(models.KINDS[int32(prop[KIND]), models.MAIN])):
        part = parts[k]
        if part[FADE] == f32(0) or passes_by(camera, part, ray):
            continue
        mapped, width = mapped_ray(camera, part, ray)
        hit = stopped(meet_solid(part[SHAPE], part[TAPER], mapped), width)
        if hit.cover >= f32(LEAST_COVER):
            red, green, blue = mirrored_radiance(scene, view, part, pixel, ray, hit)
            put_before(mirrored, 0, hit.cover * strength, red, green, blue)
