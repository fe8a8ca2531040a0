"""How are ten thousand plants drawn in a millisecond? As upright pictures that face the camera, from near to far.

Colour is added up front to back with the light that still passes, in blocks of pixels; a block that lets nothing
through any more is closed, and whatever lies behind costs nothing there. A picture comes from the atlas level whose
texels are about as large as pixels.
"""

import math

import numpy as np
from numba import int32, uint64

from thalweg.core.jit import kernel
from thalweg.render.kernels.billboard import BLOCK, SHARPEN, draw_picture, nearest_ray, picture_of
from thalweg.render.kernels.shading import reduced_quality as modest
from thalweg.render.kernels.table_lookup import clamp
from thalweg.render.records import scene as table
from thalweg.render.records.appearance import DENSITY

f32 = np.float32

NEAR_M = 0.6
"""Plants whose axis is nearer than this are not drawn: the camera would be inside them."""
FAR_M = 260.0
BUCKETS = 1024
"""Sorting by distance: buckets spaced as its square root."""


@kernel(inlined=True)
def bucket_of(far):
    return int32(clamp(math.sqrt(far) * f32((BUCKETS - 1) / math.sqrt(FAR_M)), f32(0), f32(BUCKETS - 1)))


@kernel(inlined=True)
def distance_in_view(plants, p, density, ox, oy, oz, fx, fy, fz, rx, ry, ux, uy, uz, half_w, half_h, slant_w, slant_h):
    """Horizontal distance of plant p if it may be in view, in metres; -1 if not, or if it is not drawn.

    slant_w, slant_h: the lengths of (1, half_w) and (1, half_h); other arguments as of `visible_plants`.
    """
    px = plants[p, table.P_X] - ox
    py = plants[p, table.P_Y] - oy
    flat = px * px + py * py
    if flat > f32(FAR_M * FAR_M) or flat < f32(NEAR_M * NEAR_M) or plants[p, table.P_RANK] >= density:
        return f32(-1)
    half_tall = plants[p, table.P_HEIGHT] * f32(0.5)
    pz = plants[p, table.P_Z] + half_tall - oz
    # A sphere around the plant against the five planes of the view.
    radius = half_tall + plants[p, table.P_HALF]
    ahead = px * fx + py * fy + pz * fz
    aside = abs(px * rx + py * ry)
    above = abs(px * ux + py * uy + pz * uz)
    if ahead < -radius or aside > ahead * half_w + radius * slant_w or above > ahead * half_h + radius * slant_h:
        return f32(-1)
    return f32(math.sqrt(flat))


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
        far = distance_in_view(
            plants, p, density, ox, oy, oz, fx, fy, fz, rx, ry, ux, uy, uz, half_w, half_h, slant_w, slant_h
        )
        if far < f32(0):
            continue
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
    up to whole blocks. fast: whether the quality is the modest one, for which R is even.
    """
    ox, oy, oz, fx, fy, fz, rx, ry, ux, uy, uz, half_w, half_h, per_column, _ = eye
    rows = depth.shape[0]
    columns = depth.shape[1]
    first = scene.place[w, table.PLANT_FROM]
    total = scene.place[w, table.PLANT_TO] - first
    deepest = np.empty((rows, columns // BLOCK), np.float32)
    deepest_ground(depth, modest.ROWS if fast else 1, deepest)
    sharpen = f32(modest.SHARPEN) if fast else f32(SHARPEN)
    brush = np.empty((modest.BRUSH, BLOCK), np.float32)

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
            picture = picture_of(scene, w, look, p, far, eye, height, sharpen)
            box = c0, c1, r0, r1
            nearest = nearest_ray(far, eye)
            if fast:
                modest.draw_picture(scene.atlas, picture, nearest, eye, box, height, top, deepest, brush, planes)
            else:
                draw_picture(scene.atlas, picture, nearest, eye, box, height, top, deepest, planes)


@kernel(disjoint=True)
def deepest_ground(depth, rows_together, deepest):
    """The greatest depth [R, W'] within each block of `rows_together` rows, into deepest [R, W' / BLOCK].

    A block's number is that of its first row.
    """
    rows = depth.shape[0]
    most = np.empty(BLOCK, np.float32)
    for r in range(0, rows, rows_together):
        for bx in range(deepest.shape[1]):
            for i in range(BLOCK):
                most[i] = f32(0)
            for below in range(r, min(r + rows_together, rows)):
                first = uint64(bx * BLOCK)
                for i in range(BLOCK):
                    most[i] = max(most[i], depth[below, first + uint64(i)])
            deepest[r, bx] = most.max()


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
