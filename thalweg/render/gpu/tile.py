"""The tile of pixels that a block of threads draws, one a thread, and words with one bit for each thread."""

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.terrain.heightfield_march import TILE

THREADS = TILE * TILE
WORD = 32
"""Bits of a word."""
WORDS = THREADS // WORD
"""Words with one bit for each thread of a block."""


@kernel(inlined=True)
def touches_tile(boxes, n, k, tile_r, tile_c):
    """Return whether the k-th box of camera n overlaps a tile."""
    return (
        boxes[n, k, 0] < tile_c + TILE
        and boxes[n, k, 1] > tile_c
        and boxes[n, k, 2] < tile_r + TILE
        and boxes[n, k, 3] > tile_r
    )
