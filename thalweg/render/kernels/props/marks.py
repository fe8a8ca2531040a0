"""Kernels for marks: what pixels show of props, which is kept apart while all the rest of the frame is shaded."""

import numpy as np
from numba import int32, uint32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.props.layers import total_radiance

f32 = np.float32

# Columns of a mark, which is a pixel that shows some of a prop: where it is, the share that the prop covers, its
# radiance times that share, what the pixel showed before (depth, class), the prop's depth and class (0 where it covers
# less than half), and the light that plants let through, which is known later.
ROW, COLUMN, COVER, RED, GREEN, BLUE, DEPTH_BEHIND, KIND_BEHIND, DEPTH, CLASS, LIGHT = range(11)
MARK_COLUMNS = 11


@kernel(inlined=True, allocates=False)
def mark(row, r, c, cover, layers, depth, kind, at, own):
    """Fill a mark [MARK_COLUMNS]."""
    row[ROW] = f32(r)
    row[COLUMN] = f32(c)
    row[COVER] = cover
    row[RED], row[GREEN], row[BLUE] = total_radiance(layers)
    row[DEPTH_BEHIND] = depth
    row[KIND_BEHIND] = f32(int32(kind))
    row[DEPTH] = at
    row[CLASS] = f32(int32(own))


@kernel(inlined=True, allocates=False)
def marked_pixel(row):
    """Return the row and the column of the pixel of a mark [MARK_COLUMNS]."""
    # Without a sign, as all places of pixels here: an index that might be negative takes longer.
    return uint32(int32(row[ROW])), uint32(int32(row[COLUMN]))


@kernel(allocates=False)
def hold_marks(marks, depth, kind, light):
    """Take the props' shares from the light [R, W'] that plants let through, and put back what lies behind them.

    What is shaded afterwards fills the rest of a pixel. depth and kind: [R, W'].
    """
    for k in range(len(marks)):
        r, c = marked_pixel(marks[k])
        marks[k, LIGHT] = light[r, c]
        light[r, c] = light[r, c] * (f32(1) - marks[k, COVER])
    # Backwards, so that the first of several marks of a pixel decides.
    for k in range(len(marks) - 1, -1, -1):
        r, c = marked_pixel(marks[k])
        depth[r, c] = marks[k, DEPTH_BEHIND]
        kind[r, c] = np.uint8(int32(marks[k, KIND_BEHIND]))


@kernel(allocates=False)
def release_marks(marks, rows):
    """Add the radiance of marks to `Buffers` [R, W'] after shading, and undo what `hold_marks` did."""
    for k in range(len(marks)):
        r, c = marked_pixel(marks[k])
        light = marks[k, LIGHT]
        rows.red[r, c] += light * marks[k, RED]
        rows.green[r, c] += light * marks[k, GREEN]
        rows.blue[r, c] += light * marks[k, BLUE]
        if marks[k, CLASS] > f32(0):
            rows.depth[r, c] = marks[k, DEPTH]
            rows.kind[r, c] = np.uint8(int32(marks[k, CLASS]))
    for k in range(len(marks) - 1, -1, -1):
        r, c = marked_pixel(marks[k])
        rows.transmittance[r, c] = marks[k, LIGHT]
