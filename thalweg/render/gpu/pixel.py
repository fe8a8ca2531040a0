"""What does one pixel see? A block of threads a tile of `march.TILE` pixels a side, from the CPU's functions for spans,
with spans of one, which stay in registers.

A tile's threads walk the list of plants together, as many at a time as there are threads: each looks at one plant and,
if its picture touches the tile, lays what all pixels of it share into shared memory. They stop once no pixel lets light
through any more, or each shows ground nearer than all that is left.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import cuda, float32, int32, uint8

from thalweg.render.kernels import bridges, frame
from thalweg.render.kernels import heightfield_march as march
from thalweg.render.kernels.billboard import CLOSED, SHARPEN, nearest_ray, picture_of, picture_pixel
from thalweg.render.kernels.camera_rays import aim, aim_squares, reach
from thalweg.render.kernels.primary_hits import MISS
from thalweg.render.kernels.shading import ground, water
from thalweg.render.kernels.shading import reduced_quality as modest
from thalweg.render.records import classes
from thalweg.render.records import scene as table

f32 = np.float32

SIDE = march.TILE
THREADS = SIDE * SIDE
SHARED_FLOATS, SHARED_INTS = 17, 3
"""Numbers of a picture that all its pixels share."""


@cache
def tracer(fast: bool, coloured: bool) -> Callable:
    """The kernel for a quality: `fast` is the modest one; without colours only depth, class and mask are found."""
    sharpen = modest.SHARPEN if fast else SHARPEN
    closed = modest.CLOSED if fast else CLOSED
    square = march.SQUARE if fast else 1

    def trace(scene, world_index, moments, looks, eyes, order, distance, boxes, counts, planes):
        """One block a tile (x) of a camera (y): depth, kind, red, green, blue, light, solid [N, H, W] of each pixel.

        moments: of `visible.place_cameras`; order, distance, boxes, counts: of `visible.find`; planes: as of
        `frame.open_planes`, of which solid is the depth of the plant behind which less than half of the light remains.
        """
        n = cuda.blockIdx.y
        thread = cuda.threadIdx.x
        plane_depth, plane_kind, plane_red, plane_green, plane_blue, plane_light, plane_solid = planes
        height, width = plane_kind.shape[1:]
        tiles = (width + SIDE - 1) // SIDE
        tile_r = cuda.blockIdx.x // tiles * SIDE
        tile_c = cuda.blockIdx.x % tiles * SIDE
        r = tile_r + thread // SIDE
        c = tile_c + thread % SIDE
        w = world_index[n]
        look = looks[n]
        eye = (
            eyes[n, 0], eyes[n, 1], eyes[n, 2], eyes[n, 3], eyes[n, 4], eyes[n, 5], eyes[n, 6], eyes[n, 7],
            eyes[n, 8], eyes[n, 9], eyes[n, 10], eyes[n, 11], eyes[n, 12], eyes[n, 13], eyes[n, 14],
        )  # fmt: skip
        near = eye[14]
        inv_cell = scene.number[w, table.INV_CELL]
        node_x = (eye[0] - scene.number[w, table.ORIGIN_X]) * inv_cell
        node_y = (eye[1] - scene.number[w, table.ORIGIN_Y]) * inv_cell

        ray_x = cuda.local.array(1, float32)
        ray_y = cuda.local.array(1, float32)
        ray_z = cuda.local.array(1, float32)
        mid_x = cuda.local.array(1, float32)
        mid_y = cuda.local.array(1, float32)
        mid_z = cuda.local.array(1, float32)
        depth = cuda.local.array(1, float32)
        hit = cuda.local.array(1, float32)
        wet = cuda.local.array(1, float32)
        a0 = cuda.local.array(1, float32)
        a1 = cuda.local.array(1, float32)
        a2 = cuda.local.array(1, float32)
        a3 = cuda.local.array(1, float32)
        a4 = cuda.local.array(1, float32)
        track = (a0, a1, a2, a3, a4)

        # All rays of a tile start where its bundle gets to.
        start = cuda.shared.array(1, float32)
        if thread == 0:
            aim_squares(eye, height, tile_r, SIDE, inv_cell, mid_x, mid_y, mid_z, tile_c // SIDE, 1)
            depth[0] = near
            spread = march.bundle_spread(eye, height)
            march.approach(scene, w, node_x, node_y, eye[2], spread, mid_x, mid_y, mid_z, depth, 1)
            start[0] = depth[0]
        cuda.syncthreads()
        aim(eye, height, r, c, inv_cell, ray_x, ray_y, ray_z, 1)
        depth[0] = start[0]
        if fast:
            tilt_x = cuda.local.array(1, float32)
            tilt_y = cuda.local.array(1, float32)
            gap = cuda.local.array(1, float32)
            met = cuda.local.array(1, float32)
            met[0] = depth[0]
            row = r // square * square
            aim_squares(eye, height, row, square, inv_cell, mid_x, mid_y, mid_z, c // square, 1)
            march.march(scene, w, node_x, node_y, eye[2], mid_x, mid_y, mid_z, met, hit, track, 1)
            march.touch(scene, w, node_x, node_y, eye[2], mid_x, mid_y, met, tilt_x, tilt_y, gap, 1)
            march.settle(tilt_x, tilt_y, gap, met, ray_x, ray_y, ray_z, depth, 1)
        else:
            march.march(scene, w, node_x, node_y, eye[2], ray_x, ray_y, ray_z, depth, hit, track, 1)
        march.wetness(scene, w, node_x, node_y, ray_x, ray_y, depth, wet, 1)
        kind = int32(classes.SKY)
        if hit[0] > f32(0):
            kind = int32(classes.WATER) if wet[0] > f32(0) else int32(classes.GROUND)
        else:
            depth[0] = f32(MISS)

        cell = f32(1) / inv_cell
        dx = ray_x[0] * cell
        dy = ray_y[0] * cell
        dz = ray_z[0]
        per_row = f32(2) * eye[12] / f32(height)
        stone_r = f32(0)
        stone_g = f32(0)
        stone_b = f32(0)
        for b in range(scene.place[w, table.BRIDGE_FROM], scene.place[w, table.BRIDGE_TO]):
            limit = min(depth[0], f32(bridges.FAR_M))
            found = bridges.meet_bridge(scene.bridges[b], eye[0], eye[1], eye[2], dx, dy, dz, near, limit)
            if found[0] > f32(0):
                depth[0] = found[0]
                kind = int32(classes.BRIDGE)
                if coloured:
                    slant = f32((dx * dx + dy * dy + dz * dz) ** f32(0.5))
                    stone_r, stone_g, stone_b = bridges.shade_stone(
                        scene, w, look, scene.bridges[b], found, found[0] * slant, found[0] * per_row, dz / slant
                    )

        red = f32(0)
        green = f32(0)
        blue = f32(0)
        light = f32(1)
        solid = f32(MISS)
        inside = r < height and c < width
        # Rows that share their texels look through the middle of them.
        pic_x = dx
        pic_y = dy
        pic_z = dz
        if fast:
            off = (f32(r % modest.ROWS) - f32(0.5 * modest.ROWS - 0.5)) * per_row
            pic_x = dx + off * eye[8]
            pic_y = dy + off * eye[9]
            pic_z = dz + off * eye[10]
        card = cuda.shared.array((SHARED_FLOATS, THREADS), float32)
        place = cuda.shared.array((SHARED_INTS, THREADS), int32)
        touches = cuda.shared.array(THREADS, uint8)
        first_plant = scene.place[w, table.PLANT_FROM]
        total = counts[n]
        for first in range(0, total, THREADS):
            nearest = nearest_ray(distance[n, order[n, first]], eye)
            open_ = inside and light > f32(closed) and depth[0] > nearest
            if cuda.syncthreads_or(int32(open_)) == 0:
                break
            k = first + thread
            touching = False
            if k < total:
                touching = (
                    boxes[n, k, 0] < tile_c + SIDE
                    and boxes[n, k, 1] > tile_c
                    and boxes[n, k, 2] < tile_r + SIDE
                    and boxes[n, k, 3] > tile_r
                )
            touches[thread] = uint8(1) if touching else uint8(0)
            if touching:
                p = order[n, k]
                shape, texels, paint, dark = picture_of(
                    scene, w, look, first_plant + p, distance[n, p], eye, height, f32(sharpen)
                )
                (
                    card[0, thread], card[1, thread], card[2, thread],
                    card[3, thread], card[4, thread], card[5, thread],
                ) = shape  # fmt: skip
                (
                    card[6, thread], card[7, thread], card[8, thread], card[9, thread],
                    card[10, thread], card[11, thread], card[12, thread], card[13, thread],
                ) = paint  # fmt: skip
                card[14, thread], card[15, thread], card[16, thread] = dark
                place[0, thread], place[1, thread], place[2, thread] = texels
            cuda.syncthreads()
            for j in range(min(THREADS, total - first)):
                if touches[j] == 0:
                    continue
                picture = (
                    (card[0, j], card[1, j], card[2, j], card[3, j], card[4, j], card[5, j]),
                    (place[0, j], place[1, j], place[2, j]),
                    (
                        card[6, j], card[7, j], card[8, j], card[9, j],
                        card[10, j], card[11, j], card[12, j], card[13, j],
                    ),
                    (card[14, j], card[15, j], card[16, j]),
                )  # fmt: skip
                if fast:
                    ink_r, ink_g, ink_b, ink, t = modest.picture_pixel(scene.atlas, picture, pic_x, pic_y, pic_z, near)
                    part = light * ink if t < depth[0] else f32(0)
                    red += part * ink_r
                    green += part * ink_g
                    blue += part * ink_b
                else:
                    add_r, add_g, add_b, part, t = picture_pixel(
                        scene.atlas, picture, pic_x, pic_y, pic_z, near, depth[0], light
                    )
                    red += add_r
                    green += add_g
                    blue += add_b
                rest = light - part
                solid = t if light >= f32(0.5) and rest < f32(0.5) else solid
                light = rest
            cuda.syncthreads()

        if coloured and light > f32(frame.SEEN):
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
            time = moments[n]
            if kind == classes.BRIDGE:
                out_r[0] = stone_r
                out_g[0] = stone_g
                out_b[0] = stone_b
            elif kind == classes.SKY:
                if fast:
                    modest.shade_sky(scene.sky, sky_begin, ux, uy, uz, out_r, out_g, out_b, 1)
                else:
                    frame.shade_sky(scene.sky, sky_begin, ux, uy, uz, out_r, out_g, out_b, 1)
            elif kind == classes.WATER:
                if fast:
                    modest.shade_water(scene, w, look, x, y, ux, uy, uz, far, per_row, time, out_r, out_g, out_b, 1)
                else:
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
            elif fast:
                modest.shade_ground(scene, w, x, y, uz, far, per_row, out_r, out_g, out_b, 1)
            else:
                ground.shade_ground(scene, w, x, y, uz, far, per_row, out_r, out_g, out_b, 1)
            if kind == classes.WATER or kind == classes.GROUND:
                frame.haze(scene, w, look, far, out_r, out_g, out_b, 1)
            red += light * out_r[0]
            green += light * out_g[0]
            blue += light * out_b[0]
        if inside:
            plane_depth[n, r, c] = depth[0]
            plane_kind[n, r, c] = kind
            plane_light[n, r, c] = light
            plane_solid[n, r, c] = solid
            if coloured:
                plane_red[n, r, c] = red
                plane_green[n, r, c] = green
                plane_blue[n, r, c] = blue

    return trace
