"""How are ten thousand plants drawn in a millisecond? As upright pictures that face the camera, from near to far.

Colour is added up front to back with the light that still passes, in blocks of pixels; a block that lets nothing
through any more is closed, and whatever lies behind costs nothing there. A picture comes from the atlas level whose
texels are about as large as pixels.
"""

import math

import numpy as np
from numba import int32, uint32, uint64

from thalweg.kernel import kernel
from thalweg.render import fast as modest
from thalweg.render import impostors
from thalweg.render import scene as table
from thalweg.render.approx import exp, floor, log2
from thalweg.render.fetch import channel, clamp
from thalweg.render.look import DENSITY, HAZE_PER_M, SEASON

f32 = np.float32

NEAR_M = 0.6
"""Plants whose axis is nearer than this are not drawn: the camera would be inside them."""
FAR_M = 260.0
BUCKETS = 1024
"""Sorting by distance: buckets spaced as its square root."""
BLOCK = 16
"""Columns of a block. Blocks are BLOCK_ROWS high."""
BLOCK_ROWS = 4
SHARPEN = 0.35
"""Levels by which pictures are taken finer than their size asks: the original is as crisp."""
CLOSED = 0.02
"""A block through which less light than this passes everywhere is closed."""


@kernel(inlined=True)
def bucket_of(far):
    return int32(clamp(math.sqrt(far) * f32((BUCKETS - 1) / math.sqrt(FAR_M)), f32(0), f32(BUCKETS - 1)))


@kernel
def visible_plants(scene, w, density, ox, oy, oz, fx, fy, fz, rx, ry, ux, uy, uz, half_w, half_h, order, distance):
    """How many plants may be in view; their numbers, near to far, go to order [M]. distance [M] is scratch.

    density: the share of plants that there are. Origin in world metres; f, r, u: the camera's forward, right and up
    vectors.
    """
    first = scene.place[w, table.PLANT_FROM]
    last = scene.place[w, table.PLANT_TO]
    plants = scene.plants
    slant_w = math.sqrt(f32(1) + half_w * half_w)
    slant_h = math.sqrt(f32(1) + half_h * half_h)
    count = 0
    found = np.empty(last - first, np.int32)
    heads = np.zeros(BUCKETS + 1, np.int32)
    for p in range(first, last):
        px = plants[p, table.P_X] - ox
        py = plants[p, table.P_Y] - oy
        flat = px * px + py * py
        if flat > f32(FAR_M * FAR_M) or flat < f32(NEAR_M * NEAR_M) or plants[p, table.P_RANK] >= density:
            continue
        half_tall = plants[p, table.P_HEIGHT] * f32(0.5)
        pz = plants[p, table.P_Z] + half_tall - oz
        # A sphere around the plant against the five planes of the view.
        radius = half_tall + plants[p, table.P_HALF]
        ahead = px * fx + py * fy + pz * fz
        aside = abs(px * rx + py * ry)
        above = abs(px * ux + py * uy + pz * uz)
        if ahead < -radius or aside > ahead * half_w + radius * slant_w or above > ahead * half_h + radius * slant_h:
            continue
        far = math.sqrt(flat)
        bucket = bucket_of(far)
        distance[p - first] = far
        heads[bucket + 1] += 1
        found[count] = p - first
        count += 1
    for b in range(BUCKETS):
        heads[b + 1] += heads[b]
    for k in range(count):
        p = found[k]
        bucket = bucket_of(distance[p])
        order[heads[bucket]] = p
        heads[bucket] += 1
    # Within a bucket plants are nearly in order already; insertion finishes the sort.
    for k in range(1, count):
        p = order[k]
        far = distance[p]
        j = k - 1
        while j >= 0 and distance[order[j]] > far:
            order[j + 1] = order[j]
            j -= 1
        order[j + 1] = p
    return count


@kernel(disjoint=True)
def draw_plants(scene, w, look, eye, height, top, fast, depth, red, green, blue, light, solid):
    """Add the plants in view to red, green, blue [R, W'] and take from light [R, W'] what they cover.

    Rows are those from `top` on of an image of `height` rows. depth [R, W'] is the ground's distance along the axis;
    solid [R, W'] receives that of the plant behind which less than half of the light remains. W' is the width rounded
    up to whole blocks. fast: whether the quality is the modest one.
    """
    ox, oy, oz, fx, fy, fz, rx, ry, ux, uy, uz, half_w, half_h, per_column, _ = eye
    rows = depth.shape[0]
    columns = depth.shape[1]
    first = scene.place[w, table.PLANT_FROM]
    total = scene.place[w, table.PLANT_TO] - first
    blocks_x = columns // BLOCK
    blocks_y = (rows + BLOCK_ROWS - 1) // BLOCK_ROWS
    deepest = np.empty((blocks_y, blocks_x), np.float32)
    deepest_ground(depth, deepest)

    order = np.empty(total, np.int32)
    distance = np.empty(total, np.float32)
    wide_half_w = f32(columns) * per_column - half_w
    count = visible_plants(
        scene, w, look[DENSITY], ox, oy, oz, fx, fy, fz, rx, ry, ux, uy, uz, max(half_w, wide_half_w), half_h,
        order, distance,
    )  # fmt: skip
    planes = (depth.ravel(), red.ravel(), green.ravel(), blue.ravel(), light.ravel(), solid.ravel())
    for k in range(count):
        p = first + order[k]
        far = distance[order[k]]
        c0, c1, r0, r1 = picture_box(scene.plants[p], far, eye, height, columns)
        r0 = max(r0 - int32(top), int32(0))
        r1 = min(r1 - int32(top), int32(rows))
        if c0 < c1 and r0 < r1:
            draw_picture(scene, w, look, p, far, eye, (c0, c1, r0, r1), height, top, fast, deepest, *planes)


@kernel(disjoint=True)
def deepest_ground(depth, deepest):
    """The greatest depth [rows, columns] within each block, into deepest [blocks_y, blocks_x]."""
    rows = depth.shape[0]
    most = np.empty(BLOCK, np.float32)
    for by in range(deepest.shape[0]):
        for bx in range(deepest.shape[1]):
            for i in range(BLOCK):
                most[i] = f32(0)
            for r in range(by * BLOCK_ROWS, min((by + 1) * BLOCK_ROWS, rows)):
                first = uint64(bx * BLOCK)
                for i in range(BLOCK):
                    most[i] = max(most[i], depth[r, first + uint64(i)])
            deepest[by, bx] = most.max()


@kernel(inlined=True)
def picture_box(plant, far, eye, rows, columns):
    """The columns from, to and rows from, to of the screen that the upright picture of a plant may touch."""
    ox, oy, oz, fx, fy, fz, rx, ry, ux, uy, uz, half_w, half_h, per_column, near = eye
    px = plant[table.P_X] - ox
    py = plant[table.P_Y] - oy
    foot = plant[table.P_Z] - oz
    tall = plant[table.P_HEIGHT]
    half = plant[table.P_HALF]
    nx = px / far
    ny = py / far
    low_x = f32(1e9)
    high_x = f32(-1e9)
    low_y = f32(1e9)
    high_y = f32(-1e9)
    cut = False
    for corner in range(4):
        side = half if corner & 1 else -half
        cz = foot + tall if corner & 2 else foot
        cx = px - ny * side
        cy = py + nx * side
        ahead = cx * fx + cy * fy + cz * fz
        cut |= ahead < near
        ahead = max(ahead, f32(0.05))
        sx = (cx * rx + cy * ry) / ahead
        sy = (cx * ux + cy * uy + cz * uz) / ahead
        low_x = min(low_x, sx)
        high_x = max(high_x, sx)
        low_y = min(low_y, sy)
        high_y = max(high_y, sy)
    per_row = f32(2) * half_h / f32(rows)
    c0 = int32(0)
    c1 = int32(columns)
    r0 = int32(0)
    r1 = int32(rows)
    if not cut:
        c0 = max(int32((low_x + half_w) / per_column), c0)
        c1 = min(int32((high_x + half_w) / per_column) + int32(1), c1)
        r0 = max(int32((half_h - high_y) / per_row), r0)
        r1 = min(int32((half_h - low_y) / per_row) + int32(1), r1)
    return c0, c1, r0, r1


@kernel(inlined=True)
def side_seen(nx, ny, sun_turn):
    """The view of the atlas for a look in the horizontal direction nx, ny; see `thalweg.render.impostors.view_of`."""
    cos = math.cos(sun_turn)
    sin = math.sin(sun_turn)
    angle = math.atan2(ny * cos - nx * sin, nx * cos + ny * sin)
    return int32(floor(angle * f32(impostors.VIEWS / 6.283185307) + f32(0.5))) & int32(impostors.VIEWS - 1)


@kernel(inlined=True)
def picture_of(scene, w, look, p, far, eye, rows):
    """What all pixels of plant p's picture share: where it stands, its texels, and how their colour is turned to light.

    far: its horizontal distance in metres; rows: the image's height in pixels.
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
    view = side_seen(nx, ny, scene.number[w, table.SUN_TURN])
    kind = int32(plant[table.P_KIND])
    ahead = max(far * (nx * fx + ny * fy) + (foot + tall * f32(0.5)) * fz, near)
    tall_px = tall / (ahead * per_row)
    level = int32(clamp(log2(f32(impostors.ROWS) / tall_px) - f32(SHARPEN), f32(0), f32(impostors.LEVELS - 1)))
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
def draw_picture(scene, w, look, p, far, eye, box, height, top, fast, deepest, depth, red, green, blue, light, solid):
    """Draw plant p at a horizontal distance `far` into the blocks that its box touches and that are not closed.

    The planes depth, red, green, blue, light, solid are flat, [R * W'], as in `draw_plants`.
    """
    _, _, _, fx, fy, fz, rx, ry, ux, uy, uz, half_w, half_h, per_column, near = eye
    c0, c1, r0, r1 = box
    columns = deepest.shape[1] * BLOCK
    rows = len(depth) // columns
    per_row = f32(2) * half_h / f32(height)
    picture = picture_of(scene, w, look, p, far, eye, height)
    nearest = nearest_ray(far, eye)
    closed = f32(modest.CLOSED) if fast else f32(CLOSED)
    atlas = scene.atlas
    for by in range(r0 // BLOCK_ROWS, (r1 - 1) // BLOCK_ROWS + 1):
        for bx in range(c0 // BLOCK, (c1 - 1) // BLOCK + 1):
            # Every pixel of the block is covered, or shows ground nearer than this plant can be.
            if deepest[by, bx] < nearest:
                continue
            for r in range(max(by * BLOCK_ROWS, r0), min((by + 1) * BLOCK_ROWS, r1)):
                sy = half_h - (f32(top + r) + f32(0.5)) * per_row
                base_x = fx + sy * ux
                base_y = fy + sy * uy
                base_z = fz + sy * uz
                first = uint64(r * columns + bx * BLOCK)
                left = (f32(bx * BLOCK) + f32(0.5)) * per_column - half_w
                # Two loops, since a choice within one would keep LLVM from vectorising it.
                if fast:
                    for i in range(BLOCK):
                        k = first + uint64(i)
                        sx = left + f32(i) * per_column
                        passing = light[k]
                        add_r, add_g, add_b, part, t = modest.picture_pixel(
                            atlas, picture, base_x + sx * rx, base_y + sx * ry, base_z, near, depth[k], passing
                        )
                        red[k] += add_r
                        green[k] += add_g
                        blue[k] += add_b
                        light[k] = passing - part
                        crossed = (passing >= f32(0.5)) & (passing - part < f32(0.5))
                        solid[k] = t if crossed else solid[k]
                else:
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
                        light[k] = passing - part
                        crossed = (passing >= f32(0.5)) & (passing - part < f32(0.5))
                        solid[k] = t if crossed else solid[k]
            open_pixels = f32(0)
            for r in range(by * BLOCK_ROWS, min((by + 1) * BLOCK_ROWS, rows)):
                first = uint64(r * columns + bx * BLOCK)
                for i in range(BLOCK):
                    open_pixels += f32(1) if light[first + uint64(i)] > closed else f32(0)
            deepest[by, bx] = deepest[by, bx] if open_pixels > f32(0) else f32(0)
