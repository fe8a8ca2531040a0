"""How do a frame's planes become a picture on a GPU? Outlines of bridges, exposure, codes; and layers where wanted."""

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import cuda, float32, uint8, uint32

from thalweg.core.jit import kernel
from thalweg.render.kernels import bridge_edges as outlines
from thalweg.render.kernels.primary_hits import MISS
from thalweg.render.kernels.shading import tone
from thalweg.render.records import classes

f32 = np.float32

THREADS = 128
"""A block's, in all kernels here; a power of two."""


@cache
def adder(fast: bool) -> Callable:
    """The kernel that adds up a frame's light; in the full quality it mixes the outlines of bridges first."""

    def add_up(scene, world_index, looks, eyes, planes, softened, gains):
        """One block a camera: light [3, N, H, W] with softened outlines, and the factor of the exposure [N].

        planes: of `pixel.tracer`. With the modest quality nothing is softened, and nothing written to `softened`.
        """
        n = cuda.blockIdx.x
        thread = cuda.threadIdx.x
        depth, kind, red, green, blue, light, _ = planes
        height, width = kind.shape[1:]
        w = world_index[n]
        eye = (
            eyes[n, 0], eyes[n, 1], eyes[n, 2], eyes[n, 3], eyes[n, 4], eyes[n, 5], eyes[n, 6], eyes[n, 7],
            eyes[n, 8], eyes[n, 9], eyes[n, 10], eyes[n, 11], eyes[n, 12], eyes[n, 13], eyes[n, 14],
        )  # fmt: skip
        sums = cuda.shared.array(THREADS, float32)
        total = f32(0)
        for k in range(thread, height * width, THREADS):
            r = k // width
            c = k % width
            if fast:
                a = red[n, r, c]
                b = green[n, r, c]
                d = blue[n, r, c]
            else:
                _, a, b, d = outlines.edge_colour(
                    scene, w, looks[n], eye, width, depth[n], kind[n], light[n], red[n], green[n], blue[n], r, c
                )
                softened[0, n, r, c] = a
                softened[1, n, r, c] = b
                softened[2, n, r, c] = d
            total += min(tone.luminance(a, b, d), f32(tone.BRIGHTEST))
        sums[thread] = total
        half = THREADS // 2
        while half > 0:
            cuda.syncthreads()
            if thread < half:
                sums[thread] += sums[thread + half]
            half //= 2
        if thread == 0:
            gains[n] = tone.exposure(sums[0] / f32(height * width))

    return add_up


def develop(red, green, blue, kind, light, looks, keys, gains, codes, images):
    """One thread a pixel (x) of a camera (y): images [N, H, W] uint32, the water mask on top.

    red, green, blue, kind, light [N, H, W]; keys [N] uint32: what the noise depends on; codes: `tone.CODE_TABLE`.
    """
    n = cuda.blockIdx.y
    k = cuda.blockIdx.x * THREADS + cuda.threadIdx.x
    height, width = kind.shape[1:]
    if k >= height * width:
        return
    r = k // width
    c = k % width
    pixel = tone.tone_pixel(
        codes, red[n, r, c], green[n, r, c], blue[n, r, c],
        gains[n] * looks[n, tone.GAIN_R], gains[n] * looks[n, tone.GAIN_G], gains[n] * looks[n, tone.GAIN_B],
        mask_of(kind[n, r, c], light[n, r, c]),
    )  # fmt: skip
    if looks[n, tone.NOISE] > f32(0):
        pixel = tone.noisy(pixel, looks[n, tone.NOISE], tone.scramble(uint32(keys[n] + uint32(k))))
    images[n, r, c] = pixel


def layers(depth, kind, light, solid, depths, kinds, masks):
    """One thread a pixel (x) of a camera (y), all [N, H, W]: metres along the axis (-1: sky), class, and 255 for water
    as in an image's top byte."""
    n = cuda.blockIdx.y
    k = cuda.blockIdx.x * THREADS + cuda.threadIdx.x
    height, width = kind.shape[1:]
    if k >= height * width:
        return
    r = k // width
    c = k % width
    seen = min(depth[n, r, c], solid[n, r, c])
    depths[n, r, c] = f32(-1) if seen >= f32(MISS) else seen
    kinds[n, r, c] = kind[n, r, c] if light[n, r, c] > f32(0.5) else uint8(classes.PLANT)
    masks[n, r, c] = mask_of(kind[n, r, c], light[n, r, c])


@kernel(inlined=True)
def mask_of(kind, light):
    """255 where water is seen, else 0."""
    return uint32(255) if kind == classes.WATER and light > f32(0.5) else uint32(0)
