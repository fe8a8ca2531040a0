"""Plants at a pixel: billboards that all pixels of a tile share, blended from near to far.

The threads of a block walk the list of plants together, as many at a time as there are threads: each looks at one plant
and, if its billboard touches the tile, sets the plant's bit and puts what all pixels of it share into shared memory.
They stop once no pixel lets light through any more, or each shows ground nearer than all plants that are left.
"""

import numpy as np
from numba import cuda, float32, int32, uint32

from thalweg.core.compute.jit import kernel
from thalweg.render.gpu.shared_billboards import (
    SHARED_FLOATS,
    SHARED_INTS,
    billboard_light,
    share_billboard,
    shared_billboard,
)
from thalweg.render.gpu.tile import THREADS, WORD, WORDS, touches_tile
from thalweg.render.kernels.camera_rays import row_step
from thalweg.render.kernels.plants import billboard, reduced_billboard
from thalweg.render.kernels.plants.billboard import make_billboard, nearest_depth
from thalweg.render.kernels.terrain.primary_hits import MISS
from thalweg.render.records import layout

f32 = np.float32


@kernel(inlined=True)
def blend_plants(scene, view, plants, n, corner, r, asked, closed, reduced, rays, depth):
    """Return the red, green and blue that plants add to a pixel, the light that they let through, and their depth.

    corner: row and column of the tile's first pixel; asked: whether the pixel counts; closed: light at which it no
    longer does.
    """
    order, distance, boxes, counts = plants
    tile_r, tile_c = corner
    camera = view.camera
    thread = cuda.threadIdx.x
    sharpen = f32(reduced_billboard.SHARPEN) if reduced else f32(billboard.SHARPEN)
    cell = f32(1) / scene.constants[view.world, layout.INV_CELL]
    # In the reduced quality two rows share their texels and look through the middle between them.
    off = f32(0)
    if reduced:
        off = (f32(r % reduced_billboard.ROWS) - f32(0.5 * reduced_billboard.ROWS - 0.5)) * row_step(camera)
    dx = rays.x[0] * cell + off * camera.up_x
    dy = rays.y[0] * cell + off * camera.up_y
    dz = rays.z[0] + off * camera.up_z
    red = f32(0)
    green = f32(0)
    blue = f32(0)
    light = f32(1)
    plant_depth = f32(MISS)
    floats = cuda.shared.array((SHARED_FLOATS, THREADS), float32)
    ints = cuda.shared.array((SHARED_INTS, THREADS), int32)
    touched = cuda.shared.array(WORDS, uint32)
    first_plant = scene.extents[view.world, layout.PLANT_FROM]
    total = counts[n]
    for first in range(0, total, THREADS):
        # The whole block stops together: a vote says whether any of its pixels still shows plants.
        nearest = nearest_depth(distance[n, order[n, first]], camera)
        if thread < WORDS:
            touched[thread] = uint32(0)
        if cuda.syncthreads_or(int32(asked and light > f32(0) and depth[0] > nearest)) == 0:
            break
        k = first + thread
        touching = k < total and touches_tile(boxes, n, k, tile_r, tile_c)
        if touching:
            cuda.atomic.or_(touched, thread // WORD, uint32(uint32(1) << uint32(thread % WORD)))
            # Each thread prepares one billboard, and all threads then draw it from shared memory.
            p = order[n, k]
            share_billboard(make_billboard(scene, view, first_plant + p, distance[n, p], sharpen), floats, ints, thread)
        cuda.syncthreads()
        # Only the plants that touch the tile are visited: a camera sees a thousand, a tile a few of them.
        for word in range(WORDS):
            bits = touched[word]
            # The same branch for all threads of the block, so that none waits for another.
            while bits != uint32(0):
                board = shared_billboard(floats, ints, word * WORD + cuda.ffs(bits) - 1)
                bits = uint32(bits & uint32(bits - uint32(1)))  # without the lowest one
                add_r, add_g, add_b, part, t = billboard_light(
                    scene.atlas, board, dx, dy, dz, camera.near_m, depth[0], light, closed, reduced
                )  # fmt: skip
                red += add_r
                green += add_g
                blue += add_b
                rest = light - part
                plant_depth = t if light >= f32(0.5) and rest < f32(0.5) else plant_depth
                light = rest
        # Shared memory is written anew in the next round, so all must be done with it.
        cuda.syncthreads()
    return red, green, blue, light, plant_depth
