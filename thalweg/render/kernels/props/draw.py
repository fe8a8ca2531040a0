"""Kernels that draw props over the rows of a frame, in the rectangles of pixels that their parts may touch.

A pixel's ray meets the parts of a prop one after another; two layers are kept in order of depth, so that parts that
stand in one another are seen as they should be. A pixel has the class and the depth of a prop that covers half of it or
more. Props are drawn after ground, water and bridges, and before plants, which hide them.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import int32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.camera_rays import image_x, image_y, ray_direction, row_step
from thalweg.render.kernels.props import models
from thalweg.render.kernels.props.paint import part_radiance
from thalweg.render.kernels.props.pose import (
    C0,
    C1,
    FADE,
    PART_COLUMNS,
    R0,
    R1,
    SHAPE,
    TAPER,
    place_prop,
    solid_ray,
    sort_in_view,
)
from thalweg.render.kernels.props.solids import meet_solid
from thalweg.render.kernels.table_lookup import clamp
from thalweg.render.kernels.terrain.primary_hits import MISS
from thalweg.render.records.classes import WATER
from thalweg.render.records.props import CLASS_OFFSET, KIND
from thalweg.render.records.view import COLOURS, MASK

f32 = np.float32

LEAST_COVER = 0.02
"""Share of a pixel below which a part is left out."""
HALF = 0.5
"""Share of a pixel from which on it has the prop's class."""
STEEPEST = 0.05
"""Least sine of the angle between sight and water by which a part's edge at the water is softened."""

# Columns of a mark, which is a pixel that shows some of a prop: its place, the share that the prop covers, its radiance
# times that share, what the pixel showed before (depth, class), the prop's depth and class (0 where it covers less than
# half), and the light that plants let through, which is known later.
ROW, COLUMN, COVER, RED, GREEN, BLUE, DEPTH_BEHIND, KIND_BEHIND, DEPTH, CLASS, LIGHT = range(11)
MARK_COLUMNS = 11


class Layers(NamedTuple):
    """What a ray meets of a prop: the nearest part and all behind it, by their share, radiance times share, and t."""

    cover: Any
    t: Any
    red: Any
    green: Any
    blue: Any
    back_cover: Any
    back_t: Any
    back_red: Any
    back_green: Any
    back_blue: Any


class PlacedProps(NamedTuple):
    """The props in view of a frame, near to far, K of them."""

    parts: Any
    """[K * MOST_PARTS, PART_COLUMNS] float32; those of prop k begin at k * MOST_PARTS."""
    counts: Any
    """[K] int32, parts of each."""
    numbers: Any
    """[K] int32, which of the frame's props each is."""
    boxes: Any
    """[K, 4] int32, columns from, to and rows from, to of the image that each may touch."""
    active: Any
    """[MOST_PARTS] int32, scratch: the parts of a prop that touch a row."""


@kernel
def place_props(scene, view, props):
    """Return the `PlacedProps` of a view; props: [P, PROP_COLUMNS]."""
    order = np.empty(len(props), np.int32)
    count = sort_in_view(props, view.camera, order, np.empty(len(props), np.float32))
    placed = PlacedProps(
        np.empty((count * models.MOST_PARTS, PART_COLUMNS), np.float32),
        np.empty(count, np.int32), order[:count], np.empty((count, 4), np.int32),
        np.empty(models.MOST_PARTS, np.int32),
    )  # fmt: skip
    place_in_order(scene, view, props, placed)
    return placed


@kernel(inlined=True, allocates=False)
def place_in_order(scene, view, props, placed):
    """Fill the parts, counts and boxes of `PlacedProps` whose numbers are there."""
    for k in range(len(placed.counts)):
        first = k * models.MOST_PARTS
        parts = placed.parts[first : first + models.MOST_PARTS]
        placed.counts[k] = place_prop(scene, view, props[placed.numbers[k]], parts)
        join_boxes(parts, placed.counts[k], placed.boxes[k])


@kernel(inlined=True, allocates=False)
def join_boxes(parts, count, box):
    """Fill box [4] with the rectangle around those of the first `count` of placed parts."""
    far = int32(1 << 30)
    c0, c1, r0, r1 = far, int32(0), far, int32(0)
    for k in range(count):
        # An empty rectangle touches nothing.
        if parts[k, C0] < parts[k, C1] and parts[k, R0] < parts[k, R1]:
            c0, c1 = min(c0, int32(parts[k, C0])), max(c1, int32(parts[k, C1]))
            r0, r1 = min(r0, int32(parts[k, R0])), max(r1, int32(parts[k, R1]))
    box[0], box[1], box[2], box[3] = min(c0, c1), c1, min(r0, r1), r1


@kernel
def draw_props(scene, view, props, placed, top, drawn, depth, kind):
    """Set depth and kind [R, W'] where a prop covers half of a pixel; returns the marks [M, MARK_COLUMNS] of all pixels
    that show any of one, near props first.

    placed: the `PlacedProps` of the view. drawn: see `Output`; without colours there are no marks, and for a mask only
    pixels that show water count.
    """
    pixels = pixels_of(placed.boxes, top, len(depth)) if drawn == COLOURS else 0
    marks = np.empty((pixels, MARK_COLUMNS), np.float32)
    met = meet_props(scene, view, props, placed, top, drawn, depth, kind, marks)
    return marks[:met]


@kernel(inlined=True, allocates=False)
def pixels_of(boxes, top, rows):
    """Return how many pixels boxes [K, 4] have together within so many rows from `top` on."""
    pixels = 0
    for k in range(len(boxes)):
        _, _, _, _, size = rows_of_box(boxes[k], top, rows)
        pixels += size
    return pixels


@kernel(inlined=True, allocates=False)
def rows_of_box(box, top, rows):
    """Return the columns from, to of a box and its rows from, to, counted from `top` and within so many rows, and the
    number of pixels."""
    r0 = max(box[2] - int32(top), int32(0))
    r1 = min(box[3] - int32(top), int32(rows))
    return box[0], box[1], r0, r1, max(box[1] - box[0], int32(0)) * max(r1 - r0, int32(0))


@kernel(allocates=False)
def meet_props(scene, view, props, placed, top, drawn, depth, kind, marks):
    """Fill marks, of `draw_props`, and set depth and kind [R, W']; returns how many marks there are."""
    n = 0
    for k in range(len(placed.counts)):
        c0, c1, r0, r1, size = rows_of_box(placed.boxes[k], top, len(depth))
        if size == 0:
            continue
        first = k * models.MOST_PARTS
        parts = placed.parts[first : first + placed.counts[k]]
        own = np.uint8(int32(props[placed.numbers[k], KIND]) + int32(CLASS_OFFSET))
        for r in range(r0, r1):
            touching, c0, c1 = parts_in_row(parts, int32(top) + r, placed.active)
            for c in range(c0, c1):
                if drawn == MASK and kind[r, c] != np.uint8(WATER):
                    continue
                on_water = kind[r, c] == np.uint8(WATER)
                sight = pixel_sight(view.camera, int32(top) + r, c, depth[r, c], on_water)
                layers = no_layers()
                for j in range(touching):
                    part = parts[placed.active[j]]
                    if f32(c) >= part[C0] and f32(c) < part[C1]:
                        layers = with_part(scene, view, part, sight, drawn == COLOURS, layers)
                cover = layers.cover + (f32(1) - layers.cover) * layers.back_cover
                if cover < f32(LEAST_COVER):
                    continue
                at = layers.t if layers.cover >= f32(HALF) * cover else layers.back_t
                shown = cover >= f32(HALF)
                if drawn == COLOURS:
                    mark(marks[n], r, c, cover, layers, depth[r, c], kind[r, c], at, own if shown else np.uint8(0))
                    n += 1
                depth[r, c] = at if shown else depth[r, c]
                kind[r, c] = own if shown else kind[r, c]
    return n


@kernel(inlined=True, allocates=False)
def mark(row, r, c, cover, layers, depth, kind, at, own):
    """Fill a mark [MARK_COLUMNS]."""
    rest = f32(1) - layers.cover
    row[ROW] = f32(r)
    row[COLUMN] = f32(c)
    row[COVER] = cover
    row[RED] = layers.red + rest * layers.back_red
    row[GREEN] = layers.green + rest * layers.back_green
    row[BLUE] = layers.blue + rest * layers.back_blue
    row[DEPTH_BEHIND] = depth
    row[KIND_BEHIND] = f32(int32(kind))
    row[DEPTH] = at
    row[CLASS] = f32(int32(own))


@kernel(inlined=True, allocates=False)
def parts_in_row(parts, row, active):
    """Fill active [MOST_PARTS] with the numbers of the placed parts that may touch a row of the image; returns how many
    there are, and the columns from, to that they may touch."""
    x, low, high = f32(row), int32(1 << 30), int32(0)
    n = 0
    for k in range(len(parts)):
        if x >= parts[k, R0] and x < parts[k, R1] and parts[k, C0] < parts[k, C1]:
            active[n] = k
            n += 1
            low, high = min(low, int32(parts[k, C0])), max(high, int32(parts[k, C1]))
    return n, min(low, high), high


@kernel(inlined=True, allocates=False)
def meet_parts(scene, view, parts, row, column, behind, on_water, coloured):
    """Return the `Layers` of placed parts in a pixel of the image.

    behind: depth of what they are before, which is water if on_water; coloured: whether their radiance counts.
    """
    sight = pixel_sight(view.camera, row, column, behind, on_water)
    layers = no_layers()
    x, y = f32(column), f32(row)
    for k in range(len(parts)):
        if x >= parts[k, C0] and x < parts[k, C1] and y >= parts[k, R0] and y < parts[k, R1]:
            layers = with_part(scene, view, parts[k], sight, coloured, layers)
    return layers


class PixelSight(NamedTuple):
    """The ray through a pixel: its place on the image plane, its direction, and what it meets behind all props."""

    sx: Any
    sy: Any
    x: Any
    """Metres per metre along the optical axis, as the next two."""
    y: Any
    z: Any
    slant: Any
    """Length of that direction."""
    behind: Any
    """Depth of what the ray meets."""
    soft: Any
    """Depth over which that cuts a part."""


@kernel(inlined=True, allocates=False)
def pixel_sight(camera, row, column, behind, on_water):
    """Return the `PixelSight` of a pixel of the image, which meets something, water if on_water, at a depth."""
    sx = image_x(camera, column)
    sy = image_y(camera, row, 1)
    dx, dy, dz = ray_direction(camera, sx, sy)
    # Water cuts a part along a line that is as soft as its other edges: over the depth of one pixel's water.
    soft = behind * row_step(camera) / max(-dz, f32(STEEPEST)) if on_water else f32(1e-6)
    return PixelSight(sx, sy, dx, dy, dz, math.sqrt(f32(1) + sx * sx + sy * sy), behind, soft)


@kernel(inlined=True, allocates=False)
def no_layers():
    """Return `Layers` of nothing."""
    zero = f32(0)
    return Layers(zero, f32(MISS), zero, zero, zero, zero, f32(MISS), zero, zero, zero)


@kernel(inlined=True, allocates=False)
def with_part(scene, view, part, sight, coloured, layers):
    """Return `Layers` with a placed part added if a `PixelSight` meets it."""
    camera = view.camera
    ray = solid_ray(part, camera, sight.sx, sight.sy)
    hit = meet_solid(part[SHAPE], part[TAPER], ray)
    cover = hit.cover * part[FADE]
    cover *= clamp(f32(0.5) + (sight.behind - hit.t) / sight.soft, f32(0), f32(1))
    if hit.t < camera.near_m or cover < f32(LEAST_COVER):
        return layers
    red, green, blue = f32(0), f32(0), f32(0)
    # What stands behind an opaque part needs no colour.
    if coloured and not (layers.cover > f32(0.999) and hit.t > layers.t):
        inverse = f32(1) / sight.slant
        along = sight.x * inverse, sight.y * inverse, sight.z * inverse
        at = camera.x + sight.x * hit.t, camera.y + sight.y * hit.t, camera.z + sight.z * hit.t
        red, green, blue = part_radiance(
            scene, view, part, hit, ray, along, at, hit.t * sight.slant, hit.t * row_step(camera)
        )
    return layered(layers, cover, hit.t, cover * red, cover * green, cover * blue)


@kernel(inlined=True, allocates=False)
def layered(layers, cover, t, red, green, blue):
    """Return `Layers` with one more part: its share of the pixel, depth, and radiance times share.

    Front-to-back compositing (Porter, Duff 1984) of three layers, of which the two farther ones become one.
    """
    front, back = layers.cover, layers.back_cover
    if t < layers.t:
        rest = f32(1) - front
        return Layers(
            cover, t, red, green, blue,
            front + rest * back, layers.t,
            layers.red + rest * layers.back_red, layers.green + rest * layers.back_green,
            layers.blue + rest * layers.back_blue,
        )  # fmt: skip
    before = t < layers.back_t
    rest = f32(1) - (cover if before else back)
    own, old = (f32(1), rest) if before else (rest, f32(1))
    return Layers(
        front, layers.t, layers.red, layers.green, layers.blue,
        own * cover + old * back, min(t, layers.back_t),
        own * red + old * layers.back_red, own * green + old * layers.back_green, own * blue + old * layers.back_blue,
    )  # fmt: skip


@kernel(allocates=False)
def hold_marks(marks, depth, kind, light):
    """Take the props' shares from the light [R, W'] that plants let through, and put back what lies behind them.

    What is shaded afterwards fills the rest of a pixel. depth and kind: [R, W'].
    """
    for k in range(len(marks)):
        r, c = int32(marks[k, ROW]), int32(marks[k, COLUMN])
        marks[k, LIGHT] = light[r, c]
        light[r, c] = light[r, c] * (f32(1) - marks[k, COVER])
    # Backwards, so that the first of several marks of a pixel decides.
    for k in range(len(marks) - 1, -1, -1):
        r, c = int32(marks[k, ROW]), int32(marks[k, COLUMN])
        depth[r, c] = marks[k, DEPTH_BEHIND]
        kind[r, c] = np.uint8(int32(marks[k, KIND_BEHIND]))


@kernel(allocates=False)
def release_marks(marks, rows):
    """Add the radiance of marks to `Buffers` [R, W'] after shading, and undo what `hold_marks` did."""
    for k in range(len(marks)):
        r, c = int32(marks[k, ROW]), int32(marks[k, COLUMN])
        light = marks[k, LIGHT]
        rows.red[r, c] += light * marks[k, RED]
        rows.green[r, c] += light * marks[k, GREEN]
        rows.blue[r, c] += light * marks[k, BLUE]
        if marks[k, CLASS] > f32(0):
            rows.depth[r, c] = marks[k, DEPTH]
            rows.kind[r, c] = np.uint8(int32(marks[k, CLASS]))
    for k in range(len(marks) - 1, -1, -1):
        rows.transmittance[int32(marks[k, ROW]), int32(marks[k, COLUMN])] = marks[k, LIGHT]
