"""How do many frames come about at once? Each thread draws whole frames, or all share one by bands of rows.

A row has the same bits either way, so that the number of threads and frames shows nowhere.
"""

import numpy as np
from numba import prange

from thalweg.kernel import kernel
from thalweg.render.frame import ROWS_TOGETHER, draw_rows, eye_of, finish_frame, open_planes

f32 = np.float32


@kernel(parallel=True)
def draw_frames(scene, world_index, poses, times, looks, camera, images, want_layers, depths, classes, bands):
    """Draw one frame per pose, each with its look [N, LOOK_COLUMNS]: images [N, H, W] uint32.

    camera: (height, width, near plane in float32 metres, whether the quality is the modest one). An image holds red,
    green, blue from the lowest byte up, the water mask in the highest. depths and classes are [N, H, W] where wanted,
    else [1, 1, 1]. bands [B, 2] int32: the rows from, to that a thread draws together. With one band a thread draws
    whole frames; more are for fewer frames than threads.
    """
    height, width, _, _ = camera
    if len(bands) == 1:
        for n in prange(len(poses)):
            w = world_index[n]
            eye = eye_of(poses[n], looks[n], camera)
            time = f32(times[n])
            planes = open_planes(height, width)
            draw_rows(scene, w, looks[n], eye, time, camera, 0, height, planes)
            layer = n % len(depths)
            finish_frame(
                scene, w, looks[n], eye, time, camera, planes, images[n], want_layers, depths[layer], classes[layer]
            )  # fmt: skip
    else:
        for n in range(len(poses)):
            w = world_index[n]
            eye = eye_of(poses[n], looks[n], camera)
            time = f32(times[n])
            planes = open_planes(height, width)
            for b in prange(len(bands)):
                draw_rows(scene, w, looks[n], eye, time, camera, bands[b, 0], bands[b, 1], planes)
            layer = n % len(depths)
            finish_frame(
                scene, w, looks[n], eye, time, camera, planes, images[n], want_layers, depths[layer], classes[layer]
            )  # fmt: skip


def bands_of(height: int, threads: int, frames: int) -> np.ndarray:
    """The rows from, to [B, 2] int32 in which `threads` threads share a frame; one band where there are enough frames.

    A thread gets two neighbouring bands of the list: one from above and one from below, since the far woods above take
    longer than the water below.
    """
    if threads <= frames or height < 2 * ROWS_TOGETHER:
        return np.array([[0, height]], np.int32)
    count = min(2 * threads, height // ROWS_TOGETHER)
    edges = np.round(np.linspace(0, height / ROWS_TOGETHER, count + 1)).astype(np.int32) * ROWS_TOGETHER
    edges[-1] = height
    bands = np.stack([edges[:-1], edges[1:]], axis=1)
    order = [k // 2 if k % 2 == 0 else count - 1 - k // 2 for k in range(count)]
    return np.ascontiguousarray(bands[order])
