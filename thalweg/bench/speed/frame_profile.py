"""The time of each stage of a frame, on one thread, over many views, and of the whole frame.

The stages are timed in the order of a frame, one view after another, as the renderer draws them, so that none finds its
tables in a warmer cache than in a frame. The whole frame is timed by `Renderer.render`; what stages leave is "rest".
"""

import statistics
import time
from collections.abc import Callable

import numpy as np

from thalweg.bench.speed.stage_times import TIMED_STAGES, time_frames
from thalweg.core.compute.threads import get_num_threads, set_num_threads
from thalweg.env import sample_starts
from thalweg.render import Camera, Renderer
from thalweg.render.kernels import frame
from thalweg.render.kernels.camera_rays import HitPoints, Origin, Radiance, hit_points, pose_camera
from thalweg.render.kernels.plants.draw import draw_plants
from thalweg.render.kernels.shading import background, mirror, water
from thalweg.render.kernels.terrain.primary_hits import find_primary_hits
from thalweg.render.records import classes, layout
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.render.records.view import COLOURS, Buffers, FrameSettings, PosedCamera, View, Views
from thalweg.world import World

f32 = np.float32
REFLECTION = "shading: water, its reflection"
REST = "rest"
STAGES = (*TIMED_STAGES, REFLECTION, REST)
"""Parts of a frame, of which the reflection is one of the shading of water; the others add up to the whole."""


class Reflection:
    """The reflection in the water of one view of a drawn frame, to be timed alone."""

    def __init__(self, renderer: Renderer, pose: np.ndarray) -> None:
        """Find what the view's pixels show by the renderer."""
        camera = renderer.camera
        self.scene = renderer.scene
        look = look_rows(look_values(None, 1), camera)[0]
        settings = FrameSettings(camera.height_px, camera.width_px, f32(camera.near_m), False)
        # Python turns its numbers into doubles; the renderer uses single precision.
        *numbers, height, width = pose_camera(pose, look, settings)
        self.view = View(0, look, PosedCamera._make((*(f32(number) for number in numbers), height, width)), f32(0))
        self.buffers = Buffers(*frame.empty_buffers(camera.height_px, camera.width_px, COLOURS))
        find_primary_hits(self.scene, self.view, 0, False, self.buffers.depth, self.buffers.kind, self.buffers.water)
        frame.draw_bridges(self.scene, self.view, 0, COLOURS, self.buffers.depth, self.buffers.kind)
        draw_plants(self.scene, self.view, 0, False, self.buffers)

    def march(self) -> Callable[[], None]:
        """Return the march of the reflected rays of all lit water pixels as a call, with its inputs computed."""
        scene, view, buffers = self.scene, self.view, self.buffers
        inv_cell = scene.constants[0, layout.INV_CELL]
        rows, columns = np.nonzero((buffers.kind == classes.WATER) & (buffers.transmittance > background.SEEN))
        places = (rows << 16 | columns).astype(np.int32)
        count = len(places)
        size = max(count, 1)
        points = HitPoints(*np.empty((7, size), f32))
        origin = Origin(
            (view.camera.x - scene.constants[0, layout.ORIGIN_X]) * inv_cell,
            (view.camera.y - scene.constants[0, layout.ORIGIN_Y]) * inv_cell,
            view.camera.z,
        )
        hit_points(view.camera, origin, inv_cell, 0, places, buffers.depth[rows, columns], points, count)
        surface, mirrored = water.Surface(*np.empty((7, size), f32)), mirror.Mirrored(*np.empty((4, size), f32))
        pixel = f32(2) * view.camera.half_h / f32(view.camera.height)
        water.ripple_surface(scene, view, points, pixel, surface, count)
        scratch = Radiance(*np.empty((3, size), f32))
        return lambda: mirror.mirror_canopy(scene, view, points, pixel, surface, mirrored, scratch, count)


def profile_frame(world: World, camera: Camera, views: int, repeats: int) -> dict[str, list[float]]:
    """Return the milliseconds of each of `STAGES` in each of `views` random views: medians of `repeats` runs.

    The first run, which may compile, does not count.
    """
    renderer = Renderer([world], camera)
    poses = sample_starts(world, views, 0)
    threads = get_num_threads()
    set_num_threads(1)
    try:
        runs = [_run(renderer, poses) for _ in range(repeats + 1)][1:]
    finally:
        set_num_threads(threads)
    times_ms = {name: np.median([run[name] for run in runs], axis=0) for name in (*TIMED_STAGES, "drawn", "whole")}
    # What a frame takes beside its stages: in the kernel with a clock by view, and beyond it in the mean.
    inside = times_ms["drawn"] - sum(times_ms[name] for name in TIMED_STAGES)
    rest = inside + np.mean(times_ms["whole"]) - np.mean(times_ms["drawn"])
    reflections = [_median_ms(Reflection(renderer, pose).march(), repeats) for pose in poses]
    stages = {name: times_ms[name].tolist() for name in TIMED_STAGES}
    return {**stages, REFLECTION: reflections, REST: rest.tolist()}


def draw_and_time(renderer: Renderer, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return frames [N, H, W] uint32 of poses [N, 4], as `Renderer.render` draws them, and the ticks [N, stages + 1] of
    `time_frames`."""
    camera, count = renderer.camera, len(poses)
    settings = FrameSettings(camera.height_px, camera.width_px, f32(camera.near_m), False)
    looks = look_rows(look_values(None, count), camera)
    views = Views(np.zeros(count, np.int64), np.ascontiguousarray(poses, np.float64), np.zeros(count), looks)
    images = np.zeros((count, camera.height_px, camera.width_px), np.uint32)
    spent = np.zeros((count, len(TIMED_STAGES) + 1), np.int64)
    time_frames(renderer.scene, views, settings, images, spent)
    return images, spent


def _run(renderer: Renderer, poses: np.ndarray) -> dict[str, np.ndarray]:
    """Return the milliseconds [N] of each stage, of the stages with all between them, and of the renderer's frame."""
    start = time.perf_counter()
    renderer.render(poses)
    whole = (time.perf_counter() - start) / len(poses)
    start = time.perf_counter()
    _, spent = draw_and_time(renderer, poses)
    # The clock's unit follows from the whole call, of which frames are nearly all.
    times_ms = 1e3 * (time.perf_counter() - start) / spent[:, -1].sum() * spent.T
    return dict(zip((*TIMED_STAGES, "drawn"), times_ms, strict=True)) | {"whole": np.full(len(poses), 1e3 * whole)}


def _median_ms(call: Callable[[], object], repeats: int) -> float:
    """Return the median milliseconds of a call, without its first, which may compile."""
    seconds = []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - start)
    return 1e3 * statistics.median(seconds[1:])
