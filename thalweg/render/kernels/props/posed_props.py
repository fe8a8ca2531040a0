"""Kernels that pose the props of a frame: those in view, near to far, and the rectangles of pixels they may touch."""

from typing import Any, NamedTuple

import numpy as np
from numba import int32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.props import models
from thalweg.render.kernels.props.boxes import rows_of_box
from thalweg.render.kernels.props.pose import C0, C1, PART_COLUMNS, R0, R1, pose_prop, sort_in_view


class PosedProps(NamedTuple):
    """The props in view of a frame, near to far, K of them."""

    parts: Any
    """[K * MOST_PARTS, PART_COLUMNS] float32; those of prop k begin at k * MOST_PARTS."""
    counts: Any
    """[K] int32, parts of each."""
    numbers: Any
    """[K] int32, which of the frame's props each is."""
    boxes: Any
    """[K, 4] int32, columns from, to and rows from, to of the image that each may touch."""


@kernel
def pose_props(scene, view, props):
    """Return the `PosedProps` of a view; props: [P, PROP_COLUMNS]."""
    order = np.empty(len(props), np.int32)
    count = sort_in_view(props, view.camera, order, np.empty(len(props), np.float32))
    posed = PosedProps(
        np.empty((count * models.MOST_PARTS, PART_COLUMNS), np.float32),
        np.empty(count, np.int32), order[:count], np.empty((count, 4), np.int32),
    )  # fmt: skip
    pose_in_order(scene, view, props, posed)
    return posed


@kernel(inlined=True, allocates=False)
def pose_in_order(scene, view, props, posed):
    """Fill the parts, counts and boxes of `PosedProps` whose numbers are there."""
    for k in range(len(posed.counts)):
        first = k * models.MOST_PARTS
        parts = posed.parts[first : first + models.MOST_PARTS]
        posed.counts[k] = pose_prop(scene, view, props[posed.numbers[k]], parts)
        join_boxes(parts, posed.counts[k], posed.boxes[k])


@kernel(inlined=True, allocates=False)
def join_boxes(parts, count, box):
    """Fill box [4] with the rectangle around those of the first `count` of posed parts."""
    far = int32(1 << 30)
    c0, c1, r0, r1 = far, int32(0), far, int32(0)
    for k in range(count):
        # An empty rectangle touches nothing.
        if parts[k, C0] < parts[k, C1] and parts[k, R0] < parts[k, R1]:
            c0, c1 = min(c0, int32(parts[k, C0])), max(c1, int32(parts[k, C1]))
            r0, r1 = min(r0, int32(parts[k, R0])), max(r1, int32(parts[k, R1]))
    box[0], box[1], box[2], box[3] = min(c0, c1), c1, min(r0, r1), r1


@kernel(inlined=True, allocates=False)
def pixels_of(boxes, top, rows):
    """Return how many pixels boxes [K, 4] have together within so many rows from `top` on."""
    pixels = 0
    for k in range(len(boxes)):
        _, _, _, _, size = rows_of_box(boxes[k], top, rows)
        pixels += size
    return pixels
