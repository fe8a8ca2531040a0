"""Kernels that look up the image of a lens in an undistorted frame."""

import numpy as np
from numba import int32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.table_lookup import clamp
from thalweg.render.kernels.terrain.primary_hits import MISS
from thalweg.render.records.view import COLOURS

f32 = np.float32

STEEPEST = 1.25
"""Greatest ratio of depths between which a surface is taken to go on: a hill before another has a greater one."""


@kernel(allocates=False)
def look_through(places, drawn, wide, image):
    """Fill `Buffers` image [H', W'] from those of a wide frame.

    places: [H, W, 6] float32 of `WideFrame`. drawn: see `Output`. Colours are the mean of four rays, each between four
    texels; kind and plants are those of the texel nearest to the pixel's centre, so that class and mask stay one thing
    or the other.
    """
    if drawn == COLOURS:
        mean_colours(places, wide, image)
    for r in range(places.shape[0]):
        for c in range(places.shape[1]):
            y = inside(places[r, c, 0], wide.kind.shape[0])
            x = inside(places[r, c, 1], wide.kind.shape[1])
            near_r = int32(y + f32(0.5))
            near_c = int32(x + f32(0.5))
            image.kind[r, c] = wide.kind[near_r, near_c]
            image.transmittance[r, c] = wide.transmittance[near_r, near_c]
            image.plant_depth[r, c] = wide.plant_depth[near_r, near_c]
            image.depth[r, c] = depth_between(wide, y, x, near_r, near_c)


@kernel(inlined=True, allocates=False)
def inside(place, size):
    """Return a place along `size` texels, moved to where there are texels on both sides."""
    # A margin holds all places; only a bulge between the knots where a lens is measured could reach beyond it.
    return clamp(place, f32(0), f32(size) - f32(1.01))


@kernel(inlined=True, allocates=False)
def depth_between(wide, y, x, near_r, near_c):
    """Return the depth of `Buffers` at row y and column x: between four texels of one surface, else that of the nearest
    texel (near_r, near_c)."""
    r = int32(y)
    c = int32(x)
    a, b, d, e = wide.depth[r, c], wide.depth[r, c + 1], wide.depth[r + 1, c], wide.depth[r + 1, c + 1]
    kind = wide.kind[r, c]
    same = (wide.kind[r, c + 1] == kind) & (wide.kind[r + 1, c] == kind) & (wide.kind[r + 1, c + 1] == kind)
    nearest = min(min(a, b), min(d, e))
    furthest = max(max(a, b), max(d, e))
    if (not same) | (furthest >= f32(MISS)) | (furthest > f32(STEEPEST) * nearest):
        return wide.depth[near_r, near_c]
    down = y - f32(r)
    right = x - f32(c)
    # The inverse of the depth of a plane is linear over an undistorted image.
    above = (f32(1) - right) / a + right / b
    below = (f32(1) - right) / d + right / e
    return f32(1) / ((f32(1) - down) * above + down * below)


@kernel(disjoint=True, allocates=False)
def mean_colours(places, wide, image):
    """Fill the radiance of `Buffers` image [H', W'] with the mean of the four rays of each pixel."""
    for r in range(places.shape[0]):
        for c in range(places.shape[1]):
            red = f32(0)
            green = f32(0)
            blue = f32(0)
            for k in range(4):
                along = f32(1) if k % 2 == 1 else f32(-1)
                across = f32(1) if k > 1 else f32(-1)
                y = places[r, c, 0] + along * places[r, c, 2] + across * places[r, c, 4]
                x = places[r, c, 1] + along * places[r, c, 3] + across * places[r, c, 5]
                y = inside(y, wide.red.shape[0])
                x = inside(x, wide.red.shape[1])
                top = int32(y)
                left = int32(x)
                down = y - f32(top)
                right = x - f32(left)
                for corner in range(4):
                    i = top + corner // 2
                    j = left + corner % 2
                    part = down if corner > 1 else f32(1) - down
                    part *= right if corner % 2 == 1 else f32(1) - right
                    red += part * wide.red[i, j]
                    green += part * wide.green[i, j]
                    blue += part * wide.blue[i, j]
            image.red[r, c] = f32(0.25) * red
            image.green[r, c] = f32(0.25) * green
            image.blue[r, c] = f32(0.25) * blue
