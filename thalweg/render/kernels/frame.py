"""Kernels that draw one frame: primary hits, bridges, props, plants, shading and exposure, in this order.

A frame depends on nothing but its world, pose, time and camera. No state is kept from one to the next, so that batch
size, order and number of threads change no bit.
"""

import math

import numpy as np
from numba import int32, uint32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels import bridge_stone, bridges
from thalweg.render.kernels.bridge_edges import soften_edges
from thalweg.render.kernels.camera_rays import Radiance, image_x, image_y, ray_direction, row_step
from thalweg.render.kernels.layers import draw_layers
from thalweg.render.kernels.plants.draw import draw_plants
from thalweg.render.kernels.props.draw import draw_props
from thalweg.render.kernels.props.marks import hold_marks, release_marks
from thalweg.render.kernels.props.posed_props import pose_props
from thalweg.render.kernels.props.water import hold_water, release_water
from thalweg.render.kernels.shading import tone
from thalweg.render.kernels.shading.background import shade
from thalweg.render.kernels.terrain.primary_hits import MISS, find_primary_hits
from thalweg.render.records import layout
from thalweg.render.records.classes import BRIDGE, PLANT, WATER
from thalweg.render.records.view import COLOURS, LANES, MASK, Buffers

f32 = np.float32


@kernel
def empty_buffers(height, width, drawn):
    """Return new `Buffers` of a frame of which `drawn` is asked for (see `Output`).

    Each is [H', W'], but those of radiance are [0, 0] where no colours are asked for.

    H' is the height rounded up to an even number of rows, W' the width rounded up to a multiple of `LANES`.
    """
    # Rows are drawn by twos in the reduced quality, pixels by tiles and by vectors: no loop has to test for an edge.
    shape = height + height % 2, (width + LANES - 1) // LANES * LANES
    coloured = shape if drawn == COLOURS else (0, 0)
    return Buffers(
        np.empty(shape, np.float32),
        np.empty(shape, np.uint8),
        np.empty(coloured, np.float32),
        np.empty(coloured, np.float32),
        np.empty(coloured, np.float32),
        np.empty(shape, np.float32),
        np.empty(shape, np.float32),
        np.empty(shape, np.float32),
    )


@kernel(inlined=True)
def rows_of(buffers, top, bottom):
    """The rows top to bottom of `Buffers`, without a copy."""
    return Buffers(
        buffers.depth[top:bottom],
        buffers.kind[top:bottom],
        buffers.red[top:bottom],
        buffers.green[top:bottom],
        buffers.blue[top:bottom],
        buffers.transmittance[top:bottom],
        buffers.plant_depth[top:bottom],
        buffers.water[top:bottom],
    )


@kernel
def draw_rows(scene, view, props, reduced, drawn, top, bottom, buffers):
    """Draw the rows from top to bottom into the `Buffers` of their frame; top is a multiple of
    `background.ROWS_TOGETHER`. props: [P, PROP_COLUMNS] float32.

    What a row shows depends only on the rows of its band of `background.ROWS_TOGETHER`. drawn: see `Output`; what is
    not asked for is not computed.
    """
    # The reduced quality draws rows by twos; the one past an odd height is never shown.
    bottom += bottom % 2
    rows = rows_of(buffers, top, bottom)
    # One call of each for all that may be drawn, so that masks and layers have the depths of the frame to the bit.
    find_primary_hits(scene, view, top, reduced, rows.depth, rows.kind, rows.water)
    stone = draw_bridges(scene, view, top, drawn, rows.depth, rows.kind)
    posed = pose_props(scene, view, props)
    marks = draw_props(scene, view, props, posed, top, drawn, rows.depth, rows.kind)
    if drawn != COLOURS:
        draw_layers(scene, view, top, reduced, drawn == MASK, rows)
        return
    draw_plants(scene, view, top, reduced, rows)
    # What shows props, or water around them, is shaded apart; everything else stays as it is without them.
    hold_marks(marks, rows.depth, rows.kind, rows.transmittance)
    stirred = hold_water(view, props, posed, reduced, top, rows)
    shade(scene, view, top, reduced, rows)
    add_stone(stone, rows)
    release_water(scene, view, props, posed, top, stirred, rows)
    release_marks(marks, rows)


@kernel(allocates=False)
def add_stone(stone, rows):
    """Add the stone [K, 6] of `draw_bridges` to `Buffers` [R, W'], as much as the plants let through."""
    for k in range(len(stone)):
        r = int32(stone[k, 0])
        c = int32(stone[k, 1])
        # Of several bridges behind one pixel only the nearest is seen.
        if rows.kind[r, c] == BRIDGE and stone[k, 5] == rows.depth[r, c]:
            rows.red[r, c] += rows.transmittance[r, c] * stone[k, 2]
            rows.green[r, c] += rows.transmittance[r, c] * stone[k, 3]
            rows.blue[r, c] += rows.transmittance[r, c] * stone[k, 4]


@kernel
def finish_frame(scene, view, settings, buffers, n, output):
    """Turn the drawn `Buffers` of a frame into number n of the arrays of `Output`."""
    if output.drawn == COLOURS and not settings.reduced:
        # Without the row by which an odd height is rounded up: rays are aimed by the number of rows.
        soften_edges(scene, view, rows_of(buffers, 0, settings.height))
    # Layers are written first, because the mask replaces the classes in place.
    if output.want_layers:
        write_layers(buffers, output.depths[n], output.classes[n])
    mask_water(buffers.kind, buffers.transmittance)
    if output.drawn != COLOURS:
        copy_mask(buffers.kind, output.masks[n])
        return
    tone.write_image(
        Radiance(buffers.red, buffers.green, buffers.blue), buffers.kind, view.look, noise_key(view), output.images[n]
    )  # fmt: skip


@kernel(inlined=True, allocates=False)
def noise_key(view):
    """What the sensor's noise depends on: position and time, to the bit."""
    # The bits themselves are hashed, because rounding would give neighbouring poses the same noise.
    key = tone.scramble(uint32(np.float32(view.camera.x).view(np.int32)))
    key = tone.scramble(uint32(key ^ uint32(np.float32(view.camera.y).view(np.int32))))
    return tone.scramble(uint32(key ^ uint32(np.float32(view.time).view(np.int32))))


@kernel
def draw_bridges(scene, view, top, drawn, depth, kind):
    """Set depth and kind [R, W'] where a bridge is nearest; returns the stone that rays meet.

    The stone [K, 6]: row, column, red, green, blue, depth. It is added to the frame only after the plants. drawn: see
    `Output`; without colours there is no stone, and for a mask only rays that meet water count.
    """
    count = scene.extents[view.world, layout.BRIDGE_TO] - scene.extents[view.world, layout.BRIDGE_FROM]
    boxes = np.empty((count, 4), np.int32)
    closest = np.empty(count, np.float32)
    pixels = find_boxes(scene, view, top, len(depth), boxes, closest)
    stone = np.empty((pixels if drawn == COLOURS else 0, 6), np.float32)
    met = meet_bridges(scene, view, top, drawn, boxes, closest, depth, kind, stone)
    return stone[:met]


@kernel(allocates=False)
def find_boxes(scene, view, top, rows, boxes, closest):
    """Fill boxes [B, 4] with the columns from, to and rows from, to that each bridge may touch; returns their pixels.

    Rows count from `top`, and there are `rows` of them. closest [B]: receives the depth before which no bridge is.
    """
    first = scene.extents[view.world, layout.BRIDGE_FROM]
    pixels = 0
    for b in range(len(boxes)):
        c0, c1, r0, r1, closest[b] = bridges.bridge_box(scene.bridges[first + b], view.camera)
        boxes[b, 0] = c0
        boxes[b, 1] = c1
        boxes[b, 2] = max(r0 - top, 0)
        boxes[b, 3] = min(r1 - top, rows)
        pixels += max(boxes[b, 1] - boxes[b, 0], 0) * max(boxes[b, 3] - boxes[b, 2], 0)
    return pixels


@kernel(allocates=False)
def meet_bridges(scene, view, top, drawn, boxes, closest, depth, kind, stone):
    """Fill stone [K, 6], of `draw_bridges`, and set depth and kind [R, W'], within boxes [B, 4]; returns how many rays
    found stone to be shaded. closest [B]: of `find_boxes`."""
    camera = view.camera
    per_row = row_step(camera)
    first = scene.extents[view.world, layout.BRIDGE_FROM]
    n = 0
    for b in range(len(boxes)):
        row = scene.bridges[first + b]
        for r in range(boxes[b, 2], boxes[b, 3]):
            sy = image_y(camera, top + r, 1)
            for c in range(boxes[b, 0], boxes[b, 1]):
                # Before all of the bridge lies what is already drawn.
                if depth[r, c] <= closest[b] or (drawn == MASK and kind[r, c] != WATER):
                    continue
                sx = image_x(camera, c)
                dx, dy, dz = ray_direction(camera, sx, sy)
                # Only stone nearer than what is already drawn counts, so the order of bridges does not matter.
                ray = bridges.bridge_ray(row, camera, dx, dy, dz)
                hit = bridges.meet_bridge(row, ray, camera.near_m, min(depth[r, c], f32(bridges.FAR_M)))
                if hit.t > f32(0):
                    depth[r, c] = hit.t
                    kind[r, c] = np.uint8(BRIDGE)
                    if drawn != COLOURS:
                        continue
                    slant = math.sqrt(f32(1) + sx * sx + sy * sy)
                    stone[n, 0] = f32(r)
                    stone[n, 1] = f32(c)
                    stone[n, 2], stone[n, 3], stone[n, 4] = bridge_stone.shade_stone(
                        scene, view, row, hit, ray, per_row, slant, f32(1)
                    )
                    stone[n, 5] = hit.t
                    n += 1
    return n


@kernel(disjoint=True, allocates=False)
def write_layers(buffers, depth_out, class_out):
    """Depth along the axis (-1: sky) and class of each pixel [H, W], from `Buffers` [H', W']."""
    height, width = depth_out.shape
    depth, plant_depth, kind, light = buffers.depth, buffers.plant_depth, buffers.kind, buffers.transmittance
    for r in range(height):
        for c in range(width):
            seen = min(depth[r, c], plant_depth[r, c])
            depth_out[r, c] = f32(-1) if seen >= f32(MISS) else seen
            # A pixel belongs to the plants once they stop at least half of its light.
            class_out[r, c] = kind[r, c] if light[r, c] > f32(0.5) else np.uint8(PLANT)


@kernel(disjoint=True, allocates=False)
def mask_water(kind, light):
    """Replace kind [H', W'] by the mask: 255 where water is seen, else 0."""
    for r in range(kind.shape[0]):
        for c in range(kind.shape[1]):
            wet = (kind[r, c] == np.uint8(WATER)) & (light[r, c] > f32(0.5))
            kind[r, c] = np.uint8(255) if wet else np.uint8(0)


@kernel(disjoint=True, allocates=False)
def copy_mask(mask, out):
    """Copy the mask of the image's pixels [H, W] out of one of whole blocks [H', W']."""
    for r in range(out.shape[0]):
        for c in range(out.shape[1]):
            out[r, c] = mask[r, c]
