"""The kernel that draws plants over rows without colours, or only as much of them as a water mask needs."""

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.plants.draw import draw_in_order, empty_scratch
from thalweg.render.kernels.plants.reduced_billboard import ROWS
from thalweg.render.kernels.plants.tiles import empty_cover, load_depths, store_tiles
from thalweg.render.records.classes import WATER

f32 = np.float32


@kernel
def draw_layers(scene, view, top, reduced, only_mask, buffers):
    """Fill transmittance and plant depth of `Buffers` [R, W'] with those of the plants, for rows from `top` on.

    Depth and kind must already hold what lies behind the plants. With only_mask, just what hides water is drawn: the
    rest keeps its light.
    """
    behind = np.empty(buffers.depth.shape, np.float32)
    asked_depth(buffers.depth, buffers.kind, only_mask, behind)
    together = ROWS if reduced else 1
    tiles = empty_cover(len(behind), buffers.depth.shape[1], together)
    load_depths(behind, view.camera.width, together, tiles)
    work = empty_scratch(scene, view.world, len(tiles.deepest))
    draw_in_order(scene, view, top, reduced, False, tiles, work)
    store_tiles(tiles, together, False, buffers)


@kernel(disjoint=True, allocates=False)
def asked_depth(depth, kind, only_mask, behind):
    """Fill behind [R, W'] with the depth of the pixels that are asked for, 0 at the others."""
    for r in range(depth.shape[0]):
        for c in range(depth.shape[1]):
            asked = (kind[r, c] == np.uint8(WATER)) | (not only_mask)
            behind[r, c] = depth[r, c] if asked else f32(0)
