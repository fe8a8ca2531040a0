"""How do many frames come about at once? Each thread draws whole frames, or all share one by bands of rows.

A row has the same bits either way, so that the number of threads and frames shows nowhere.
"""

import numpy as np
from numba import int64, prange

from thalweg.kernel import kernel
from thalweg.render.eye import eye_of
from thalweg.render.frame import ROWS_TOGETHER, draw_rows, finish_frame, open_planes

f32 = np.float32


@kernel(parallel=True)
def draw_frames(scene, world_index, poses, times, looks, camera, images, want_layers, depths, classes, bands):
    """Draw one frame per pose, each with its look [N, LOOK_COLUMNS]: images [N, H, W] uint32.

    camera: (height, width, near plane in float32 metres, whether the quality is the modest one). An image holds red,
    green, blue from the lowest byte up, the water mask in the highest. depths and classes are [N, H, W] where wanted,
    else [1, 1, 1]. bands [B, 2] int32: the rows from, to that a thread draws together. With one band a thread draws
    whole frames; more are for fewer frames than threads.
    """
    views = (world_index, poses, times, looks)
    out = (images, want_layers, depths, classes)
    whole = len(bands) == 1
    rounds = 1 if whole else len(poses)
    parts = len(poses) if whole else len(bands)
    for turn in range(rounds):
        planes = open_planes(0 if whole else camera[0], camera[1])
        # One loop for both ways: a second would be compiled once more, with all that it calls.
        for part in prange(parts):
            draw_part(scene, views, camera, out, bands, planes, int64(turn), int64(part))
        if not whole:
            draw_part(scene, views, camera, out, bands, planes, int64(turn), int64(parts))


@kernel
def draw_part(scene, views, camera, out, bands, shared, turn, part):
    """With one band: draw frame number `part`. With more: draw that band of frame number `turn` into shared planes, or
    finish the frame, where `part` is the number of bands."""
    world_index, poses, times, looks = views
    images, want_layers, depths, classes = out
    whole = len(bands) == 1
    n = part if whole else turn
    band = 0 if whole else part
    planes = open_planes(camera[0], camera[1]) if whole else shared
    w = world_index[n]
    time = f32(times[n])
    eye = eye_of(poses[n], looks[n], camera)
    if band < len(bands):
        draw_rows(scene, w, looks[n], eye, time, camera, bands[band, 0], bands[band, 1], planes)
    if whole or band == len(bands):
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
