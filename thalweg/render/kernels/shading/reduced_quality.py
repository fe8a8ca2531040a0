"""Shading kernels of the reduced quality: no reflected woods, nearest texels, half of the ripples.

Each function stands in for one of the full quality and takes those of its arguments that it needs. Textures are still
read at the level that a pixel's footprint asks for, so that ground and water shimmer no more than in the full quality;
but only the nearest texel is taken. Billboards are in `thalweg.render.kernels.plants.reduced_billboard`.
"""

import math

import numpy as np
from numba import int32, uint32

from thalweg.core.compute.jit import kernel
from thalweg.render.bake import ripples, sky
from thalweg.render.kernels.fast_math import floor, log2
from thalweg.render.kernels.shading.clouds import MIRROR_SOFTNESS, SOFTNESS, add_nearest_clouds, cloud_layer
from thalweg.render.kernels.shading.ground import GRAIN_DEPTH, GRAIN_M
from thalweg.render.kernels.shading.water import TILE_A_M
from thalweg.render.kernels.shading.water_optics import (
    GLITTER_TINT,
    ROUGHNESS,
    footprint,
    from_below,
    glints,
    mirrored_ray,
    mirrored_share,
    refracted_slant,
)
from thalweg.render.kernels.table_lookup import bilinear, channel, clamp, depth_map
from thalweg.render.records import layout
from thalweg.render.records.appearance import (
    ABSORB_B,
    ABSORB_G,
    ABSORB_R,
    DRIFT_A_X,
    DRIFT_A_Y,
    RIPPLE,
    SCATTER_B,
    SCATTER_G,
    SCATTER_R,
)

f32 = np.float32

RIPPLE_GAIN = 1.4
"""Factor on the slopes of the one layer of ripples, which has to be as steep as two."""
BANK_RISE = 0.18
"""Mirrored rays that rise by less than this (metres per metre) meet trees; the canopy map is not read."""
BANK_SOFTNESS = 0.25
"""Range of rise over which the trees give way to the sky."""
WOOD = (0.030, 0.037, 0.014)
"""Radiance of those trees."""


@kernel(inlined=True, allocates=False)
def nearest_paint(scene, world, x, y, level):
    """The packed texel of the paint nearest to node coordinates, on the nearest mip level."""
    low = int32(clamp(level + f32(0.5), f32(0), f32(layout.PAINT_LEVELS - 1)))
    shrink = f32(1) / f32(int32(1) << low)
    wide = int32(scene.extents[world, layout.PAINT_X]) >> low
    high = int32(scene.extents[world, layout.PAINT_Y]) >> low
    column = int32(clamp((x + f32(0.5)) * shrink, f32(0), f32(wide) - f32(1)))
    row = int32(clamp((y + f32(0.5)) * shrink, f32(0), f32(high) - f32(1)))
    begin = int32(scene.extents[world, uint32(int32(layout.PAINT_AT) + low)])
    return scene.paint[uint32(begin + row * wide + column)]


@kernel(inlined=True, allocates=False)
def nearest_tile(tile, x, y, level):
    """The packed texel of the ripple tile nearest to texel coordinates of level 0, on the nearest mip level."""
    low = int32(clamp(level + f32(0.5), f32(0), f32(ripples.LEVELS - 1)))
    size = int32(ripples.SIZE) >> low
    # The mip levels lie one after another; this is the sum of the larger ones.
    begin = (int32(ripples.SIZE * ripples.SIZE) - size * size) * int32(4) // int32(3)
    shrink = f32(1) / f32(int32(1) << low)
    column = int32(floor((x + f32(0.5)) * shrink)) & (size - int32(1))
    row = int32(floor((y + f32(0.5)) * shrink)) & (size - int32(1))
    return tile[uint32(begin + row * size + column)]


@kernel(inlined=True, allocates=False)
def nearest_sky(sky_map, begin, dx, dy, dz):
    """Radiance of the sky's nearest texel in a unit direction: red, green, blue. See `table_lookup.sky_at`."""
    # As in `table_lookup.sky_at`, but the direction has unit length already.
    root = math.sqrt(abs(dz))
    v = (f32(0.5) + f32(0.5) * (root if dz > f32(0) else -root)) * f32(sky.ROWS)
    east = dx / (abs(dx) + abs(dy) + f32(1e-12))
    turn = f32(1) - east if dy >= f32(0) else f32(3) + east
    column = int32(turn * f32(sky.COLUMNS / 4)) & int32(sky.COLUMNS - 1)
    row = int32(clamp(v, f32(0), f32(sky.ROWS - 1)))
    texel = sky_map[uint32(begin + row * int32(sky.COLUMNS) + column)]
    scale = f32(sky.CODE_RANGE / 255.0**2)
    red = channel(texel, 0)
    green = channel(texel, 8)
    blue = channel(texel, 16)
    return red * red * scale, green * green * scale, blue * blue * scale


@kernel(disjoint=True, allocates=False)
def shade_sky(scene, view, points, out, n):
    """As `sky.shade_sky`, from the nearest texel."""
    _, _, _, dx, dy, dz, _ = points
    red, green, blue = out
    begin = int32(scene.extents[view.world, layout.SKY_AT])
    layer = cloud_layer(scene, view, f32(SOFTNESS))
    table = scene.sky
    clouds = scene.clouds
    for i in range(n):
        r, g, b = nearest_sky(table, begin, dx[i], dy[i], dz[i])
        red[i], green[i], blue[i] = add_nearest_clouds(clouds, layer, dx[i], dy[i], dz[i], r, g, b)


@kernel(disjoint=True, allocates=False)
def shade_ground(scene, view, points, pixel, out, n):
    """As `ground.shade_ground`, without the coarser of two grains and without flecks of light."""
    x, y, _, _, _, dz, distance = points
    red, green, blue = out
    inv_cell = scene.constants[view.world, layout.INV_CELL]
    scale = f32(ripples.SIZE / GRAIN_M) / inv_cell
    code = f32(layout.PAINT_RANGE / 255.0**2)
    grain_scale = f32(GRAIN_DEPTH / (255.0 * ripples.GRAIN_SPREAD))
    for i in range(n):
        foot = distance[i] * pixel / math.sqrt(max(-dz[i], f32(0.06)))
        texel = nearest_paint(scene, view.world, x[i], y[i], log2(foot * inv_cell))
        speck = nearest_tile(scene.ripples, x[i] * scale, y[i] * scale, log2(foot * f32(ripples.SIZE / GRAIN_M)))
        grain = (f32(1) + grain_scale * (channel(speck, 24) - f32(127.5))) * code
        # The square undoes the square-root code.
        r = channel(texel, 0)
        g = channel(texel, 8)
        b = channel(texel, 16)
        red[i] = r * r * grain
        green[i] = g * g * grain
        blue[i] = b * b * grain


@kernel(disjoint=True, allocates=False)
def shade_water(scene, view, points, pixel, out, n):
    """As `water.shade_water`, with one layer of ripples, a bed without stones that refraction does not shift, and dark
    banks below the sky in place of the mirrored canopies."""
    x, y, _, dx, dy, dz, distance = points
    red, green, blue = out
    look = view.look
    time = view.time
    number = scene.constants
    water = depth_map(scene, view.world)
    inv_cell = number[view.world, layout.INV_CELL]
    cell = f32(1) / inv_cell
    sky_begin = int32(scene.extents[view.world, layout.SKY_AT])
    sun = number[view.world, layout.SUN_X], number[view.world, layout.SUN_Y], number[view.world, layout.SUN_Z]
    sun_path = refracted_slant(sun[2])
    drift_x = look[DRIFT_A_X] * time
    drift_y = look[DRIFT_A_Y] * time
    amplitude = look[RIPPLE] * f32(RIPPLE_GAIN)
    slope_scale = amplitude * f32(ripples.SLOPE_RANGE / 127.5)
    lost_scale = amplitude * amplitude * f32(ripples.VARIANCE_RANGE / 255.0)
    layer = cloud_layer(scene, view, f32(MIRROR_SOFTNESS))
    for i in range(n):
        # One footprint chooses the levels of ripples and bed.
        foot = footprint(distance[i], pixel, dz[i])
        texel = nearest_tile(
            scene.ripples,
            (x[i] * cell + drift_x) * f32(ripples.SIZE / TILE_A_M),
            (y[i] * cell + drift_y) * f32(ripples.SIZE / TILE_A_M),
            log2(foot * f32(ripples.SIZE / TILE_A_M)),
        )
        lean_x = (channel(texel, 0) - f32(127.5)) * slope_scale
        lean_y = (channel(texel, 8) - f32(127.5)) * slope_scale
        spread = channel(texel, 16) * lost_scale + f32(ROUGHNESS)
        facing, rx, ry, rz = mirrored_ray(dx[i], dy[i], dz[i], lean_x, lean_y)
        mirror = mirrored_share(facing, spread)

        depth = max(bilinear(water, x[i], y[i]), f32(0))
        bed = nearest_paint(scene, view.world, x[i], y[i], log2(foot * inv_cell))
        sunlit = channel(bed, 24) * f32(1 / 255.0)
        # Light passes the water twice: down from the sun and up to the camera.
        path = depth * (refracted_slant(dz[i]) + sun_path)
        under_r = from_below(channel(bed, 0), path, look[ABSORB_R], look[SCATTER_R], sunlit)
        under_g = from_below(channel(bed, 8), path, look[ABSORB_G], look[SCATTER_G], sunlit)
        under_b = from_below(channel(bed, 16), path, look[ABSORB_B], look[SCATTER_B], sunlit)
        glitter = glints(sun, dx[i], dy[i], dz[i], lean_x, lean_y, spread, sunlit)
        # The steeper a mirrored ray, the more likely it clears the banks.
        open_sky = clamp((rz - f32(BANK_RISE)) * f32(1 / BANK_SOFTNESS), f32(0), f32(1))
        sky_r, sky_g, sky_b = nearest_sky(scene.sky, sky_begin, rx, ry, rz)
        sky_r, sky_g, sky_b = add_nearest_clouds(scene.clouds, layer, rx, ry, rz, sky_r, sky_g, sky_b)
        over_r = sky_r * open_sky + f32(WOOD[0]) * (f32(1) - open_sky)
        over_g = sky_g * open_sky + f32(WOOD[1]) * (f32(1) - open_sky)
        over_b = sky_b * open_sky + f32(WOOD[2]) * (f32(1) - open_sky)
        red[i] = under_r * (f32(1) - mirror) + over_r * mirror + glitter * f32(GLITTER_TINT[0])
        green[i] = under_g * (f32(1) - mirror) + over_g * mirror + glitter * f32(GLITTER_TINT[1])
        blue[i] = under_b * (f32(1) - mirror) + over_b * mirror + glitter * f32(GLITTER_TINT[2])
