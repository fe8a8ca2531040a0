"""What does the upright picture of one plant add to the pixels that it covers?"""

import math

import numpy as np
from numba import int32, uint32, uint64

from thalweg.core.jit import kernel
from thalweg.render.bake import impostors
from thalweg.render.kernels.fast_math import exp, log2
from thalweg.render.kernels.table_lookup import channel, clamp
from thalweg.render.records import scene as table
from thalweg.render.records.appearance import HAZE_PER_M, SEASON

f32 = np.float32

BLOCK = 16
"""Pixels of a row that are drawn together, and closed together."""
SHARPEN = 0.35
"""Levels by which pictures are taken finer than their size asks: the original is as crisp."""
CLOSED = 0.02
"""A block is closed once each of its pixels lets less light through than this, or shows ground before the plant."""
EDGE = math.tan(math.pi / 8)
"""Slope of the line between two of the eight views."""
assert impostors.VIEWS == 8


@kernel(inlined=True)
def side_seen(nx, ny, sun_x, sun_y):
    """The view of the atlas for a look in the horizontal direction nx, ny, with the sun towards sun_x, sun_y.

    See `thalweg.render.bake.impostors.view_of`. Comparisons tell an eighth of a turn, where an arc tangent would take
    longer than all else that a picture needs.
    """
    along = nx * sun_x + ny * sun_y
    aside = ny * sun_x - nx * sun_y
    eighth = int32(1)
    if abs(aside) <= abs(along) * f32(EDGE):
        eighth = int32(0)
    elif abs(along) <= abs(aside) * f32(EDGE):
        eighth = int32(2)
    eighth = int32(4) - eighth if along < f32(0) else eighth
    eighth = -eighth if aside < f32(0) else eighth
    return int32(eighth & int32(impostors.VIEWS - 1))


@kernel(inlined=True)
def picture_of(scene, w, look, p, far, eye, rows, sharpen):
    """What all pixels of plant p's picture share: where it stands, its texels, and how their colour is turned to light.

    far: its horizontal distance in metres; rows: the image's height in pixels; sharpen: levels by which it is taken
    finer than its size asks.
    """
    ox, oy, oz, fx, fy, fz, _, _, _, _, _, _, half_h, _, near = eye
    plant = scene.plants[p]
    nx = (plant[table.P_X] - ox) / far
    ny = (plant[table.P_Y] - oy) / far
    foot = plant[table.P_Z] - oz
    tall = plant[table.P_HEIGHT]
    per_tall = f32(1) / tall
    per_half = f32(1) / plant[table.P_HALF]
    per_row = f32(2) * half_h / f32(rows)

    # Which picture: the side that the sun lights, and the level whose texels are as large as pixels.
    view = side_seen(nx, ny, scene.number[w, table.SUN_EAST], scene.number[w, table.SUN_NORTH])
    kind = int32(plant[table.P_KIND])
    ahead = max(far * (nx * fx + ny * fy) + (foot + tall * f32(0.5)) * fz, near)
    tall_px = tall / (ahead * per_row)
    level = int32(clamp(log2(f32(impostors.ROWS) / tall_px) - sharpen, f32(0), f32(impostors.LEVELS - 1)))
    high = int32(impostors.ROWS) >> level
    wide = int32(impostors.COLS) >> level
    begin = int32(scene.place[w, table.ATLAS_AT] + scene.atlas_level[level])
    begin = int32(begin + (kind * int32(impostors.VIEWS) + view) * high * wide)

    clear = exp(-far * look[HAZE_PER_M])
    season = look[SEASON]
    tint_r = plant[table.P_R] * clear * f32(1 / 255.0**2) * (f32(1) + season * (scene.autumn[kind, 0] - f32(1)))
    tint_g = plant[table.P_G] * clear * f32(1 / 255.0**2) * (f32(1) + season * (scene.autumn[kind, 1] - f32(1)))
    tint_b = plant[table.P_B] * clear * f32(1 / 255.0**2) * (f32(1) + season * (scene.autumn[kind, 2] - f32(1)))
    add_r = scene.number[w, table.FOG_R] * (f32(1) - clear)
    add_g = scene.number[w, table.FOG_G] * (f32(1) - clear)
    add_b = scene.number[w, table.FOG_B] * (f32(1) - clear)
    sun_low = plant[table.P_LOW]
    sun_rise = plant[table.P_HIGH] - sun_low
    shade = scene.place[w, table.SHADE_AT] + kind * int32(impostors.VIEWS) + view
    return (
        (far, nx, ny, foot, per_tall, per_half),
        (begin, wide, high),
        (tint_r, tint_g, tint_b, add_r, add_g, add_b, sun_low, sun_rise),
        (scene.shade[shade, 0], scene.shade[shade, 1], scene.shade[shade, 2]),
    )


@kernel(inlined=True)
def picture_pixel(atlas, picture, dx, dy, dz, near, ground, passing):
    """What a picture sends through one pixel: red, green, blue, the share of `passing` it stops, and its depth.

    dx, dy, dz: the ray in metres per metre along the axis; ground: depth of what lies behind; passing: the light that
    nearer plants let through.
    """
    (far, nx, ny, foot, per_tall, per_half), (begin, wide, high), paint, (dark_r, dark_g, dark_b) = picture
    tint_r, tint_g, tint_b, add_r, add_g, add_b, sun_low, sun_rise = paint
    towards = dx * nx + dy * ny
    t = far / max(towards, f32(1e-4))
    v = (dz * t - foot) * per_tall
    u = (dy * nx - dx * ny) * t * per_half
    inside = (towards > f32(1e-3)) & (t > near) & (t < ground)
    inside = inside & (v >= f32(0)) & (v < f32(1)) & (abs(u) < f32(1))
    # Column 0 of a picture is on the camera's left, where u = 1.
    tu = clamp((f32(1) - u) * f32(0.5) * f32(wide) - f32(0.5), f32(0), f32(wide) - f32(1.001))
    tv = clamp(v * f32(high) - f32(0.5), f32(0), f32(high) - f32(1.001))
    column = int32(tu)
    row = int32(tv)
    a = tu - f32(column)
    b = tv - f32(row)
    at = begin + row * wide + column
    t00 = atlas[uint32(at)]
    t10 = atlas[uint32(at + 1)]
    t01 = atlas[uint32(at + wide)]
    t11 = atlas[uint32(at + wide + 1)]
    # Colours are weighted by coverage, so that empty texels do not bleed in.
    w00 = (f32(1) - a) * (f32(1) - b) * channel(t00, 24)
    w10 = a * (f32(1) - b) * channel(t10, 24)
    w01 = (f32(1) - a) * b * channel(t01, 24)
    w11 = a * b * channel(t11, 24)
    cover = w00 + w10 + w01 + w11
    share = f32(1) / max(cover, f32(1e-3))
    cr = channel(t00, 0) * w00 + channel(t10, 0) * w10 + channel(t01, 0) * w01 + channel(t11, 0) * w11
    cg = channel(t00, 8) * w00 + channel(t10, 8) * w10 + channel(t01, 8) * w01 + channel(t11, 8) * w11
    cb = channel(t00, 16) * w00 + channel(t10, 16) * w10 + channel(t01, 16) * w01 + channel(t11, 16) * w11
    cr *= share
    cg *= share
    cb *= share
    sun = clamp(sun_low + sun_rise * v, f32(0), f32(1))
    part = passing * cover * f32(1 / 255.0) if inside else f32(0)
    red = part * (cr * cr * tint_r * (dark_r + (f32(1) - dark_r) * sun) + add_r)
    green = part * (cg * cg * tint_g * (dark_g + (f32(1) - dark_g) * sun) + add_g)
    blue = part * (cb * cb * tint_b * (dark_b + (f32(1) - dark_b) * sun) + add_b)
    return red, green, blue, part, t


@kernel(inlined=True)
def nearest_ray(far, eye):
    """Lower bound of the depth at which any ray meets a picture at a horizontal distance: the upper corners' rays."""
    _, _, _, fx, fy, _, _, _, ux, uy, _, half_w, half_h, _, _ = eye
    spread = math.sqrt(fx * fx + fy * fy) + half_h * math.sqrt(ux * ux + uy * uy)
    return far / math.sqrt(spread * spread + half_w * half_w)


@kernel(disjoint=True)
def draw_picture(atlas, picture, nearest, eye, box, height, top, deepest, planes):
    """Draw a picture, from `picture_of`, into the blocks of its box that are not closed.

    nearest: see `nearest_ray`; box: the columns from, to and rows from, to; rows are those from `top` on of an image of
    `height` rows. deepest [R, W' / BLOCK]: the greatest depth of a block's pixels, 0 once it is closed; planes: flat
    views [R * W'] of depth, red, green, blue, light, solid, as in `plants.draw_plants`.
    """
    _, _, _, fx, fy, fz, rx, ry, ux, uy, uz, half_w, half_h, per_column, near = eye
    depth, red, green, blue, light, solid = planes
    c0, c1, r0, r1 = box
    columns = deepest.shape[1] * BLOCK
    per_row = f32(2) * half_h / f32(height)
    for r in range(r0, r1):
        sy = half_h - (f32(top + r) + f32(0.5)) * per_row
        base_x = fx + sy * ux
        base_y = fy + sy * uy
        base_z = fz + sy * uz
        for bx in range(c0 // BLOCK, (c1 - 1) // BLOCK + 1):
            if deepest[r, bx] < nearest:
                continue
            first = uint64(r * columns + bx * BLOCK)
            left = (f32(bx * BLOCK) + f32(0.5)) * per_column - half_w
            still = f32(0)
            for i in range(BLOCK):
                k = first + uint64(i)
                sx = left + f32(i) * per_column
                passing = light[k]
                add_r, add_g, add_b, part, t = picture_pixel(
                    atlas, picture, base_x + sx * rx, base_y + sx * ry, base_z, near, depth[k], passing
                )
                red[k] += add_r
                green[k] += add_g
                blue[k] += add_b
                rest = passing - part
                light[k] = rest
                crossed = (passing >= f32(0.5)) & (rest < f32(0.5))
                solid[k] = t if crossed else solid[k]
                # Later plants are no nearer: ground before this one hides them too.
                still += max(rest - f32(CLOSED), f32(0)) if depth[k] > nearest else f32(0)
            deepest[r, bx] = deepest[r, bx] if still > f32(0) else f32(0)
