"""How does one frame come about? March, bridges, plants, shading, exposure, in this order, for one pose in one world.

A frame depends on nothing but its world, pose, time and camera: no state is kept from one to the next, so that the
batch, its order and the number of threads change no bit.
"""

import math

import numpy as np
from numba import int32, uint32

from thalweg.core.jit import kernel
from thalweg.render.kernels import bridge_edges as outlines
from thalweg.render.kernels import bridges, plants
from thalweg.render.kernels import heightfield_march as march
from thalweg.render.kernels.billboard import BLOCK
from thalweg.render.kernels.camera_rays import aim, reach
from thalweg.render.kernels.fast_math import exp
from thalweg.render.kernels.primary_hits import MISS, survey
from thalweg.render.kernels.shading import ground, water
from thalweg.render.kernels.shading import reduced_quality as modest
from thalweg.render.kernels.shading.tone import develop, scramble
from thalweg.render.kernels.table_lookup import sky_at
from thalweg.render.records import scene as table
from thalweg.render.records.appearance import HAZE_PER_M
from thalweg.render.records.classes import BRIDGE, GROUND, PLANT, SKY, WATER

f32 = np.float32

SEEN = 0.004
"""What plants cover to more than all but this is not shaded."""
SPAN_ROWS = 10
"""Arrays of scratch that the shading needs."""
ROWS_TOGETHER = march.TILE
"""Bands of rows begin at multiples of this, the height of a tile of rays; rows drawn by twos divide it."""


@kernel
def open_planes(height, width):
    """Empty buffers of a frame: depth, kind, red, green, blue, light, solid, each [H', W'].

    W' is the width rounded up to whole blocks of plants, H' the height rounded up to an even number of rows.
    """
    height += height % 2
    wide = (width + BLOCK - 1) // BLOCK * BLOCK
    return (
        np.empty((height, wide), np.float32),
        np.empty((height, wide), np.uint8),
        np.zeros((height, wide), np.float32),
        np.zeros((height, wide), np.float32),
        np.zeros((height, wide), np.float32),
        np.ones((height, wide), np.float32),
        np.full((height, wide), f32(MISS), np.float32),
    )


@kernel
def draw_rows(scene, w, look, eye, time, camera, top, bottom, planes):
    """Draw the rows from top to bottom into the buffers of their frame; top is a multiple of `ROWS_TOGETHER`.

    What a row shows depends on no other rows than those of its tile.
    """
    height, width, _, fast = camera
    # The modest quality draws rows by twos; the one beyond an odd height is never shown.
    bottom += bottom % 2
    depth = planes[0][top:bottom]
    kind = planes[1][top:bottom]
    red = planes[2][top:bottom]
    green = planes[3][top:bottom]
    blue = planes[4][top:bottom]
    light = planes[5][top:bottom]
    survey(scene, w, eye, height, top, fast, depth, kind)
    stone = draw_bridges(scene, w, look, eye, height, width, top, depth, kind)
    plants.draw_plants(scene, w, look, eye, height, top, fast, depth, red, green, blue, light, planes[6][top:bottom])
    shade(scene, w, look, eye, time, height, width, top, fast, depth, kind, light, red, green, blue)
    for k in range(len(stone)):
        r = int32(stone[k, 0])
        c = int32(stone[k, 1])
        # Of several bridges behind one pixel only the nearest is seen.
        if kind[r, c] == BRIDGE and stone[k, 5] == depth[r, c]:
            red[r, c] += light[r, c] * stone[k, 2]
            green[r, c] += light[r, c] * stone[k, 3]
            blue[r, c] += light[r, c] * stone[k, 4]


@kernel
def finish_frame(scene, w, look, eye, time, camera, planes, image, want_layers, depth_out, class_out):
    """Turn the drawn buffers of a frame into image [H, W] uint32, and into layers where wanted."""
    height, width, _, fast = camera
    depth, kind, red, green, blue, light, solid = planes
    if not fast:
        # Without the row by which an odd height is rounded up: rays are aimed by the number of rows.
        outlines.soften_edges(
            scene, w, look, eye, width, depth[:height], kind[:height], light[:height],
            red[:height], green[:height], blue[:height],
        )  # fmt: skip
    if want_layers:
        write_layers(depth, solid, kind, light, depth_out, class_out)
    mask_water(kind, light)
    develop(red, green, blue, kind, look, noise_key(eye, time), image, width)


@kernel(inlined=True)
def noise_key(eye, time):
    """What the sensor's noise depends on: place and time, to the bit."""
    key = scramble(uint32(np.float32(eye[0]).view(np.int32)))
    key = scramble(uint32(key ^ uint32(np.float32(eye[1]).view(np.int32))))
    return scramble(uint32(key ^ uint32(np.float32(time).view(np.int32))))


@kernel
def draw_bridges(scene, w, look, eye, height, width, top, depth, kind):
    """Set depth and kind where a bridge is nearest; the stone met [K, 6]: row, column, red, green, blue, depth."""
    ox, oy, oz, fx, fy, fz, rx, ry, ux, uy, uz, half_w, half_h, per_column, near = eye
    per_row = f32(2) * half_h / f32(height)
    room = 0
    boxes = np.empty((scene.place[w, table.BRIDGE_TO] - scene.place[w, table.BRIDGE_FROM], 4), np.int32)
    for b in range(len(boxes)):
        row = scene.bridges[scene.place[w, table.BRIDGE_FROM] + b]
        boxes[b] = bridges.bridge_box(row, eye, height, width)
        boxes[b, 2] = max(boxes[b, 2] - top, 0)
        boxes[b, 3] = min(boxes[b, 3] - top, len(depth))
        room += max(boxes[b, 1] - boxes[b, 0], 0) * max(boxes[b, 3] - boxes[b, 2], 0)
    stone = np.empty((room, 6), np.float32)
    n = 0
    for b in range(len(boxes)):
        row = scene.bridges[scene.place[w, table.BRIDGE_FROM] + b]
        for r in range(boxes[b, 2], boxes[b, 3]):
            sy = half_h - (f32(top + r) + f32(0.5)) * per_row
            for c in range(boxes[b, 0], boxes[b, 1]):
                sx = (f32(c) + f32(0.5)) * per_column - half_w
                dx = fx + sy * ux + sx * rx
                dy = fy + sy * uy + sx * ry
                dz = fz + sy * uz
                found = bridges.meet_bridge(row, ox, oy, oz, dx, dy, dz, near, min(depth[r, c], f32(bridges.FAR_M)))
                if found[0] > f32(0):
                    depth[r, c] = found[0]
                    kind[r, c] = np.uint8(BRIDGE)
                    slant = math.sqrt(f32(1) + sx * sx + sy * sy)
                    stone[n, 0] = f32(r)
                    stone[n, 1] = f32(c)
                    stone[n, 2], stone[n, 3], stone[n, 4] = bridges.shade_stone(
                        scene, w, look, row, found, found[0] * slant, found[0] * per_row, dz / slant
                    )
                    stone[n, 5] = found[0]
                    n += 1
    return stone[:n]


@kernel(disjoint=True)
def shade(scene, w, look, eye, time, height, width, top, fast, depth, kind, light, red, green, blue):
    """Add what sky, water and ground send through the plants to red, green, blue [R, W']."""
    rows, wide = depth.shape
    inv_cell = scene.number[w, table.INV_CELL]
    node_x = (eye[0] - scene.number[w, table.ORIGIN_X]) * inv_cell
    node_y = (eye[1] - scene.number[w, table.ORIGIN_Y]) * inv_cell
    pixel = f32(2) * eye[12] / f32(height)
    sky_begin = int32(scene.place[w, table.SKY_AT])
    span = np.empty((SPAN_ROWS, wide), np.float32)
    work_rows = np.empty((water.WORK, wide), np.float32)
    work = (
        work_rows[0], work_rows[1], work_rows[2], work_rows[3], work_rows[4], work_rows[5],
        work_rows[6], work_rows[7], work_rows[8], work_rows[9], work_rows[10],
    )  # fmt: skip
    at = np.empty(wide, np.int32)
    ray_x = np.empty(wide, np.float32)
    ray_y = np.empty(wide, np.float32)
    ray_z = np.empty(wide, np.float32)
    x = span[0]
    y = span[1]
    z = span[2]
    dx = span[3]
    dy = span[4]
    dz = span[5]
    far = span[6]
    out_r = span[7]
    out_g = span[8]
    out_b = span[9]
    for r in range(rows):
        aim(eye, height, top + r, 0, inv_cell, ray_x, ray_y, ray_z, wide)
        for what in range(3):
            n = 0
            for c in range(width):
                if kind[r, c] == what and light[r, c] > f32(SEEN):
                    at[n] = c
                    n += 1
            if n == 0:
                continue
            reach(node_x, node_y, eye[2], inv_cell, ray_x, ray_y, ray_z, depth[r], at, x, y, z, dx, dy, dz, far, n)
            if what == SKY and fast:
                modest.shade_sky(scene.sky, sky_begin, dx, dy, dz, out_r, out_g, out_b, n)
            elif what == WATER and fast:
                modest.shade_water(
                    scene, w, look, x, y, dx, dy, dz, far, pixel, time, out_r, out_g, out_b, n
                )  # fmt: skip
            elif what == GROUND and fast:
                modest.shade_ground(scene, w, x, y, dz, far, pixel, out_r, out_g, out_b, n)
            elif what == SKY:
                shade_sky(scene.sky, sky_begin, dx, dy, dz, out_r, out_g, out_b, n)
            elif what == WATER:
                water.shade_water(
                    scene, w, look, x, y, z, dx, dy, dz, far, pixel, time, work, out_r, out_g, out_b, n
                )  # fmt: skip
            else:
                ground.shade_ground(scene, w, x, y, dz, far, pixel, out_r, out_g, out_b, n)
            if what != SKY:
                haze(scene, w, look, far, out_r, out_g, out_b, n)
            for k in range(n):
                c = at[k]
                red[r, c] += light[r, c] * out_r[k]
                green[r, c] += light[r, c] * out_g[k]
                blue[r, c] += light[r, c] * out_b[k]


@kernel(disjoint=True)
def shade_sky(table_, begin, dx, dy, dz, red, green, blue, n):
    """Radiance [n] of the sky."""
    for k in range(n):
        r, g, b = sky_at(table_, begin, dx[k], dy[k], dz[k])
        red[k] = r
        green[k] = g
        blue[k] = b


@kernel(disjoint=True)
def haze(scene, w, look, far, red, green, blue, n):
    """Fade radiance [n] into the haze over `far` metres."""
    fog_r = scene.number[w, table.FOG_R]
    fog_g = scene.number[w, table.FOG_G]
    fog_b = scene.number[w, table.FOG_B]
    for k in range(n):
        clear = exp(-far[k] * look[HAZE_PER_M])
        red[k] = red[k] * clear + fog_r * (f32(1) - clear)
        green[k] = green[k] * clear + fog_g * (f32(1) - clear)
        blue[k] = blue[k] * clear + fog_b * (f32(1) - clear)


@kernel(disjoint=True)
def write_layers(depth, solid, kind, light, depth_out, class_out):
    """Depth along the axis (-1: sky) and class of each pixel [H, W], from planes [H', W']."""
    height, width = depth_out.shape
    for r in range(height):
        for c in range(width):
            seen = min(depth[r, c], solid[r, c])
            depth_out[r, c] = f32(-1) if seen >= f32(MISS) else seen
            class_out[r, c] = kind[r, c] if light[r, c] > f32(0.5) else np.uint8(PLANT)


@kernel(disjoint=True)
def mask_water(kind, light):
    """Turn kind [H', W'] into the mask: 255 where water is seen, else 0."""
    for r in range(kind.shape[0]):
        for c in range(kind.shape[1]):
            wet = (kind[r, c] == np.uint8(WATER)) & (light[r, c] > f32(0.5))
            kind[r, c] = np.uint8(255) if wet else np.uint8(0)
