"""Kernels that draw all plants in view, as billboards, from near to far.

Radiance is added front to back, weighted by the light that still passes, in tiles of pixels. A tile that lets no more
light through is closed, and what lies behind it costs nothing there.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import int32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.camera_rays import row_step
from thalweg.render.kernels.plants import reduced_billboard
from thalweg.render.kernels.plants.billboard import SAMPLES, SHARPEN, SIDE, make_billboard, nearest_depth
from thalweg.render.kernels.plants.tiles import (
    TileRows,
    draw_billboard,
    empty_tiles,
    fill_tile_rows,
    first_open_row,
    load_depths,
    store_tiles,
)
from thalweg.render.kernels.table_lookup import clamp
from thalweg.render.records import layout
from thalweg.render.records.appearance import DENSITY

f32 = np.float32

NEAR_M = 0.6
"""Plants whose axis is nearer than this are not drawn: the camera would be inside them."""
FAR_M = 260.0
"""Plants farther than this are not drawn."""
BUCKETS = 1024
"""Buckets of the sort by distance, spaced as the square root of the distance."""


class Frustum(NamedTuple):
    """Half width and half height of the image plane at distance one, and the lengths of (1, half_w) and (1, half_h)."""

    half_w: Any
    half_h: Any
    slant_w: Any
    slant_h: Any


@kernel(inlined=True, allocates=False)
def bucket_of(distance):
    """The bucket of a horizontal distance in metres."""
    return int32(clamp(math.sqrt(distance) * f32((BUCKETS - 1) / math.sqrt(FAR_M)), f32(0), f32(BUCKETS - 1)))


@kernel(inlined=True, allocates=False)
def frustum_of(half_w, half_h):
    """The `Frustum` of an image plane."""
    slant_w = f32(math.sqrt(f32(1) + half_w * half_w))
    return Frustum(half_w, half_h, slant_w, f32(math.sqrt(f32(1) + half_h * half_h)))


@kernel(inlined=True, allocates=False)
def distance_in_view(plants, p, density, camera, frustum):
    """Horizontal distance of plant p in metres if it may be in view; -1 if it is not, or is not drawn.

    density: share of the plants that are drawn, those of lowest rank.
    """
    px = plants[p, layout.P_X] - camera.x
    py = plants[p, layout.P_Y] - camera.y
    flat = px * px + py * py
    if flat > f32(FAR_M * FAR_M) or flat < f32(NEAR_M * NEAR_M) or plants[p, layout.P_RANK] >= density:
        return f32(-1)
    half_height = plants[p, layout.P_HEIGHT] * f32(0.5)
    pz = plants[p, layout.P_Z] + half_height - camera.z
    # A sphere around the plant against the five planes of the view.
    radius = half_height + plants[p, layout.P_HALF]
    ahead = px * camera.forward_x + py * camera.forward_y + pz * camera.forward_z
    across = abs(px * camera.right_x + py * camera.right_y)
    above = abs(px * camera.up_x + py * camera.up_y + pz * camera.up_z)
    # Distance to a tilted plane is measured perpendicular to it; the slants replace that division.
    outside = across > ahead * frustum.half_w + radius * frustum.slant_w
    if ahead < -radius or outside or above > ahead * frustum.half_h + radius * frustum.slant_h:
        return f32(-1)
    return f32(math.sqrt(flat))


@kernel(inlined=True, allocates=False)
def chunk_in_view(chunks, chunk, camera, frustum):
    """Whether any plant of a chunk may be in view, by the tests of `distance_in_view` for the sphere around it."""
    x = chunks[chunk, 0] - camera.x
    y = chunks[chunk, 1] - camera.y
    z = chunks[chunk, 2] - camera.z
    radius = chunks[chunk, 3]
    reach = f32(FAR_M) + radius
    ahead = x * camera.forward_x + y * camera.forward_y + z * camera.forward_z
    across = abs(x * camera.right_x + y * camera.right_y)
    above = abs(x * camera.up_x + y * camera.up_y + z * camera.up_z)
    inside = (x * x + y * y <= reach * reach) & (ahead >= -radius)
    inside = inside & (across <= ahead * frustum.half_w + radius * frustum.slant_w)
    return inside & (above <= ahead * frustum.half_h + radius * frustum.slant_h)


class PlantOrder(NamedTuple):
    """The plants in view in their order, and scratch for sorting them; M is the number of plants in the world."""

    order: Any
    """[M] int32, numbers within the world, near to far."""
    distance: Any
    """[M] float32, horizontal metres from the camera, by number."""
    found: Any
    """[M] int32, scratch."""
    heads: Any
    """[BUCKETS + 1] int32, scratch."""


@kernel(inlined=True)
def empty_order(scene, world):
    """Return a `PlantOrder` without values for the plants of a world."""
    total = scene.extents[world, layout.PLANT_TO] - scene.extents[world, layout.PLANT_FROM]
    return PlantOrder(
        np.empty(total, np.int32), np.empty(total, np.float32), np.empty(total, np.int32),
        np.empty(BUCKETS + 1, np.int32),
    )  # fmt: skip


@kernel(allocates=False)
def visible_plants(scene, view, frustum, plant_order):
    """Sort the plants that may be in view by distance into a `PlantOrder`; returns how many there are."""
    order, distance, found, heads = plant_order
    first = scene.extents[view.world, layout.PLANT_FROM]
    last = scene.extents[view.world, layout.PLANT_TO]
    plants = scene.plants
    density = view.look[DENSITY]
    camera = view.camera
    count = 0
    # One more bucket than needed: counts are stored one ahead, so that their running sum is where each begins.
    for b in range(BUCKETS + 1):
        heads[b] = 0
    chunk = scene.extents[view.world, layout.CHUNK_AT]
    for begin in range(first, last, layout.CHUNK):
        seen = chunk_in_view(scene.chunks, chunk, camera, frustum)
        chunk += 1
        # Most chunks are out of view, and their plants are not read.
        if not seen:
            continue
        for p in range(begin, min(begin + layout.CHUNK, last)):
            far = distance_in_view(plants, p, density, camera, frustum)
            if far < f32(0):
                continue
            bucket = bucket_of(far)
            distance[p - first] = far
            heads[bucket + 1] += 1
            found[count] = p - first
            count += 1
    # A counting sort into buckets, of which nearly all hold one plant or none.
    for b in range(BUCKETS):
        heads[b + 1] += heads[b]
    for k in range(count):
        p = found[k]
        bucket = bucket_of(distance[p])
        order[heads[bucket]] = p
        heads[bucket] += 1
    # Plants are nearly in order now; insertion finishes the sort within the buckets.
    for k in range(1, count):
        p = order[k]
        far = distance[p]
        j = k - 1
        while j >= 0 and distance[order[j]] > far:
            order[j + 1] = order[j]
            j -= 1
        order[j + 1] = p
    return count


class PlantScratch(NamedTuple):
    """What plants are drawn with, beside `Tiles`."""

    plants: Any
    """A `PlantOrder`."""
    rows: Any
    """`TileRows`."""
    samples: Any
    """[SCRATCH_ROWS, SAMPLES] float32, scratch for a tile of the reduced quality."""


@kernel(inlined=True)
def empty_scratch(scene, world, tile_rows):
    """Return a `PlantScratch` without values for the plants of a world and so many rows of tiles."""
    table = np.empty((4, tile_rows), np.float32)
    return PlantScratch(
        empty_order(scene, world),
        TileRows(table[0], table[1], table[2], table[3]),
        np.empty((reduced_billboard.SCRATCH_ROWS, SAMPLES), np.float32),
    )


@kernel
def draw_plants(scene, view, top, reduced, buffers):
    """Fill radiance, transmittance and plant depth of `Buffers` [R, W'] with those of the plants in view.

    Rows are those from `top` on of the image; in the reduced quality R is even. Depth must already hold what lies
    behind the plants.
    """
    together = reduced_billboard.ROWS if reduced else 1
    tiles = empty_tiles(buffers.depth.shape[0], buffers.depth.shape[1], together)
    load_depths(buffers.depth, view.camera.width, together, tiles)
    work = empty_scratch(scene, view.world, len(tiles.deepest))
    draw_in_order(scene, view, top, reduced, True, tiles, work)
    store_tiles(tiles, together, True, buffers)


@kernel(disjoint=True, allocates=False)
def draw_in_order(scene, view, top, reduced, coloured, tiles, work):
    """Draw the plants in view, from near to far, into `Tiles` that hold the depths behind; row 0 is row `top`.

    coloured: with their radiance, else only as coverage (see `cover`); work: a `PlantScratch`.
    """
    camera = view.camera
    first = scene.extents[view.world, layout.PLANT_FROM]
    together = reduced_billboard.ROWS if reduced else 1
    high = SIDE * together
    sharpen = f32(reduced_billboard.SHARPEN) if reduced else f32(SHARPEN)
    farthest = deepest_of(tiles.deepest)
    if farthest == f32(0):
        return
    fill_tile_rows(camera, top, together, work.rows)
    count = visible_plants(scene, view, frustum_of(camera.half_w, camera.half_h), work.plants)
    for k in range(count):
        number = work.plants.order[k]
        far = work.plants.distance[number]
        nearest = nearest_depth(far, camera)
        # All plants that are left stand behind whatever is seen.
        if nearest > farthest:
            break
        p = first + number
        c0, c1, r0, r1 = billboard_box(scene.plants[p], far, camera, camera.width)
        # The box is in rows of the image, the tiles in rows of this band.
        r0 = max(r0 - int32(top), int32(0))
        r1 = min(r1 - int32(top), int32(len(tiles.deepest) * high))
        if c0 >= c1 or r0 >= r1:
            continue
        y1 = (r1 - 1) // high + 1
        # Most plants stand behind others; those that no tile shows are not prepared.
        y0 = first_open_row(tiles.deepest, nearest, (c0 // SIDE, (c1 - 1) // SIDE + 1, r0 // high, y1))
        if y0 < y1:
            board = make_billboard(scene, view, p, far, sharpen)
            box = c0, c1, y0, y1
            draw_billboard(scene, board, nearest, camera, box, top, reduced, coloured, work.samples, work.rows, tiles)


@kernel(inlined=True, allocates=False)
def deepest_of(deepest):
    """The greatest depth of all tiles [Y, X], 0 if all are closed."""
    most = f32(0)
    for ty in range(deepest.shape[0]):
        for tx in range(deepest.shape[1]):
            most = max(most, deepest[ty, tx])
    return most


@kernel(inlined=True, allocates=False)
def billboard_box(plant, distance, camera, columns):
    """The columns from, to and rows from, to of the image that the billboard of a plant may touch.

    columns: those that are drawn, which may be more than the image has.
    """
    px = plant[layout.P_X] - camera.x
    py = plant[layout.P_Y] - camera.y
    foot = plant[layout.P_Z] - camera.z
    half = plant[layout.P_HALF]
    nx = px / distance
    ny = py / distance
    low_x = f32(1e9)
    high_x = f32(-1e9)
    low_y = f32(1e9)
    high_y = f32(-1e9)
    cut = False
    for corner in range(4):
        side = half if corner & 1 else -half
        cz = foot + plant[layout.P_HEIGHT] if corner & 2 else foot
        cx = px - ny * side
        cy = py + nx * side
        ahead = cx * camera.forward_x + cy * camera.forward_y + cz * camera.forward_z
        # Corners behind the near plane have no image; the billboard may then be anywhere.
        cut |= ahead < camera.near_m
        # Kept positive for the division; the result is not used for a plant that is cut.
        ahead = max(ahead, f32(0.05))
        sx = (cx * camera.right_x + cy * camera.right_y) / ahead
        sy = (cx * camera.up_x + cy * camera.up_y + cz * camera.up_z) / ahead
        low_x = min(low_x, sx)
        high_x = max(high_x, sx)
        low_y = min(low_y, sy)
        high_y = max(high_y, sy)
    per_row = row_step(camera)
    c0 = int32(0)
    c1 = int32(columns)
    r0 = int32(0)
    r1 = int32(camera.height)
    if not cut:
        c0 = max(int32((low_x + camera.half_w) / camera.column_step), c0)
        c1 = min(int32((high_x + camera.half_w) / camera.column_step) + int32(1), c1)
        r0 = max(int32((camera.half_h - high_y) / per_row), r0)
        r1 = min(int32((camera.half_h - low_y) / per_row) + int32(1), r1)
    return c0, c1, r0, r1
