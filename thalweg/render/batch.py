"""Drawing of many frames at once: each thread draws whole frames, or all threads share one by bands of rows.

A row has the same bits either way, so that the numbers of threads and frames change nothing.
"""

from functools import partial

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.core.compute.threads import run_in_threads
from thalweg.render.kernels.camera_rays import pose_camera
from thalweg.render.kernels.frame import draw_rows, empty_buffers, finish_frame
from thalweg.render.kernels.shading.background import ROWS_TOGETHER
from thalweg.render.records.props import NO_PROPS
from thalweg.render.records.scene import Scene
from thalweg.render.records.view import Buffers, FrameSettings, Output, View, Views

f32 = np.float32

FRAMES, BANDS, FINISH = range(3)
"""Stages, one job at a time: draw a whole frame; draw a band of rows of one; turn the drawn buffers into an image."""


def draw(
    scene: Scene,
    views: Views,
    settings: FrameSettings,
    output: Output,
    bands: np.ndarray,
    props: np.ndarray = NO_PROPS,
) -> None:
    """Draw one frame per view into `output`.

    bands [B, 2] int32: the rows from, to that a thread draws together. With one band a thread draws whole frames; more
    are for fewer frames than threads. props [N, P, PROP_COLUMNS] float32, or `NO_PROPS`.
    """
    whole_frames = len(bands) == 1
    count = 0 if whole_frames else len(views.poses)
    buffers = shared_buffers(count, settings.height, settings.width, output.drawn)
    for stage in (FRAMES,) if whole_frames else (BANDS, FINISH):
        jobs = len(views.poses) * (len(bands) if stage == BANDS else 1)
        # A frame with much wood in it takes twice as long as one of open water.
        job = partial(draw_jobs, scene, views, settings, output, bands, props, buffers, stage)
        run_in_threads(jobs, job, unequal=True)


def shared_buffers(count: int, height: int, width: int, drawn: int) -> Buffers:
    """The buffers of `frame.empty_buffers` for each of `count` frames, [count, H', W']."""
    return Buffers(*(np.repeat(buffer[None], count, axis=0) for buffer in empty_buffers(height, width, drawn)))


@kernel(inlined=True)
def buffers_of(buffers, n):
    """The `Buffers` of frame n."""
    return Buffers(
        buffers.depth[n],
        buffers.kind[n],
        buffers.red[n],
        buffers.green[n],
        buffers.blue[n],
        buffers.transmittance[n],
        buffers.plant_depth[n],
        buffers.water[n],
    )


@kernel
def draw_jobs(scene, views, settings, output, bands, props, buffers, stage, first, last):
    """Jobs number first to last of one stage of `draw`: frames, or bands of rows, frame after frame.

    buffers: those of `shared_buffers`, for no frame where whole frames are drawn.
    """
    for job in range(first, last):
        n = job // len(bands) if stage == BANDS else job
        band = job % len(bands) if stage == BANDS else 0
        look = views.looks[n]
        camera = pose_camera(views.poses[n], look, settings)
        view = View(views.world_index[n], look, camera, f32(views.times[n]))
        if stage == FRAMES:
            frame_buffers = empty_buffers(settings.height, settings.width, output.drawn)
        else:
            frame_buffers = buffers_of(buffers, n)
        if stage != FINISH:
            # Frames without props share one empty list.
            own_props = props[n] if props.shape[1] > 0 else props[0]
            top, bottom = bands[band, 0], bands[band, 1]
            draw_rows(scene, view, own_props, settings.reduced, output.drawn, top, bottom, frame_buffers)
        if stage != BANDS:
            finish_frame(scene, view, settings, frame_buffers, n, output)


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
