"""A frame as a GPU draws it: one thread a pixel, from the same functions as the CPU's spans, with spans of one.

The CPU places the camera, picks the plants in view and takes the mean for the exposure; all else happens per pixel.
"""

import numpy as np
from numba import cuda, float32, int32, uint32

from thalweg.render import bridges, classes, frame, ground, march, outlines, tone, water
from thalweg.render import fast as modest
from thalweg.render import scene as table
from thalweg.render.eye import aim, aim_squares, reach
from thalweg.render.picture import SHARPEN, picture_of, picture_pixel
from thalweg.render.survey import MISS

f32 = np.float32


def trace(scene, w, camera, time, look, fast, order, distance, radiance, depth_out, kind_out, light_out):
    """The light [H, W, 3] that reaches each pixel before exposure, what is seen there, and what plants let through.

    camera: the 15 numbers of `eye.open_eye` [15]; fast: whether the quality is the modest one; order, distance
    [K]: the plants in view from near to far.
    """
    c, r = cuda.grid(2)
    height, width = kind_out.shape
    if r >= height or c >= width:
        return
    eye = (
        camera[0], camera[1], camera[2], camera[3], camera[4], camera[5], camera[6], camera[7],
        camera[8], camera[9], camera[10], camera[11], camera[12], camera[13], camera[14],
    )  # fmt: skip
    near = eye[14]
    inv_cell = scene.number[w, table.INV_CELL]
    node_x = (eye[0] - scene.number[w, table.ORIGIN_X]) * inv_cell
    node_y = (eye[1] - scene.number[w, table.ORIGIN_Y]) * inv_cell

    ray_x = cuda.local.array(1, float32)
    ray_y = cuda.local.array(1, float32)
    ray_z = cuda.local.array(1, float32)
    aim(eye, height, r, c, inv_cell, ray_x, ray_y, ray_z, 1)
    tile_x = cuda.local.array(1, float32)
    tile_y = cuda.local.array(1, float32)
    tile_z = cuda.local.array(1, float32)
    depth = cuda.local.array(1, float32)
    hit = cuda.local.array(1, float32)
    a0 = cuda.local.array(1, float32)
    a1 = cuda.local.array(1, float32)
    a2 = cuda.local.array(1, float32)
    a3 = cuda.local.array(1, float32)
    a4 = cuda.local.array(1, float32)
    # All rays of a tile start where the bundle of the tile gets to.
    row = r // march.TILE * march.TILE
    aim_squares(eye, height, row, march.TILE, inv_cell, tile_x, tile_y, tile_z, c // march.TILE, 1)
    depth[0] = near
    march.approach(scene, w, node_x, node_y, eye[2], march.bundle_spread(eye, height), tile_x, tile_y, tile_z, depth, 1)
    if fast:
        tilt_x = cuda.local.array(1, float32)
        tilt_y = cuda.local.array(1, float32)
        gap = cuda.local.array(1, float32)
        met = cuda.local.array(1, float32)
        met[0] = depth[0]
        row = r // march.SQUARE * march.SQUARE
        aim_squares(eye, height, row, march.SQUARE, inv_cell, tile_x, tile_y, tile_z, c // march.SQUARE, 1)
        march.march(scene, w, node_x, node_y, eye[2], tile_x, tile_y, tile_z, met, hit, (a0, a1, a2, a3, a4), 1)
        march.touch(scene, w, node_x, node_y, eye[2], tile_x, tile_y, met, tilt_x, tilt_y, gap, 1)
        march.settle(tilt_x, tilt_y, gap, met, ray_x, ray_y, ray_z, depth, 1)
    else:
        march.march(scene, w, node_x, node_y, eye[2], ray_x, ray_y, ray_z, depth, hit, (a0, a1, a2, a3, a4), 1)
    wet = cuda.local.array(1, float32)
    march.wetness(scene, w, node_x, node_y, ray_x, ray_y, depth, wet, 1)
    kind = classes.SKY
    if hit[0] > f32(0):
        kind = classes.WATER if wet[0] > f32(0) else classes.GROUND
    else:
        depth[0] = f32(MISS)

    cell = f32(1) / inv_cell
    dx = ray_x[0] * cell
    dy = ray_y[0] * cell
    dz = ray_z[0]
    slant = f32((dx * dx + dy * dy + dz * dz) ** f32(0.5))
    per_row = f32(2) * eye[12] / f32(height)
    stone_r = f32(0)
    stone_g = f32(0)
    stone_b = f32(0)
    for b in range(scene.place[w, table.BRIDGE_FROM], scene.place[w, table.BRIDGE_TO]):
        row = scene.bridges[b]
        limit = min(depth[0], f32(bridges.FAR_M))
        found = bridges.meet_bridge(row, eye[0], eye[1], eye[2], dx, dy, dz, near, limit)
        if found[0] > f32(0):
            depth[0] = found[0]
            kind = classes.BRIDGE
            stone_r, stone_g, stone_b = bridges.shade_stone(
                scene, w, look, row, found, found[0] * slant, found[0] * per_row, dz / slant
            )

    red = f32(0)
    green = f32(0)
    blue = f32(0)
    light = f32(1)
    # The ray through the middle of the two rows that share their texels.
    off = (f32(r % modest.ROWS) - f32(0.5 * modest.ROWS - 0.5)) * per_row
    mid_x = dx + off * eye[8]
    mid_y = dy + off * eye[9]
    mid_z = dz + off * eye[10]
    for k in range(len(order)):
        p = scene.place[w, table.PLANT_FROM] + order[k]
        far_k = distance[order[k]]
        if fast:
            picture = picture_of(scene, w, look, p, far_k, eye, height, f32(modest.SHARPEN))
            ink_r, ink_g, ink_b, ink, t = modest.picture_pixel(scene.atlas, picture, mid_x, mid_y, mid_z, near)
            part = light * ink if t < depth[0] else f32(0)
            red += part * ink_r
            green += part * ink_g
            blue += part * ink_b
            light -= part
        else:
            picture = picture_of(scene, w, look, p, far_k, eye, height, f32(SHARPEN))
            add_r, add_g, add_b, part, _ = picture_pixel(scene.atlas, picture, dx, dy, dz, near, depth[0], light)
            red += add_r
            green += add_g
            blue += add_b
            light -= part

    if light > f32(frame.SEEN):
        at = cuda.local.array(1, int32)
        x = cuda.local.array(1, float32)
        y = cuda.local.array(1, float32)
        z = cuda.local.array(1, float32)
        ux = cuda.local.array(1, float32)
        uy = cuda.local.array(1, float32)
        uz = cuda.local.array(1, float32)
        far = cuda.local.array(1, float32)
        out_r = cuda.local.array(1, float32)
        out_g = cuda.local.array(1, float32)
        out_b = cuda.local.array(1, float32)
        at[0] = 0
        reach(node_x, node_y, eye[2], inv_cell, ray_x, ray_y, ray_z, depth, at, x, y, z, ux, uy, uz, far, 1)
        sky_begin = int32(scene.place[w, table.SKY_AT])
        if kind == classes.SKY and fast:
            modest.shade_sky(scene.sky, sky_begin, ux, uy, uz, out_r, out_g, out_b, 1)
        elif kind == classes.WATER and fast:
            modest.shade_water(scene, w, look, x, y, ux, uy, uz, far, per_row, time, out_r, out_g, out_b, 1)
        elif kind == classes.GROUND and fast:
            modest.shade_ground(scene, w, x, y, uz, far, per_row, out_r, out_g, out_b, 1)
        elif kind == classes.SKY:
            frame.shade_sky(scene.sky, sky_begin, ux, uy, uz, out_r, out_g, out_b, 1)
        elif kind == classes.WATER:
            w0 = cuda.local.array(1, float32)
            w1 = cuda.local.array(1, float32)
            w2 = cuda.local.array(1, float32)
            w3 = cuda.local.array(1, float32)
            w4 = cuda.local.array(1, float32)
            w5 = cuda.local.array(1, float32)
            work = (a0, a1, a2, a3, a4, w0, w1, w2, w3, w4, w5)
            water.shade_water(
                scene, w, look, x, y, z, ux, uy, uz, far, per_row, time, work, out_r, out_g, out_b, 1
            )  # fmt: skip
        elif kind == classes.GROUND:
            ground.shade_ground(scene, w, x, y, uz, far, per_row, out_r, out_g, out_b, 1)
        if kind == classes.BRIDGE:
            out_r[0] = stone_r
            out_g[0] = stone_g
            out_b[0] = stone_b
        elif kind != classes.SKY:
            frame.haze(scene, w, look, far, out_r, out_g, out_b, 1)
        red += light * out_r[0]
        green += light * out_g[0]
        blue += light * out_b[0]
    radiance[r, c, 0] = red
    radiance[r, c, 1] = green
    radiance[r, c, 2] = blue
    depth_out[r, c] = depth[0]
    kind_out[r, c] = kind
    light_out[r, c] = light


def soften(scene, w, camera, look, depth, kind, light, radiance, softened):
    """Mix the light [H, W, 3] of the pixels on the outlines of bridges with their neighbours'."""
    c, r = cuda.grid(2)
    height, width = kind.shape
    if r >= height or c >= width:
        return
    eye = (
        camera[0], camera[1], camera[2], camera[3], camera[4], camera[5], camera[6], camera[7],
        camera[8], camera[9], camera[10], camera[11], camera[12], camera[13], camera[14],
    )  # fmt: skip
    planes = radiance[:, :, 0], radiance[:, :, 1], radiance[:, :, 2]
    _, red, green, blue = outlines.edge_colour(scene, w, look, eye, width, depth, kind, light, *planes, r, c)
    softened[r, c, 0] = red
    softened[r, c, 1] = green
    softened[r, c, 2] = blue


def tone_frame(radiance, kind, light, mean, look, key, codes, image):
    """Expose and pack each pixel: image [H, W] uint32, the water mask on top; mean: of the frame's luminance."""
    c, r = cuda.grid(2)
    if r >= image.shape[0] or c >= image.shape[1]:
        return
    gain = tone.exposure(mean)
    wet = uint32(255) if kind[r, c] == classes.WATER and light[r, c] > f32(0.5) else uint32(0)
    pixel = tone.tone_pixel(
        codes,
        radiance[r, c, 0],
        radiance[r, c, 1],
        radiance[r, c, 2],
        gain * look[tone.GAIN_R],
        gain * look[tone.GAIN_G],
        gain * look[tone.GAIN_B],
        wet,
    )
    if look[tone.NOISE] > f32(0):
        pixel = tone.noisy(pixel, look[tone.NOISE], tone.scramble(uint32(key + uint32(r * image.shape[1] + c))))
    image[r, c] = pixel
