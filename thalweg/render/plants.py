"""How are ten thousand plants drawn in a millisecond? As upright pictures that face the camera, from near to far.

Colour is added up front to back with the light that still passes, in blocks of pixels; a block that lets nothing
through any more is closed, and whatever lies behind costs nothing there. A picture comes from the atlas level whose
texels are about as large as pixels.
"""

import numpy as np
from numba import int32, uint32

from thalweg.kernel import kernel
from thalweg.render import impostors
from thalweg.render import scene as table
from thalweg.render.approx import exp, log2
from thalweg.render.fetch import channel, clamp

f32 = np.float32

NEAR_M = 0.6
"""Plants whose axis is nearer than this are not drawn: the camera would be inside them."""
FAR_M = 260.0
BUCKETS = 1024
"""Sorting by distance: buckets spaced as its square root."""
BLOCK = 16
"""Columns of a block. Blocks are BLOCK_ROWS high."""
BLOCK_ROWS = 4
CLOSED = 0.02
"""A block through which less light than this passes everywhere is closed."""


@kernel
def visible_plants(scene, w, ox, oy, oz, fx, fy, fz, rx, ry, ux, uy, uz, half_w, half_h, order, distance):
    """How many plants may be in view; their numbers, near to far, go to order [M]. distance [M] is scratch.

    Origin in world metres; f, r, u: the camera's forward, right and up vectors.
    """
    first = scene.place[w, table.PLANT_FROM]
    last = scene.place[w, table.PLANT_TO]
    plants = scene.plants
    slant_w = np.sqrt(f32(1) + half_w * half_w)
    slant_h = np.sqrt(f32(1) + half_h * half_h)
    count = 0
    found = np.empty(last - first, np.int32)
    heads = np.zeros(BUCKETS + 1, np.int32)
    scale = f32(BUCKETS - 1) / np.sqrt(f32(FAR_M))
    for p in range(first, last):
        px = plants[p, table.P_X] - ox
        py = plants[p, table.P_Y] - oy
        flat = px * px + py * py
        if flat > f32(FAR_M * FAR_M) or flat < f32(NEAR_M * NEAR_M):
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
        far = np.sqrt(flat)
        bucket = int32(np.sqrt(far) * scale)
        distance[p - first] = far
        heads[bucket + 1] += 1
        found[count] = p - first
        count += 1
    for b in range(BUCKETS):
        heads[b + 1] += heads[b]
    for k in range(count):
        p = found[k]
        bucket = int32(np.sqrt(distance[p]) * scale)
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


@kernel(inlined=True)
def draw_plants(scene, w, eye, depth, red, green, blue, light, solid):
    """Add the plants in view to red, green, blue [H, W'] and take from light [H, W'] what they cover.

    depth [H, W'] is the ground's distance along the axis; solid [H, W'] receives that of the plant behind which less
    than half of the light remains. W' is the width rounded up to whole blocks.
    """
    ox, oy, oz, fx, fy, fz, rx, ry, ux, uy, uz, half_w, half_h, per_column, near = eye
    rows = depth.shape[0]
    columns = depth.shape[1]
    first = scene.place[w, table.PLANT_FROM]
    total = scene.place[w, table.PLANT_TO] - first
    plants = scene.plants
    atlas_at = scene.place[w, table.ATLAS_AT]
    sun_x = np.cos(scene.number[w, table.SUN_TURN])
    sun_y = np.sin(scene.number[w, table.SUN_TURN])
    fog_r = scene.number[w, table.FOG_R]
    fog_g = scene.number[w, table.FOG_G]
    fog_b = scene.number[w, table.FOG_B]
    blocks_x = columns // BLOCK
    blocks_y = (rows + BLOCK_ROWS - 1) // BLOCK_ROWS
    opened = np.ones((blocks_y, blocks_x), np.uint8)
    for by in range(blocks_y):
        for bx in range(blocks_x):
            deepest = f32(0)
            for r in range(by * BLOCK_ROWS, min((by + 1) * BLOCK_ROWS, rows)):
                for c in range(bx * BLOCK, (bx + 1) * BLOCK):
                    deepest = max(deepest, depth[r, c])
            opened[by, bx] = 1 if deepest > near else 0

    order = np.empty(total, np.int32)
    distance = np.empty(total, np.float32)
    count = visible_plants(
        scene, w, ox, oy, oz, fx, fy, fz, rx, ry, ux, uy, uz, max(half_w, f32(columns) * per_column - half_w), half_h,
        order, distance,
    )  # fmt: skip
    wide_half_w = f32(columns) * per_column - half_w
    for k in range(count):
        p = first + order[k]
        far = distance[order[k]]
        px = plants[p, table.P_X] - ox
        py = plants[p, table.P_Y] - oy
        foot = plants[p, table.P_Z] - oz
        tall = plants[p, table.P_HEIGHT]
        half = plants[p, table.P_HALF]
        nx = px / far
        ny = py / far
        # Corners of the picture on the screen.
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
        if cut:
            low_x = -half_w
            high_x = wide_half_w
            low_y = -half_h
            high_y = half_h
        c0 = max(int32((low_x + half_w) / per_column), int32(0))
        c1 = min(int32((high_x + half_w) / per_column) + int32(1), int32(columns))
        r0 = max(int32((f32(1) - high_y / half_h) * f32(0.5) * f32(rows)), int32(0))
        r1 = min(int32((f32(1) - low_y / half_h) * f32(0.5) * f32(rows)) + int32(1), int32(rows))
        if c0 >= c1 or r0 >= r1:
            continue

        # Which picture: the side that the sun lights, and the level whose texels are as large as pixels.
        towards = nx * sun_x + ny * sun_y
        across = ny * sun_x - nx * sun_y
        angle = np.arctan2(across, towards)
        view = int32(np.floor(angle * f32(impostors.VIEWS / 6.283185307) + f32(0.5))) & int32(impostors.VIEWS - 1)
        kind = int32(plants[p, table.P_KIND])
        ahead = max(px * fx + py * fy + (foot + tall * f32(0.5)) * fz, near)
        tall_px = tall / (ahead * half_h) * f32(0.5) * f32(rows)
        level = int32(clamp(log2(f32(impostors.ROWS) / tall_px) - f32(0.1), f32(0), f32(impostors.LEVELS - 1)))
        high = int32(impostors.ROWS) >> level
        wide = int32(impostors.COLS) >> level
        begin = int32(atlas_at + scene.atlas_level[level]) + (kind * int32(impostors.VIEWS) + view) * high * wide

        clear = exp(-far * f32(table.FOG_PER_M))
        code = f32(1 / 255.0**2)
        tint_r = plants[p, table.P_R] * clear * code
        tint_g = plants[p, table.P_G] * clear * code
        tint_b = plants[p, table.P_B] * clear * code
        add_r = fog_r * (f32(1) - clear)
        add_g = fog_g * (f32(1) - clear)
        add_b = fog_b * (f32(1) - clear)
        sun_low = plants[p, table.P_LOW]
        sun_rise = plants[p, table.P_HIGH] - sun_low
        shade = scene.place[w, table.SHADE_AT] + kind * int32(impostors.VIEWS) + view
        dark_r = scene.shade[shade, 0]
        dark_g = scene.shade[shade, 1]
        dark_b = scene.shade[shade, 2]

        for by in range(r0 // BLOCK_ROWS, (r1 - 1) // BLOCK_ROWS + 1):
            for bx in range(c0 // BLOCK, (c1 - 1) // BLOCK + 1):
                if opened[by, bx] == 0:
                    continue
                begin_c = bx * BLOCK
                for r in range(max(by * BLOCK_ROWS, r0), min((by + 1) * BLOCK_ROWS, r1)):
                    sy = (f32(1) - f32(2) * (f32(r) + f32(0.5)) / f32(rows)) * half_h
                    base_x = fx + sy * ux
                    base_y = fy + sy * uy
                    base_z = fz + sy * uz
                    for i in range(BLOCK):
                        sx = (f32(begin_c + i) + f32(0.5)) * per_column - half_w
                        dx = base_x + sx * rx
                        dy = base_y + sx * ry
                        towards_plane = dx * nx + dy * ny
                        t = far / max(towards_plane, f32(1e-4))
                        v = (base_z * t - foot) / tall
                        u = (dy * nx - dx * ny) * t / half
                        ground = depth[r, begin_c + i]
                        inside = (
                            (towards_plane > f32(1e-3))
                            & (t > near)
                            & (t < ground)
                            & (v >= f32(0))
                            & (v < f32(1))
                            & (abs(u) < f32(1))
                        )
                        # Column 0 of a picture is on the camera's left, where u = 1.
                        tu = clamp((f32(1) - u) * f32(0.5) * f32(wide) - f32(0.5), f32(0), f32(wide) - f32(1.001))
                        tv = clamp(v * f32(high) - f32(0.5), f32(0), f32(high) - f32(1.001))
                        column = int32(tu)
                        row = int32(tv)
                        a = tu - f32(column)
                        b = tv - f32(row)
                        at = begin + row * wide + column
                        t00 = scene.atlas[uint32(at)]
                        t10 = scene.atlas[uint32(at + 1)]
                        t01 = scene.atlas[uint32(at + wide)]
                        t11 = scene.atlas[uint32(at + wide + 1)]
                        # Colours are weighted by coverage, so that empty texels do not bleed in.
                        w00 = (f32(1) - a) * (f32(1) - b) * channel(t00, 24)
                        w10 = a * (f32(1) - b) * channel(t10, 24)
                        w01 = (f32(1) - a) * b * channel(t01, 24)
                        w11 = a * b * channel(t11, 24)
                        cover = w00 + w10 + w01 + w11
                        share = f32(1) / max(cover, f32(1e-3))
                        cr = share * (
                            channel(t00, 0) * w00
                            + channel(t10, 0) * w10
                            + channel(t01, 0) * w01
                            + channel(t11, 0) * w11
                        )
                        cg = share * (
                            channel(t00, 8) * w00
                            + channel(t10, 8) * w10
                            + channel(t01, 8) * w01
                            + channel(t11, 8) * w11
                        )
                        cb = share * (
                            channel(t00, 16) * w00
                            + channel(t10, 16) * w10
                            + channel(t01, 16) * w01
                            + channel(t11, 16) * w11
                        )
                        sun = clamp(sun_low + sun_rise * v, f32(0), f32(1))
                        passing = light[r, begin_c + i]
                        alpha = cover * f32(1 / 255.0) if inside else f32(0)
                        part = passing * alpha
                        lit_r = tint_r * (dark_r + (f32(1) - dark_r) * sun)
                        lit_g = tint_g * (dark_g + (f32(1) - dark_g) * sun)
                        lit_b = tint_b * (dark_b + (f32(1) - dark_b) * sun)
                        red[r, begin_c + i] += part * (cr * cr * lit_r + add_r)
                        green[r, begin_c + i] += part * (cg * cg * lit_g + add_g)
                        blue[r, begin_c + i] += part * (cb * cb * lit_b + add_b)
                        left = passing - part
                        light[r, begin_c + i] = left
                        crossed = (passing >= f32(0.5)) & (left < f32(0.5))
                        solid[r, begin_c + i] = t if crossed else solid[r, begin_c + i]
                # Ground nearer than this plant hides all that are farther.
                most = f32(0)
                for r in range(by * BLOCK_ROWS, min((by + 1) * BLOCK_ROWS, rows)):
                    for i in range(BLOCK):
                        passing = light[r, begin_c + i]
                        most = max(most, passing if depth[r, begin_c + i] > far * f32(0.9) else f32(0))
                opened[by, bx] = 1 if most > f32(CLOSED) else 0
