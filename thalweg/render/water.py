"""What does a river look like? Its bed through absorbing water, the sky and the woods mirrored in ripples, and glitter.

One function shades a list of water pixels; what is in it, and from where:

* Fresnel reflectance, n = 1.333: Schlick, "An Inexpensive BRDF Model", 1994; lessened by the spread of the ripples' slopes
  as in Bruneton, Neyret, Holzschuch, "Real-time Realistic Ocean Lighting", 2010, equation 20.
* Absorption and scattering over the refracted path: Beer, Lambert.
* Glitter: the density of slopes that mirror the sun, Gaussian; Cox, Munk, "Measurement of the Roughness of the Sea
  Surface", 1954.
* Ripples: two layers of one prefiltered tile drifting apart (`thalweg.render.ripples`).
* The mirrored picture: the reflected ray marched over the map of canopies in growing steps.

Absent on purpose: waves that move the surface, foam, and the mirror image of single trees.
"""

import numpy as np
from numba import int32, uint32

from thalweg.kernel import kernel
from thalweg.render import ripples
from thalweg.render import scene as table
from thalweg.render.approx import exp, log2
from thalweg.render.fetch import bilinear, channel, clamp, paint_level, sky_at, tile_level

f32 = np.float32

INDEX = 1.333
ABSORB = (0.95, 1.02, 1.18)
"""Share of red, green, blue lost per metre of water (as exponents)."""
SCATTER = (0.0080, 0.0084, 0.0080)
"""Radiance that deep water sends up in full sun."""
TILE_A_M = 7.3
TILE_B_M = 2.9
DRIFT_A_M_PER_S = (0.35, 0.12)
DRIFT_B_M_PER_S = (-0.14, 0.23)
AMPLITUDE = 0.55
"""Of each ripple layer's slopes, whose mean square in the tile is fixed."""
ROUGHNESS = 0.0012
"""Mean square slope of the ripples too small for the tile."""
SHADE_GLOW = 0.12
"""Share of SCATTER that is left in the shade."""
SUN_WIDTH = 0.0006
"""Mean square slope that the sun's own width adds to a glint."""
GLITTER_MOST = 1.6
GLITTER_TINT = (1.0, 0.95, 0.86)
MIRROR_STEPS = 14
MIRROR_FIRST_M = 0.4
MIRROR_GROWTH = 1.45
MIRROR_BLUR_M = 0.25
MIRROR_BLUR = 0.05
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


@kernel(inlined=True)
def shade_water(scene, w, x, y, z, dx, dy, dz, far, pixel, time, red, green, blue, n):
    """Radiance [n] of water pixels.

    x, y: node coordinates, z: height in metres; dx, dy, dz: unit direction of sight in metres; far: distance in metres;
    pixel: angle of a pixel; time in seconds.
    """
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
    canopy_columns = int32(place[w, table.CANOPY_X])
    canopy_rows = int32(place[w, table.CANOPY_Y])
    canopy_at = int32(place[w, table.CANOPY_AT])
    sun_x = number[w, table.SUN_X]
    sun_y = number[w, table.SUN_Y]
    sun_z = number[w, table.SUN_Z]
    fog_r = number[w, table.FOG_R]
    fog_g = number[w, table.FOG_G]
    fog_b = number[w, table.FOG_B]
    code = f32(table.PAINT_RANGE / 255.0**2)
    depth_map = scene.depth
    paint = scene.paint
    begins = place[w, table.PAINT_AT : table.PAINT_AT + table.PAINT_LEVELS]
    sun_path = f32(1) / np.sqrt(f32(1) - (f32(1) - sun_z * sun_z) / f32(INDEX * INDEX))

    for i in range(n):
        px = x[i]
        py = y[i]
        vx = dx[i]
        vy = dy[i]
        vz = dz[i]
        # A pixel's footprint is stretched along the ray; the geometric mean of both sides sets the level.
        foot = far[i] * pixel / np.sqrt(max(-vz, f32(0.03)))
        mx = px * cell
        my = py * cell
        ax, ay, a_lost = ripple_layer(
            scene.ripples,
            (mx + f32(DRIFT_A_M_PER_S[0]) * time) * f32(ripples.SIZE / TILE_A_M),
            (my + f32(DRIFT_A_M_PER_S[1]) * time) * f32(ripples.SIZE / TILE_A_M),
            log2(foot * f32(ripples.SIZE / TILE_A_M)),
        )
        # The second layer is turned by about 53 degrees, so that the tiles do not repeat together.
        bx, by, b_lost = ripple_layer(
            scene.ripples,
            (f32(0.6) * mx + f32(0.8) * my + f32(DRIFT_B_M_PER_S[0]) * time) * f32(ripples.SIZE / TILE_B_M),
            (f32(0.6) * my - f32(0.8) * mx + f32(DRIFT_B_M_PER_S[1]) * time) * f32(ripples.SIZE / TILE_B_M),
            log2(foot * f32(ripples.SIZE / TILE_B_M)),
        )
        slope_x = f32(AMPLITUDE) * (ax + f32(0.6) * bx - f32(0.8) * by)
        slope_y = f32(AMPLITUDE) * (ay + f32(0.8) * bx + f32(0.6) * by)
        spread = f32(AMPLITUDE * AMPLITUDE) * (a_lost + b_lost) + f32(ROUGHNESS)

        size = f32(1) / np.sqrt(f32(1) + slope_x * slope_x + slope_y * slope_y)
        nx = -slope_x * size
        ny = -slope_y * size
        facing = clamp(-(vx * nx + vy * ny + vz * size), f32(0.01), f32(1))
        graze = f32(1) - facing
        graze2 = graze * graze
        rough = np.sqrt(spread)
        mirror = f32(0.02) + f32(0.98) * graze2 * graze2 * graze / (f32(1) + f32(22.7) * rough * np.sqrt(rough))

        # The bed, where the refracted ray meets it.
        depth = max(bilinear(depth_map, at, columns, rows, px, py), f32(0))
        hx = vx * f32(1 / INDEX) + slope_x * f32(0.25)
        hy = vy * f32(1 / INDEX) + slope_y * f32(0.25)
        down = np.sqrt(max(f32(1) - hx * hx - hy * hy, f32(0.1)))
        path = depth / down
        bed_x = px + hx * path * inv_cell
        bed_y = py + hy * path * inv_cell
        level = clamp(log2(foot * inv_cell), f32(0), f32(table.PAINT_LEVELS - 1.01))
        low = int32(level)
        share = level - f32(low)
        r0, g0, b0, s0 = paint_level(paint, int32(begins[low]), wide, high, bed_x, bed_y, low)
        r1, g1, b1, s1 = paint_level(
            paint, int32(begins[low + int32(1)]), wide, high, bed_x, bed_y, low + int32(1)
        )  # fmt: skip
        r0 += (r1 - r0) * share
        g0 += (g1 - g0) * share
        b0 += (b1 - b0) * share
        sunlit = (s0 + (s1 - s0) * share) * f32(1 / 255.0)
        whole = path + depth * sun_path
        through_r = exp(-f32(ABSORB[0]) * whole)
        through_g = exp(-f32(ABSORB[1]) * whole)
        through_b = exp(-f32(ABSORB[2]) * whole)
        glow = f32(SHADE_GLOW) + f32(1 - SHADE_GLOW) * sunlit
        under_r = r0 * r0 * code * through_r + f32(SCATTER[0]) * glow * (f32(1) - through_r)
        under_g = g0 * g0 * code * through_g + f32(SCATTER[1]) * glow * (f32(1) - through_g)
        under_b = b0 * b0 * code * through_b + f32(SCATTER[2]) * glow * (f32(1) - through_b)

        # What is mirrored: sky, or the canopy that the reflected ray runs into.
        twice = f32(2) * facing
        rx = vx + twice * nx
        ry = vy + twice * ny
        rz = max(vz + twice * size, f32(0.02))
        sky_r, sky_g, sky_b = sky_at(scene.sky, sky_begin, rx, ry, rz)
        cx = px * f32(1 / table.CANOPY_CELL)
        cy = py * f32(1 / table.CANOPY_CELL)
        step = inv_cell * f32(1 / table.CANOPY_CELL)
        s = f32(MIRROR_FIRST_M)
        passing = f32(1)
        wood_r = f32(0)
        wood_g = f32(0)
        wood_b = f32(0)
        met_at = f32(0)
        for _ in range(MIRROR_STEPS):
            qx = int32(clamp(cx + rx * s * step, f32(0), f32(canopy_columns - 1)))
            qy = int32(clamp(cy + ry * s * step, f32(0), f32(canopy_rows - 1)))
            k = uint32(canopy_at + qy * canopy_columns + qx)
            above = scene.canopy[k] - z[i] - rz * s
            part = passing * clamp(above / (f32(MIRROR_BLUR_M) + f32(MIRROR_BLUR) * s), f32(0), f32(1))
            seen = scene.canopy_paint[k]
            a = channel(seen, 0)
            b = channel(seen, 8)
            c = channel(seen, 16)
            wood_r += part * a * a
            wood_g += part * b * b
            wood_b += part * c * c
            met_at += part * s
            passing -= part
            s = s * f32(MIRROR_GROWTH)
        clear = exp(-met_at * f32(table.FOG_PER_M))
        haze = (f32(1) - passing) * (f32(1) - clear)
        up_r = wood_r * code * clear + fog_r * haze + sky_r * passing
        up_g = wood_g * code * clear + fog_g * haze + sky_g * passing
        up_b = wood_b * code * clear + fog_b * haze + sky_b * passing

        # Glitter: how many of the ripples within the pixel mirror the sun.
        half_x = sun_x - vx
        half_y = sun_y - vy
        half_z = sun_z - vz
        lean_x = -half_x / half_z - slope_x
        lean_y = -half_y / half_z - slope_y
        width = spread + f32(SUN_WIDTH)
        density = exp(-(lean_x * lean_x + lean_y * lean_y) / (f32(2) * width)) / (f32(6.2832) * width)
        glitter = min(f32(0.02) * density * sunlit * passing, f32(GLITTER_MOST))

        red[i] = under_r * (f32(1) - mirror) + up_r * mirror + glitter * f32(GLITTER_TINT[0])
        green[i] = under_g * (f32(1) - mirror) + up_g * mirror + glitter * f32(GLITTER_TINT[1])
        blue[i] = under_b * (f32(1) - mirror) + up_b * mirror + glitter * f32(GLITTER_TINT[2])
