"""GPU kernels that turn a frame's buffers into an image: edges of bridges, exposure, tone mapping; and into layers."""

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import cuda, float32, uint8, uint32

from thalweg.core.compute.jit import kernel
from thalweg.render.batch import buffers_of
from thalweg.render.gpu.visible_plants import stored_camera
from thalweg.render.kernels.bridge_edges import beside_edge, edge_colour
from thalweg.render.kernels.shading import tone
from thalweg.render.kernels.terrain.primary_hits import MISS
from thalweg.render.records import classes
from thalweg.render.records.view import View

f32 = np.float32

THREADS = 128
"""Threads of a block in all kernels here; a power of two."""


@cache
def adder(reduced: bool) -> Callable:
    """Return the kernel that adds up a frame's light for the exposure; in full quality it antialiases bridges first."""

    def add_up(scene, views, cameras, buffers, softened, gains):
        """One block a camera: radiance [3, N, H, W] with antialiased edges, and the factor of the exposure [N].

        buffers: of `pixel.tracer`. In the reduced quality nothing is antialiased or written to `softened`.
        """
        n = cuda.blockIdx.x
        thread = cuda.threadIdx.x
        height, width = buffers.kind.shape[1:]
        frame = buffers_of(buffers, n)
        view = View(views.world_index[n], views.looks[n], stored_camera(cameras, n, height, width), f32(0))
        sums = cuda.shared.array(THREADS, float32)
        total = f32(0)
        # Neighbouring threads take neighbouring pixels, so that their reads fall together.
        for k in range(thread, height * width, THREADS):
            r = k // width
            c = k % width
            a = frame.red[r, c]
            b = frame.green[r, c]
            d = frame.blue[r, c]
            if not reduced:
                # Few pixels lie beside an edge, and the test needs only classes.
                if beside_edge(frame.kind, r, c, width) == 1:
                    a, b, d = edge_colour(scene, view, frame, r, c)
                softened[0, n, r, c] = a
                softened[1, n, r, c] = b
                softened[2, n, r, c] = d
            total += min(tone.luminance(a, b, d), f32(tone.BRIGHTEST))
        # A tree of sums in shared memory, half as many threads in each round.
        sums[thread] = total
        half = THREADS // 2
        while half > 0:
            # All sums of the last round must be written before any is read.
            cuda.syncthreads()
            if thread < half:
                sums[thread] += sums[thread + half]
            half //= 2
        if thread == 0:
            gains[n] = tone.exposure(sums[0] / f32(height * width))

    return add_up


def tone_map(radiance, kind, light, looks, keys, gains, codes, images):
    """One thread a pixel (x) of a camera (y): images [N, H, W] uint32, with the water mask in the top byte.

    `Radiance`, kind, light [N, H, W]; keys [N] uint32: what the noise depends on; codes: `tone.CODE_TABLE`.
    """
    n = cuda.blockIdx.y
    k = cuda.blockIdx.x * THREADS + cuda.threadIdx.x
    height, width = kind.shape[1:]
    if k >= height * width:
        return
    r = k // width
    c = k % width
    pixel = tone.tone_pixel(
        codes, radiance.red[n, r, c], radiance.green[n, r, c], radiance.blue[n, r, c],
        gains[n] * looks[n, tone.GAIN_R], gains[n] * looks[n, tone.GAIN_G], gains[n] * looks[n, tone.GAIN_B],
        mask_of(kind[n, r, c], light[n, r, c]),
    )  # fmt: skip
    # The hash counts pixels as the CPU does, so that both add the same noise.
    if looks[n, tone.NOISE] > f32(0):
        pixel = tone.noisy(pixel, looks[n, tone.NOISE], tone.scramble(uint32(keys[n] + uint32(k))))
    images[n, r, c] = pixel


def write_layers(buffers, depths, kinds, masks):
    """One thread a pixel (x) of a camera (y): metres along the axis (-1: sky), class, 255 for water, all [N, H, W]."""
    n = cuda.blockIdx.y
    k = cuda.blockIdx.x * THREADS + cuda.threadIdx.x
    height, width = buffers.kind.shape[1:]
    if k >= height * width:
        return
    # Pixels are numbered row by row, so that a block of threads writes one stretch of memory.
    r = k // width
    c = k % width
    kind = buffers.kind[n, r, c]
    light = buffers.transmittance[n, r, c]
    seen = min(buffers.depth[n, r, c], buffers.plant_depth[n, r, c])
    depths[n, r, c] = f32(-1) if seen >= f32(MISS) else seen
    kinds[n, r, c] = kind if light > f32(0.5) else uint8(classes.PLANT)
    masks[n, r, c] = mask_of(kind, light)


def write_mask(buffers, masks):
    """One thread a pixel (x) of a camera (y): 255 for water, else 0, in masks [N, H, W] uint8."""
    n = cuda.blockIdx.y
    k = cuda.blockIdx.x * THREADS + cuda.threadIdx.x
    height, width = buffers.kind.shape[1:]
    if k >= height * width:
        return
    r = k // width
    c = k % width
    masks[n, r, c] = mask_of(buffers.kind[n, r, c], buffers.transmittance[n, r, c])


@kernel(inlined=True)
def mask_of(kind, light):
    """Return 255 where water is seen, else 0."""
    return uint32(255) if kind == classes.WATER and light > f32(0.5) else uint32(0)
