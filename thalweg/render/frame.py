"""How does one frame come about? March, bridges, plants, shading, exposure, in this order, for one pose in one world.

A frame depends on nothing but its world, pose, time and camera: no state is kept from one to the next, so that the
batch, its order and the number of threads change no bit.
"""

import math

import numpy as np
from numba import int32, prange

from thalweg.kernel import kernel
from thalweg.render import bridges, ground, march, plants, water
from thalweg.render import scene as table
from thalweg.render.approx import exp
from thalweg.render.fetch import bilinear, sky_at
from thalweg.render.tone import develop

f32 = np.float32

SKY, WATER, GROUND, PLANT, BRIDGE = range(5)
"""Class ids of pixels."""


@kernel
def draw_frame(scene, w, x, y, z, yaw, time, camera, image, want_layers, depth_out, class_out):
    """Draw into image [H, W, 4] uint8: colour, and the water mask in the fourth channel; layers where wanted.

    camera: (height, width, half_height, half_width, pitch, near), the last four float32. Pose in world metres.
    """
    height, width, half_h, half_w, pitch, near = camera
    cos_p = f32(math.cos(pitch))
    sin_p = f32(math.sin(pitch))
    cos_y = f32(math.cos(yaw))
    sin_y = f32(math.sin(yaw))
    fx = cos_y * cos_p
    fy = sin_y * cos_p
    fz = -sin_p
    rx = sin_y
    ry = -cos_y
    ux = cos_y * sin_p
    uy = sin_y * sin_p
    uz = cos_p
    inv_cell = scene.number[w, table.INV_CELL]
    ox = f32(x)
    oy = f32(y)
    oz = f32(z)
    node_x = (ox - scene.number[w, table.ORIGIN_X]) * inv_cell
    node_y = (oy - scene.number[w, table.ORIGIN_Y]) * inv_cell
    per_column = f32(2) * half_w / f32(width)
    per_row = f32(2) * half_h / f32(height)
    wide = (width + plants.BLOCK - 1) // plants.BLOCK * plants.BLOCK

    depth = np.empty((height, wide), np.float32)
    kind = np.empty((height, wide), np.uint8)
    red = np.zeros((height, wide), np.float32)
    green = np.zeros((height, wide), np.float32)
    blue = np.zeros((height, wide), np.float32)
    light = np.ones((height, wide), np.float32)
    solid = np.full((height, wide), f32(1e9), np.float32)

    dx = np.empty(wide, np.float32)
    dy = np.empty(wide, np.float32)
    dz = np.empty(wide, np.float32)
    t = np.empty(wide, np.float32)
    hit = np.empty(wide, np.float32)
    first_bridge = scene.place[w, table.BRIDGE_FROM]
    last_bridge = scene.place[w, table.BRIDGE_TO]

    for r in range(height):
        sy = half_h - (f32(r) + f32(0.5)) * per_row
        base_x = fx + sy * ux
        base_y = fy + sy * uy
        base_z = fz + sy * uz
        for c in range(wide):
            sx = (f32(c) + f32(0.5)) * per_column - half_w
            dx[c] = (base_x + sx * rx) * inv_cell
            dy[c] = (base_y + sx * ry) * inv_cell
            dz[c] = base_z
            t[c] = near
        march.march(scene, w, node_x, node_y, oz, dx, dy, dz, t, hit, wide)
        for c in range(wide):
            depth[r, c] = t[c] if hit[c] > f32(0) else f32(1e9)
            kind[r, c] = np.uint8(GROUND) if hit[c] > f32(0) else np.uint8(SKY)
        for b in range(first_bridge, last_bridge):
            row = scene.bridges[b]
            reach = row[table.B_HALF_LENGTH] + row[table.B_HALF_WIDTH]
            ahead = (row[table.B_X] - ox) * cos_y + (row[table.B_Y] - oy) * sin_y
            if ahead < -reach:
                continue
            for c in range(width):
                sx = (f32(c) + f32(0.5)) * per_column - half_w
                found = bridges.meet_bridge(
                    row, ox, oy, oz, base_x + sx * rx, base_y + sx * ry, base_z, near, min(depth[r, c], f32(400))
                )
                if found[0] > f32(0):
                    depth[r, c] = found[0]
                    kind[r, c] = np.uint8(BRIDGE)
                    slant = np.sqrt(f32(1) + sx * sx + sy * sy)
                    red[r, c], green[r, c], blue[r, c] = bridges.shade_stone(
                        scene, w, row, found, found[0] * slant, found[0] * per_row
                    )

    # Stone is set aside while plants are drawn in front of it.
    stone_red = red.copy()
    stone_green = green.copy()
    stone_blue = blue.copy()
    for r in range(height):
        for c in range(wide):
            red[r, c] = f32(0)
            green[r, c] = f32(0)
            blue[r, c] = f32(0)

    eye = (ox, oy, oz, fx, fy, fz, rx, ry, ux, uy, uz, half_w, half_h, per_column, near)
    plants.draw_plants(scene, w, eye, depth, red, green, blue, light, solid)

    at = np.empty(wide, np.int32)
    px = np.empty(wide, np.float32)
    py = np.empty(wide, np.float32)
    pz = np.empty(wide, np.float32)
    far = np.empty(wide, np.float32)
    out_r = np.empty(wide, np.float32)
    out_g = np.empty(wide, np.float32)
    out_b = np.empty(wide, np.float32)
    columns = int32(scene.place[w, table.GX])
    rows = int32(scene.place[w, table.GY])
    map_at = int32(scene.place[w, table.MAP_AT])
    sky_begin = int32(scene.place[w, table.SKY_AT])
    for r in range(height):
        sy = half_h - (f32(r) + f32(0.5)) * per_row
        base_x = fx + sy * ux
        base_y = fy + sy * uy
        base_z = fz + sy * uz
        for c in range(width):
            if kind[r, c] == GROUND:
                sx = (f32(c) + f32(0.5)) * per_column - half_w
                gx = node_x + (base_x + sx * rx) * inv_cell * depth[r, c]
                gy = node_y + (base_y + sx * ry) * inv_cell * depth[r, c]
                if bilinear(scene.depth, map_at, columns, rows, gx, gy) > f32(0):
                    kind[r, c] = WATER
        for what in range(3):
            n = 0
            for c in range(width):
                if kind[r, c] == what and light[r, c] > f32(0.004):
                    at[n] = c
                    n += 1
            if n == 0:
                continue
            for k in range(n):
                sx = (f32(at[k]) + f32(0.5)) * per_column - half_w
                vx = base_x + sx * rx
                vy = base_y + sx * ry
                slant = np.sqrt(vx * vx + vy * vy + base_z * base_z)
                ground_t = depth[r, at[k]]
                px[k] = node_x + vx * inv_cell * ground_t
                py[k] = node_y + vy * inv_cell * ground_t
                pz[k] = oz + base_z * ground_t
                far[k] = ground_t * slant
                dx[k] = vx / slant
                dy[k] = vy / slant
                dz[k] = base_z / slant
            if what == SKY:
                for k in range(n):
                    out_r[k], out_g[k], out_b[k] = sky_at(scene.sky, sky_begin, dx[k], dy[k], dz[k])
                    far[k] = f32(0)
            elif what == WATER:
                water.shade_water(
                    scene, w, px, py, pz, dx, dy, dz, far, per_row, f32(time), out_r, out_g, out_b, n
                )  # fmt: skip
            else:
                ground.shade_ground(scene, w, px, py, dz, far, per_row, out_r, out_g, out_b, n)
            for k in range(n):
                clear = exp(-far[k] * f32(table.FOG_PER_M))
                out_r[k] = out_r[k] * clear + scene.number[w, table.FOG_R] * (f32(1) - clear)
                out_g[k] = out_g[k] * clear + scene.number[w, table.FOG_G] * (f32(1) - clear)
                out_b[k] = out_b[k] * clear + scene.number[w, table.FOG_B] * (f32(1) - clear)
            for k in range(n):
                c = at[k]
                red[r, c] += light[r, c] * out_r[k]
                green[r, c] += light[r, c] * out_g[k]
                blue[r, c] += light[r, c] * out_b[k]
        for c in range(width):
            if kind[r, c] == BRIDGE:
                red[r, c] += light[r, c] * stone_red[r, c]
                green[r, c] += light[r, c] * stone_green[r, c]
                blue[r, c] += light[r, c] * stone_blue[r, c]

    develop(red, green, blue, image, height, width)
    for r in range(height):
        for c in range(width):
            wet = (kind[r, c] == WATER) & (light[r, c] > f32(0.5))
            image[r, c, 3] = np.uint8(255) if wet else np.uint8(0)
    if want_layers:
        for r in range(height):
            for c in range(width):
                seen = min(depth[r, c], solid[r, c])
                depth_out[r, c] = f32(-1) if seen > f32(1e8) else seen
                class_out[r, c] = kind[r, c] if light[r, c] > f32(0.5) else np.uint8(PLANT)


@kernel(parallel=True)
def draw_frames(scene, world_index, poses, times, camera, images, want_layers, depths, classes):
    """Draw one frame per pose: images [N, H, W, 4]; depths and classes [N, H, W] where wanted, else [1, 1, 1]."""
    for n in prange(len(poses)):
        layer = n % len(depths)
        draw_frame(
            scene,
            world_index[n],
            poses[n, 0],
            poses[n, 1],
            poses[n, 2],
            poses[n, 3],
            times[n],
            camera,
            images[n],
            want_layers,
            depths[layer],
            classes[layer],
        )
