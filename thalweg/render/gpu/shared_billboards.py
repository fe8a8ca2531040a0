"""Billboards in the shared memory of a block of threads, each of which draws one pixel of a tile."""

import numpy as np
from numba import int32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.plants import billboard, reduced_billboard
from thalweg.render.kernels.plants.billboard import Billboard

f32 = np.float32

SHARED_FLOATS, SHARED_INTS = 19, 4
"""Numbers of a billboard that all its pixels share."""


@kernel(inlined=True)
def share_billboard(board, floats, ints, thread):
    """Put a `Billboard` into column `thread` of shared memory."""
    (
        floats[0, thread], floats[1, thread], floats[2, thread], floats[3, thread], floats[4, thread],
        floats[5, thread], ints[0, thread], ints[1, thread], ints[2, thread], floats[6, thread], floats[7, thread],
        floats[8, thread], floats[9, thread], floats[10, thread], floats[11, thread], floats[12, thread],
        floats[13, thread], floats[14, thread], floats[15, thread], floats[16, thread], floats[17, thread],
        floats[18, thread], ints[3, thread], _,
    ) = board  # fmt: skip


@kernel(inlined=True)
def shared_billboard(floats, ints, j):
    """Return the `Billboard` in column j of shared memory."""
    return Billboard(
        floats[0, j], floats[1, j], floats[2, j], floats[3, j], floats[4, j], floats[5, j],
        ints[0, j], ints[1, j], ints[2, j], floats[6, j], floats[7, j], floats[8, j], floats[9, j], floats[10, j],
        floats[11, j], floats[12, j], floats[13, j], floats[14, j], floats[15, j], floats[16, j],
        floats[17, j], floats[18, j], ints[3, j],
        # A pixel needs no outline: it looks at its own texel.
        int32(0),
    )  # fmt: skip


@kernel(inlined=True)
def billboard_light(atlas, board, dx, dy, dz, near, ground_depth, light, closed, reduced):
    """Return what `billboard.billboard_pixel` does, in either quality."""
    if reduced:
        ink_r, ink_g, ink_b, ink, t = reduced_billboard.billboard_pixel(atlas, board, dx, dy, dz, near)
        # The reduced pixel leaves visibility to its caller, because on the CPU two rows share it.
        part = billboard.stopped(light, ink if t < ground_depth else f32(0), closed)
        return part * ink_r, part * ink_g, part * ink_b, part, t
    blended = board.blend > f32(0)
    return billboard.billboard_pixel(atlas, board, dx, dy, dz, near, ground_depth, light, closed, blended)
