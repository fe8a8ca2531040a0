"""What does a river look like? Its bed through absorbing water, the sky and the woods mirrored in ripples, and glitter.

`shade_water` shades a list of water pixels in three passes: ripples, what is mirrored, what lies below. From where:

* Fresnel reflectance, n = 1.333: Schlick, "An Inexpensive BRDF Model", 1994; lessened by the spread of the ripples'
  slopes as in Bruneton, Neyret, Holzschuch, "Real-time Realistic Ocean Lighting", 2010, equation 20.
* Absorption and scattering over the refracted path: Beer, Lambert.
* Glitter: the density of slopes that mirror the sun, Gaussian; Cox, Munk, "Measurement of the Roughness of the Sea
  Surface", 1954.
* Ripples: two layers of one prefiltered tile drifting apart (`thalweg.render.bake.ripples`).
* The mirrored picture: the reflected ray marched over the map of canopies in growing steps.

Absent on purpose: waves that move the surface, foam, and the mirror image of single trees.
"""

import math

import numpy as np
from numba import int32, uint32

from thalweg.core.jit import kernel
from thalweg.render.bake import ripples
from thalweg.render.kernels.fast_math import exp, log2
from thalweg.render.kernels.shading.ground import tile_grain
from thalweg.render.kernels.table_lookup import bilinear, channel, clamp, paint_level, sky_at, tile_level
from thalweg.render.records import scene as table
from thalweg.render.records.appearance import (
    ABSORB_B,
    ABSORB_G,
    ABSORB_R,
    HAZE_PER_M,
    RIPPLE,
    SCATTER_B,
    SCATTER_G,
    SCATTER_R,
)

f32 = np.float32

INDEX = 1.333
TILE_A_M = 7.3
TILE_B_M = 2.9
DRIFT_A_M_PER_S = (0.35, 0.12)
DRIFT_B_M_PER_S = (-0.14, 0.23)
ROUGHNESS = 0.0020
"""Mean square slope of the ripples too small for the tile."""
SHADE_GLOW = 0.12
"""Share of the scattered light that is left in the shade."""
BED_M = 4.6
"""Side of the tile of stones on the bed."""
BED_DEPTH = 0.16
"""Contrast of the stones' brightness."""
BED_ROUGH = 0.22
"""Share by which stones and holes change the depth."""
SUN_WIDTH = 0.0006
"""Mean square slope that the sun's own width adds to a glint."""
GLITTER = 0.014
"""Radiance of a glint, as a share of the density of slopes that mirror the sun."""
GLITTER_MOST = 0.7
GLITTER_TINT = (1.0, 0.95, 0.86)
WORK = 11
"""Arrays of scratch that the shading needs."""
MIRROR_STEPS = 14
MIRROR_FIRST_M = 0.4
MIRROR_GROWTH = 1.45
MIRROR_BLUR_M = 0.25
MIRROR_BLUR = 0.18
"""The edge of a canopy is as soft as this, and this times the distance, for a step may pass over it."""


@kernel(inlined=True)
def ripple_layer(tile, x, y, level):
    """Slopes and lost mean square slope of one layer at tile coordinates, filtered to a (fractional) level."""
    level = clamp(level, f32(0), f32(ripples.LEVELS - 1.01))
    low = int32(level)
    share = level - f32(low)
    a_x, a_y, a_lost, _ = tile_level(tile, x, y, low)
    b_x, b_y, b_lost, _ = tile_level(tile, x, y, low + int32(1))
    half = f32(127.5)
    scale = f32(ripples.SLOPE_RANGE / 127.5)
    slope_x = (a_x + (b_x - a_x) * share - half) * scale
    slope_y = (a_y + (b_y - a_y) * share - half) * scale
    return slope_x, slope_y, (a_lost + (b_lost - a_lost) * share) * f32(ripples.VARIANCE_RANGE / 255.0)


@kernel
def shade_water(scene, w, look, x, y, z, dx, dy, dz, far, pixel, time, work, red, green, blue, n):
    """Radiance [n] of water pixels.

    x, y: node coordinates, z: height in metres; dx, dy, dz: unit direction of sight in metres; far: distance in metres;
    pixel: angle of a pixel; time in seconds; work: WORK arrays [n] of scratch.
    """
    slope_x, slope_y, spread, facing, rx, ry, rz, passing, up_r, up_g, up_b = work
    ripple(scene, w, look, x, y, dx, dy, dz, far, pixel, time, slope_x, slope_y, spread, facing, rx, ry, rz, n)
    mirror_canopy(scene, w, look, x, y, z, rx, ry, rz, up_r, up_g, up_b, passing, red, n)
    compose(
        scene, w, look, x, y, dx, dy, dz, far, pixel, slope_x, slope_y, spread, facing, rx, ry, rz, passing,
        up_r, up_g, up_b, red, green, blue, n,
    )  # fmt: skip


@kernel(inlined=True)
def mirrored_ray(dx, dy, dz, lean_x, lean_y):
    """The cosine between sight and a surface of these slopes, and the mirrored ray, which never points down."""
    size = f32(1) / math.sqrt(f32(1) + lean_x * lean_x + lean_y * lean_y)
    facing = clamp((dx * lean_x + dy * lean_y - dz) * size, f32(0.01), f32(1))
    rx = dx - f32(2) * facing * lean_x * size
    ry = dy - f32(2) * facing * lean_y * size
    return facing, rx, ry, max(dz + f32(2) * facing * size, f32(0.02))


@kernel(inlined=True)
def mirrored_share(facing, spread):
    """Fresnel reflectance of rippled water; spread: mean square slope of the ripples too small to be seen."""
    graze = f32(1) - facing
    graze2 = graze * graze
    rough = math.sqrt(spread)
    return f32(0.02) + f32(0.98) * graze2 * graze2 * graze / (f32(1) + f32(22.7) * rough * math.sqrt(rough))


@kernel(inlined=True)
def refracted_slant(dz):
    """The length of a refracted ray's way through water of depth 1; dz: how much its unit direction rises or falls."""
    return f32(1) / math.sqrt(f32(1) - (f32(1) - dz * dz) * f32(1 / INDEX**2))


@kernel(inlined=True)
def from_below(bed, whole, absorb, scatter, sunlit):
    """Radiance from under water in one channel: of the bed, `whole` metres of water away, and scattered on the way."""
    through = exp(-absorb * whole)
    glow = f32(SHADE_GLOW) + f32(1 - SHADE_GLOW) * sunlit
    return bed * bed * f32(table.PAINT_RANGE / 255.0**2) * through + scatter * glow * (f32(1) - through)


@kernel(inlined=True)
def glints(sun_x, sun_y, sun_z, dx, dy, dz, lean_x, lean_y, spread, sunlit):
    """Radiance of the ripples within a pixel that mirror the sun: as many as have the slope half way between."""
    half_z = sun_z - dz
    off_x = -(sun_x - dx) / half_z - lean_x
    off_y = -(sun_y - dy) / half_z - lean_y
    width = spread + f32(SUN_WIDTH)
    density = exp(-(off_x * off_x + off_y * off_y) / (f32(2) * width)) / (f32(6.2832) * width)
    return min(f32(GLITTER) * density * sunlit, f32(GLITTER_MOST))


@kernel(inlined=True)
def footprint(far, pixel, vz):
    """Side of a pixel on the water in metres: it is stretched along the ray, and the geometric mean sets the level."""
    return far * pixel / math.sqrt(max(-vz, f32(0.03)))


@kernel(disjoint=True)
def ripple(scene, w, look, x, y, dx, dy, dz, far, pixel, time, slope_x, slope_y, spread, facing, rx, ry, rz, n):
    """Slopes [n] of the water, the mean square of those too small to be seen, the cosine of sight, the mirrored ray."""
    cell = f32(1) / scene.number[w, table.INV_CELL]
    tile = scene.ripples
    amplitude = look[RIPPLE]
    for i in range(n):
        foot = footprint(far[i], pixel, dz[i])
        mx = x[i] * cell
        my = y[i] * cell
        ax, ay, a_lost = ripple_layer(
            tile,
            (mx + f32(DRIFT_A_M_PER_S[0]) * time) * f32(ripples.SIZE / TILE_A_M),
            (my + f32(DRIFT_A_M_PER_S[1]) * time) * f32(ripples.SIZE / TILE_A_M),
            log2(foot * f32(ripples.SIZE / TILE_A_M)),
        )
        # The second layer is turned by about 53 degrees, so that the tiles do not repeat together.
        bx, by, b_lost = ripple_layer(
            tile,
            (f32(0.6) * mx + f32(0.8) * my + f32(DRIFT_B_M_PER_S[0]) * time) * f32(ripples.SIZE / TILE_B_M),
            (f32(0.6) * my - f32(0.8) * mx + f32(DRIFT_B_M_PER_S[1]) * time) * f32(ripples.SIZE / TILE_B_M),
            log2(foot * f32(ripples.SIZE / TILE_B_M)),
        )
        lean_x = amplitude * (ax + f32(0.6) * bx - f32(0.8) * by)
        lean_y = amplitude * (ay + f32(0.8) * bx + f32(0.6) * by)
        slope_x[i] = lean_x
        slope_y[i] = lean_y
        spread[i] = amplitude * amplitude * (a_lost + b_lost) + f32(ROUGHNESS)
        facing[i], rx[i], ry[i], rz[i] = mirrored_ray(dx[i], dy[i], dz[i], lean_x, lean_y)


@kernel(disjoint=True)
def mirror_canopy(scene, w, look, x, y, z, rx, ry, rz, red, green, blue, passing, met_at, n):
    """What the canopies send along reflected rays [n], haze included, and the share `passing` of the sky behind.

    met_at [n] is scratch.
    """
    columns = int32(scene.place[w, table.CANOPY_X])
    rows = int32(scene.place[w, table.CANOPY_Y])
    at = int32(scene.place[w, table.CANOPY_AT])
    fog_r = scene.number[w, table.FOG_R]
    fog_g = scene.number[w, table.FOG_G]
    fog_b = scene.number[w, table.FOG_B]
    step = scene.number[w, table.INV_CELL] * f32(1 / table.CANOPY_CELL)
    code = f32(table.PAINT_RANGE / 255.0**2)
    canopy = scene.canopy
    paint = scene.canopy_paint
    for i in range(n):
        met_at[i] = f32(0)
        passing[i] = f32(1)
        red[i] = f32(0)
        green[i] = f32(0)
        blue[i] = f32(0)
    s = f32(MIRROR_FIRST_M)
    for _ in range(MIRROR_STEPS):
        blur = f32(1) / (f32(MIRROR_BLUR_M) + f32(MIRROR_BLUR) * s)
        for i in range(n):
            column = int32(clamp(x[i] * f32(1 / table.CANOPY_CELL) + rx[i] * s * step, f32(0), f32(columns - 1)))
            row = int32(clamp(y[i] * f32(1 / table.CANOPY_CELL) + ry[i] * s * step, f32(0), f32(rows - 1)))
            k = uint32(at + row * columns + column)
            above = canopy[k] - z[i] - rz[i] * s
            part = passing[i] * clamp(above * blur, f32(0), f32(1))
            seen = paint[k]
            a = channel(seen, 0)
            b = channel(seen, 8)
            c = channel(seen, 16)
            red[i] += part * a * a
            green[i] += part * b * b
            blue[i] += part * c * c
            met_at[i] += part * s
            passing[i] -= part
        s = s * f32(MIRROR_GROWTH)
    for i in range(n):
        clear = exp(-met_at[i] * look[HAZE_PER_M])
        haze = (f32(1) - passing[i]) * (f32(1) - clear)
        red[i] = red[i] * code * clear + fog_r * haze
        green[i] = green[i] * code * clear + fog_g * haze
        blue[i] = blue[i] * code * clear + fog_b * haze


@kernel(disjoint=True)
def compose(
    scene, w, look, x, y, dx, dy, dz, far, pixel, slope_x, slope_y, spread, facing, rx, ry, rz, passing,
    up_r, up_g, up_b, red, green, blue, n,
):  # fmt: skip
    """Radiance [n]: the bed through the water, by Fresnel the mirrored canopy and sky, and the sun's glitter."""
    place = scene.place
    number = scene.number
    columns = int32(place[w, table.GX])
    rows = int32(place[w, table.GY])
    at = int32(place[w, table.MAP_AT])
    inv_cell = number[w, table.INV_CELL]
    cell = f32(1) / inv_cell
    wide = int32(place[w, table.PAINT_X])
    high = int32(place[w, table.PAINT_Y])
    sky_begin = int32(place[w, table.SKY_AT])
    sun_x = number[w, table.SUN_X]
    sun_y = number[w, table.SUN_Y]
    sun_z = number[w, table.SUN_Z]
    depth_map = scene.depth
    paint = scene.paint
    sky_map = scene.sky
    sun_path = refracted_slant(sun_z)
    for i in range(n):
        mirror = mirrored_share(facing[i], spread[i])

        # The bed, where the refracted ray meets it.
        depth = max(bilinear(depth_map, at, columns, rows, x[i], y[i]), f32(0))
        hx = dx[i] * f32(1 / INDEX) + slope_x[i] * f32(0.25)
        hy = dy[i] * f32(1 / INDEX) + slope_y[i] * f32(0.25)
        path = depth / math.sqrt(max(f32(1) - hx * hx - hy * hy, f32(0.1)))
        bed_x = x[i] + hx * path * inv_cell
        bed_y = y[i] + hy * path * inv_cell
        foot = footprint(far[i], pixel, dz[i])
        level = clamp(log2(foot * inv_cell), f32(0), f32(table.PAINT_LEVELS - 1.01))
        low = int32(level)
        share = level - f32(low)
        r0, g0, b0, s0 = paint_level(
            paint, int32(place[w, uint32(int32(table.PAINT_AT) + low)]), wide, high, bed_x, bed_y, low
        )
        low += int32(1)
        r1, g1, b1, s1 = paint_level(
            paint, int32(place[w, uint32(int32(table.PAINT_AT) + low)]), wide, high, bed_x, bed_y, low
        )
        # Pebbles and holes too small for the map of depths, most of all where it is shallow.
        pebbles = tile_grain(scene.ripples, bed_x * cell, bed_y * cell, foot, f32(BED_M))
        rugged = max(f32(1) + f32(BED_ROUGH) * pebbles, f32(0))
        bright = max(f32(1) + f32(BED_DEPTH) * pebbles, f32(0.2))
        r0 = (r0 + (r1 - r0) * share) * bright
        g0 = (g0 + (g1 - g0) * share) * bright
        b0 = (b0 + (b1 - b0) * share) * bright
        sunlit = (s0 + (s1 - s0) * share) * f32(1 / 255.0)
        whole = (path + depth * sun_path) * rugged
        under_r = from_below(r0, whole, look[ABSORB_R], look[SCATTER_R], sunlit)
        under_g = from_below(g0, whole, look[ABSORB_G], look[SCATTER_G], sunlit)
        under_b = from_below(b0, whole, look[ABSORB_B], look[SCATTER_B], sunlit)
        glitter = glints(
            sun_x, sun_y, sun_z, dx[i], dy[i], dz[i], slope_x[i], slope_y[i], spread[i], sunlit * passing[i]
        )
        sky_r, sky_g, sky_b = sky_at(sky_map, sky_begin, rx[i], ry[i], rz[i])
        over_r = (up_r[i] + sky_r * passing[i]) * mirror
        over_g = (up_g[i] + sky_g * passing[i]) * mirror
        over_b = (up_b[i] + sky_b * passing[i]) * mirror
        red[i] = under_r * (f32(1) - mirror) + over_r + glitter * f32(GLITTER_TINT[0])
        green[i] = under_g * (f32(1) - mirror) + over_g + glitter * f32(GLITTER_TINT[1])
        blue[i] = under_b * (f32(1) - mirror) + over_b + glitter * f32(GLITTER_TINT[2])
