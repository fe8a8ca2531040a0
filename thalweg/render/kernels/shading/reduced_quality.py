"""What does the modest quality leave out? Reflections, filtering between texels, half of the ripples, half of a tree.

Each function stands in for one of the full quality and takes those of its arguments that it needs. Textures are still
read at the level that a pixel's footprint asks for, so that ground and water shimmer no more than before; but only the
nearest texel is taken. Two rows of a plant's picture share a look, and texels between are passed over. How rays are
saved: `thalweg.render.kernels.primary_hits`.
"""

import math

import numpy as np
from numba import int32, uint32, uint64

from thalweg.core.jit import kernel
from thalweg.render.bake import ripples, sky
from thalweg.render.kernels.billboard import BLOCK
from thalweg.render.kernels.fast_math import floor, log2
from thalweg.render.kernels.shading.ground import GRAIN_DEPTH, GRAIN_M
from thalweg.render.kernels.shading.water import (
    DRIFT_A_M_PER_S,
    GLITTER_TINT,
    ROUGHNESS,
    TILE_A_M,
    footprint,
    from_below,
    glints,
    mirrored_ray,
    mirrored_share,
    refracted_slant,
)
from thalweg.render.kernels.table_lookup import bilinear, channel, clamp
from thalweg.render.records import scene as table
from thalweg.render.records.appearance import (
    ABSORB_B,
    ABSORB_G,
    ABSORB_R,
    RIPPLE,
    SCATTER_B,
    SCATTER_G,
    SCATTER_R,
)

f32 = np.float32

CLOSED = 0.1
"""As `picture.CLOSED`: less of what lies behind foliage is drawn."""
SHARPEN = -0.3
"""As `picture.SHARPEN`; below zero for coarser texels, from 0.6 to 1.2 pixels high."""
ROWS = 2
"""Rows of a picture that share their texels."""
BRUSH = 5
"""Rows of scratch that drawing a picture needs."""
RIPPLE_GAIN = 1.4
"""One layer of ripples has to be as steep as two."""
BANK_RISE = 0.18
"""Mirrored rays that rise less than this (metres a metre) meet trees, in place of a look at them."""
BANK_SOFTNESS = 0.25
"""Over so much more of a rise the trees give way to the sky."""
WOOD = (0.030, 0.037, 0.014)
"""What they send back."""


@kernel(inlined=True)
def nearest_paint(scene, w, x, y, level):
    """The packed texel of the paint at node coordinates, at the nearest whole level."""
    low = int32(clamp(level + f32(0.5), f32(0), f32(table.PAINT_LEVELS - 1)))
    shrink = f32(1) / f32(int32(1) << low)
    wide = int32(scene.place[w, table.PAINT_X]) >> low
    high = int32(scene.place[w, table.PAINT_Y]) >> low
    column = int32(clamp((x + f32(0.5)) * shrink, f32(0), f32(wide) - f32(1)))
    row = int32(clamp((y + f32(0.5)) * shrink, f32(0), f32(high) - f32(1)))
    begin = int32(scene.place[w, uint32(int32(table.PAINT_AT) + low)])
    return scene.paint[uint32(begin + row * wide + column)]


@kernel(inlined=True)
def nearest_tile(tile, x, y, level):
    """The packed texel of the ripple tile at texel coordinates of level 0, at the nearest whole level."""
    low = int32(clamp(level + f32(0.5), f32(0), f32(ripples.LEVELS - 1)))
    size = int32(ripples.SIZE) >> low
    begin = (int32(ripples.SIZE * ripples.SIZE) - size * size) * int32(4) // int32(3)
    shrink = f32(1) / f32(int32(1) << low)
    column = int32(floor((x + f32(0.5)) * shrink)) & (size - int32(1))
    row = int32(floor((y + f32(0.5)) * shrink)) & (size - int32(1))
    return tile[uint32(begin + row * size + column)]


@kernel(inlined=True)
def nearest_sky(sky_map, begin, dx, dy, dz):
    """Radiance of the sky's nearest cell in a unit direction: red, green, blue."""
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


@kernel(disjoint=True)
def shade_sky(table_, begin, dx, dy, dz, red, green, blue, n):
    """As `frame.shade_sky`."""
    for i in range(n):
        red[i], green[i], blue[i] = nearest_sky(table_, begin, dx[i], dy[i], dz[i])


@kernel(disjoint=True)
def shade_ground(scene, w, x, y, dz, far, pixel, red, green, blue, n):
    """As `ground.shade_ground`: without the coarser of two grains, and without flecks of light."""
    inv_cell = scene.number[w, table.INV_CELL]
    scale = f32(ripples.SIZE / GRAIN_M) / inv_cell
    code = f32(table.PAINT_RANGE / 255.0**2)
    grain_scale = f32(GRAIN_DEPTH / (255.0 * ripples.GRAIN_SPREAD))
    for i in range(n):
        foot = far[i] * pixel / math.sqrt(max(-dz[i], f32(0.06)))
        texel = nearest_paint(scene, w, x[i], y[i], log2(foot * inv_cell))
        speck = nearest_tile(scene.ripples, x[i] * scale, y[i] * scale, log2(foot * f32(ripples.SIZE / GRAIN_M)))
        grain = (f32(1) + grain_scale * (channel(speck, 24) - f32(127.5))) * code
        r = channel(texel, 0)
        g = channel(texel, 8)
        b = channel(texel, 16)
        red[i] = r * r * grain
        green[i] = g * g * grain
        blue[i] = b * b * grain


@kernel(disjoint=True)
def shade_water(scene, w, look, x, y, dx, dy, dz, far, pixel, time, red, green, blue, n):
    """As `water.shade_water`: one layer of ripples, a bed without stones that refraction does not shift, and dark banks
    below the sky in place of what is mirrored."""
    number = scene.number
    columns = int32(scene.place[w, table.GX])
    rows = int32(scene.place[w, table.GY])
    at = int32(scene.place[w, table.MAP_AT])
    inv_cell = number[w, table.INV_CELL]
    cell = f32(1) / inv_cell
    sky_begin = int32(scene.place[w, table.SKY_AT])
    sun_x = number[w, table.SUN_X]
    sun_y = number[w, table.SUN_Y]
    sun_z = number[w, table.SUN_Z]
    sun_path = refracted_slant(sun_z)
    amplitude = look[RIPPLE] * f32(RIPPLE_GAIN)
    slope_scale = amplitude * f32(ripples.SLOPE_RANGE / 127.5)
    lost_scale = amplitude * amplitude * f32(ripples.VARIANCE_RANGE / 255.0)
    for i in range(n):
        foot = footprint(far[i], pixel, dz[i])
        texel = nearest_tile(
            scene.ripples,
            (x[i] * cell + f32(DRIFT_A_M_PER_S[0]) * time) * f32(ripples.SIZE / TILE_A_M),
            (y[i] * cell + f32(DRIFT_A_M_PER_S[1]) * time) * f32(ripples.SIZE / TILE_A_M),
            log2(foot * f32(ripples.SIZE / TILE_A_M)),
        )
        lean_x = (channel(texel, 0) - f32(127.5)) * slope_scale
        lean_y = (channel(texel, 8) - f32(127.5)) * slope_scale
        spread = channel(texel, 16) * lost_scale + f32(ROUGHNESS)
        facing, rx, ry, rz = mirrored_ray(dx[i], dy[i], dz[i], lean_x, lean_y)
        mirror = mirrored_share(facing, spread)

        depth = max(bilinear(scene.depth, at, columns, rows, x[i], y[i]), f32(0))
        bed = nearest_paint(scene, w, x[i], y[i], log2(foot * inv_cell))
        sunlit = channel(bed, 24) * f32(1 / 255.0)
        whole = depth * (refracted_slant(dz[i]) + sun_path)
        under_r = from_below(channel(bed, 0), whole, look[ABSORB_R], look[SCATTER_R], sunlit)
        under_g = from_below(channel(bed, 8), whole, look[ABSORB_G], look[SCATTER_G], sunlit)
        under_b = from_below(channel(bed, 16), whole, look[ABSORB_B], look[SCATTER_B], sunlit)
        glitter = glints(sun_x, sun_y, sun_z, dx[i], dy[i], dz[i], lean_x, lean_y, spread, sunlit)
        open_sky = clamp((rz - f32(BANK_RISE)) * f32(1 / BANK_SOFTNESS), f32(0), f32(1))
        sky_r, sky_g, sky_b = nearest_sky(scene.sky, sky_begin, rx, ry, rz)
        over_r = sky_r * open_sky + f32(WOOD[0]) * (f32(1) - open_sky)
        over_g = sky_g * open_sky + f32(WOOD[1]) * (f32(1) - open_sky)
        over_b = sky_b * open_sky + f32(WOOD[2]) * (f32(1) - open_sky)
        red[i] = under_r * (f32(1) - mirror) + over_r * mirror + glitter * f32(GLITTER_TINT[0])
        green[i] = under_g * (f32(1) - mirror) + over_g * mirror + glitter * f32(GLITTER_TINT[1])
        blue[i] = under_b * (f32(1) - mirror) + over_b * mirror + glitter * f32(GLITTER_TINT[2])


@kernel(inlined=True)
def picture_pixel(atlas, picture, dx, dy, dz, near):
    """As `picture.picture_pixel`, before what is nearer, or ground before it, is counted.

    Returns its colour, the share of light that it stops, and its depth.
    """
    (far, nx, ny, foot, per_tall, per_half), (begin, wide, high), paint, (dark_r, dark_g, dark_b) = picture
    tint_r, tint_g, tint_b, add_r, add_g, add_b, sun_low, sun_rise = paint
    towards = dx * nx + dy * ny
    t = far / max(towards, f32(1e-4))
    v = (dz * t - foot) * per_tall
    u = (dy * nx - dx * ny) * t * per_half
    inside = (towards > f32(1e-3)) & (t > near) & (v >= f32(0)) & (v < f32(1)) & (abs(u) < f32(1))
    column = int32(clamp((f32(1) - u) * f32(0.5) * f32(wide), f32(0), f32(wide) - f32(1)))
    row = int32(clamp(v * f32(high), f32(0), f32(high) - f32(1)))
    texel = atlas[uint32(begin + row * wide + column)]
    cr = channel(texel, 0)
    cg = channel(texel, 8)
    cb = channel(texel, 16)
    sun = clamp(sun_low + sun_rise * v, f32(0), f32(1))
    cover = channel(texel, 24) * f32(1 / 255.0) if inside else f32(0)
    red = cr * cr * tint_r * (dark_r + (f32(1) - dark_r) * sun) + add_r
    green = cg * cg * tint_g * (dark_g + (f32(1) - dark_g) * sun) + add_g
    blue = cb * cb * tint_b * (dark_b + (f32(1) - dark_b) * sun) + add_b
    return red, green, blue, cover, t


@kernel(disjoint=True)
def draw_picture(atlas, picture, nearest, eye, box, height, top, deepest, brush, planes):
    """As `picture.draw_picture`: two rows at a time, with one look at the texels for both.

    A block is of two rows, and has the number of the upper one. brush: scratch [BRUSH, BLOCK].
    """
    _, _, _, fx, fy, fz, rx, ry, ux, uy, uz, half_w, half_h, per_column, near = eye
    depth, red, green, blue, light, solid = planes
    ink_r, ink_g, ink_b, ink, ink_t = brush[0], brush[1], brush[2], brush[3], brush[4]
    c0, c1, r0, r1 = box
    columns = deepest.shape[1] * BLOCK
    per_row = f32(2) * half_h / f32(height)
    for r in range(r0 // ROWS * ROWS, r1, ROWS):
        sy = half_h - (f32(top + r) + f32(0.5 * ROWS)) * per_row
        base_x = fx + sy * ux
        base_y = fy + sy * uy
        base_z = fz + sy * uz
        for bx in range(c0 // BLOCK, (c1 - 1) // BLOCK + 1):
            if deepest[r, bx] < nearest:
                continue
            left = (f32(bx * BLOCK) + f32(0.5)) * per_column - half_w
            for i in range(BLOCK):
                sx = left + f32(i) * per_column
                ink_r[i], ink_g[i], ink_b[i], ink[i], ink_t[i] = picture_pixel(
                    atlas, picture, base_x + sx * rx, base_y + sx * ry, base_z, near
                )
            still = f32(0)
            for below in range(ROWS):
                first = uint64((r + below) * columns + bx * BLOCK)
                for i in range(BLOCK):
                    k = first + uint64(i)
                    passing = light[k]
                    part = passing * ink[i] if ink_t[i] < depth[k] else f32(0)
                    red[k] += part * ink_r[i]
                    green[k] += part * ink_g[i]
                    blue[k] += part * ink_b[i]
                    rest = passing - part
                    light[k] = rest
                    crossed = (passing >= f32(0.5)) & (rest < f32(0.5))
                    solid[k] = ink_t[i] if crossed else solid[k]
                    still += max(rest - f32(CLOSED), f32(0)) if depth[k] > nearest else f32(0)
            deepest[r, bx] = deepest[r, bx] if still > f32(0) else f32(0)
