"""How do many frames come about at once? Each thread draws whole frames, or all share one by bands of rows.

A row has the same bits either way, so that the number of threads and frames shows nowhere.
"""

from functools import partial

import numpy as np

from thalweg.core.jit import kernel
from thalweg.core.threads import run_in_threads
from thalweg.render.kernels.camera_rays import eye_of
from thalweg.render.kernels.frame import ROWS_TOGETHER, draw_rows, finish_frame, open_planes

f32 = np.float32

WHOLE, BANDS, FINISH = range(3)
"""What each thread does in turn: draw whole frames; draw bands of rows of them; turn drawn planes into pictures."""


def draw(scene, world_index, poses, times, looks, camera, images, want_layers, depths, classes, bands) -> None:
    """Draw one frame per pose, each with its look [N, LOOK_COLUMNS]: images [N, H, W] uint32.

    camera: (height, width, near plane in float32 metres, whether the quality is the modest one). An image holds red,
    green, blue from the lowest byte up, the water mask in the highest. depths and classes are [N, H, W] where wanted,
    else [1, 1, 1]. bands [B, 2] int32: the rows from, to that a thread draws together. With one band a thread draws
    whole frames; more are for fewer frames than threads.
    """
    views = world_index, poses, times, looks
    out = images, want_layers, depths, classes
    whole = len(bands) == 1
    planes = shared_planes(0 if whole else len(poses), *camera[:2])
    for stage in (WHOLE,) if whole else (BANDS, FINISH):
        jobs = len(poses) * (len(bands) if stage == BANDS else 1)
        run_in_threads(jobs, partial(draw_jobs, scene, views, camera, out, bands, planes, stage))


def shared_planes(count: int, height: int, width: int) -> tuple[np.ndarray, ...]:
    """The planes of `open_planes` for each of `count` frames, [count, H', W']."""
    return tuple(np.repeat(plane[None], count, axis=0) for plane in open_planes(height, width))


@kernel
def draw_jobs(scene, views, camera, out, bands, planes, stage, first, last):
    """Numbers first to last of the jobs of one stage of `draw`: frames, or bands of rows, frame after frame.

    views: world_index [N], poses [N, 4], times [N] in seconds, looks [N, LOOK_COLUMNS]; out: images, want_layers,
    depths, classes; planes: of `shared_planes`, of no frame for whole frames.
    """
    world_index, poses, times, looks = views
    images, want_layers, depths, classes = out
    for job in range(first, last):
        n = job // len(bands) if stage == BANDS else job
        band = job % len(bands) if stage == BANDS else 0
        w = world_index[n]
        time = f32(times[n])
        eye = eye_of(poses[n], looks[n], camera)
        if stage == WHOLE:
            own = open_planes(camera[0], camera[1])
        else:
            own = planes[0][n], planes[1][n], planes[2][n], planes[3][n], planes[4][n], planes[5][n], planes[6][n]
        if stage != FINISH:
            draw_rows(scene, w, looks[n], eye, time, camera, bands[band, 0], bands[band, 1], own)
        if stage != BANDS:
            layer = n % len(depths)
            finish_frame(
                scene, w, looks[n], eye, time, camera, own, images[n], want_layers, depths[layer], classes[layer]
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
