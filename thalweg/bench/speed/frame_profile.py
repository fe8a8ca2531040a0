"""The time of each stage of a frame, on one thread, over many views.

The stages are the functions of `thalweg.render` themselves, called one after another. What they share, such as the
camera, is computed before the clock starts; a call from Python costs some microseconds, which shows in the smallest
stages.
"""

import statistics
import time
from collections.abc import Callable, Iterator

import numpy as np

from thalweg.env import sample_starts
from thalweg.render import Camera, Renderer
from thalweg.render.kernels import frame, plants
from thalweg.render.kernels.camera_rays import HitPoints, Origin, Radiance, Rays, hit_points, pose_camera, row_rays
from thalweg.render.kernels.primary_hits import find_primary_hits
from thalweg.render.kernels.shading import tone, water
from thalweg.render.records import classes, layout
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.render.records.view import COLOURS, FrameSettings, Planes, PosedCamera, View
from thalweg.world import World

f32 = np.float32
REFLECTION = "shading: water, its reflection"
STAGES = (
    "ground",
    "bridges",
    "plants",
    "shading: sky",
    "shading: ground",
    "shading: water",
    REFLECTION,
    "tone",
)
"""Stages in the order in which a frame is drawn; the reflection is part of the shading of water."""


class FrameStages:
    """The planes of one frame of full quality, and the stages that draw it as calls without arguments."""

    def __init__(self, renderer: Renderer, pose: np.ndarray) -> None:
        camera = renderer.camera
        self.scene = renderer.scene
        look = look_rows(look_values(None, 1), camera)[0]
        settings = FrameSettings(camera.height_px, camera.width_px, f32(camera.near_m), False)
        # Python turns its numbers into doubles; the renderer uses single precision.
        *numbers, height, width = pose_camera(pose, look, settings)
        self.view = View(0, look, PosedCamera._make((*(f32(number) for number in numbers), height, width)), f32(0))
        self.planes = Planes(*frame.empty_planes(camera.height_px, camera.width_px))
        self.planes = Planes(*(plane[: camera.height_px] for plane in self.planes))
        self.image = np.zeros((camera.height_px, camera.width_px), np.uint32)

    def calls(self) -> Iterator[tuple[str, Callable[[], object], Callable[[], object]]]:
        """Yield name, preparation of the planes, and call of each stage, to be run in this order."""
        scene, view, planes = self.scene, self.view, self.planes
        no_preparation = lambda: None  # noqa: E731
        yield "ground", no_preparation, lambda: find_primary_hits(scene, view, 0, False, planes.depth, planes.kind)
        ground = planes.depth.copy(), planes.kind.copy()
        yield (
            "bridges",
            lambda: (np.copyto(planes.depth, ground[0]), np.copyto(planes.kind, ground[1])),
            lambda: frame.draw_bridges(scene, view, 0, COLOURS, planes.depth, planes.kind),
        )
        colours = Radiance(planes.red, planes.green, planes.blue)
        yield (
            "plants",
            lambda: ([plane.fill(0) for plane in colours], planes.transmittance.fill(1)),
            lambda: plants.draw_plants(scene, view, 0, False, planes),
        )
        for name, wanted in (("sky", classes.SKY), ("ground", classes.GROUND), ("water", classes.WATER)):
            only = np.where(planes.kind == wanted, planes.kind, np.uint8(classes.BRIDGE))
            shown = planes._replace(kind=only)
            yield f"shading: {name}", no_preparation, lambda shown=shown: frame.shade(scene, view, 0, False, shown)
        yield REFLECTION, no_preparation, self._reflection()
        mask = planes.kind.copy()
        frame.mask_water(mask, planes.transmittance)
        key = frame.noise_key(view)
        yield "tone", no_preparation, lambda: tone.write_image(colours, mask, view.look, key, self.image)

    def _reflection(self) -> Callable[[], None]:
        """Return the march of the reflected rays of all lit water pixels as a call, with its inputs computed."""
        scene, view, planes = self.scene, self.view, self.planes
        height, wide = planes.depth.shape
        inv_cell = scene.constants[0, layout.INV_CELL]
        rays = Rays(*np.empty((3, height, wide), f32))
        for r in range(height):
            row_rays(view.camera, r, 0, inv_cell, Rays(*(axis[r] for axis in rays)), wide)
        chosen = np.flatnonzero((planes.kind == classes.WATER) & (planes.transmittance > frame.SEEN)).astype(np.int32)
        count = len(chosen)
        size = max(count, 1)
        points = HitPoints(*np.empty((7, size), f32))
        flat = Rays(*(axis.ravel() for axis in rays))
        origin = Origin(
            (view.camera.x - scene.constants[0, layout.ORIGIN_X]) * inv_cell,
            (view.camera.y - scene.constants[0, layout.ORIGIN_Y]) * inv_cell,
            view.camera.z,
        )
        hit_points(origin, inv_cell, flat, planes.depth.ravel(), chosen, points, count)
        surface, mirrored = water.Surface(*np.empty((7, size), f32)), water.Mirrored(*np.empty((4, size), f32))
        pixel = f32(2) * view.camera.half_h / f32(height)
        water.ripple_surface(scene, view, points, pixel, surface, count)
        met_at = np.empty(size, f32)
        return lambda: water.mirror_canopy(scene, view, points, surface, mirrored, met_at, count)


def profile_frame(world: World, camera: Camera, views: int, repeats: int) -> dict[str, list[float]]:
    """Return the milliseconds of each stage in each of `views` random views: medians of `repeats` runs, one thread."""
    renderer = Renderer([world], camera)
    times_ms: dict[str, list[float]] = {name: [] for name in STAGES}
    for pose in sample_starts(world, views, 0):
        for name, prepare, stage in FrameStages(renderer, pose).calls():
            seconds = []
            for _ in range(repeats + 1):
                prepare()
                start = time.perf_counter()
                stage()
                seconds.append(time.perf_counter() - start)
            times_ms[name].append(1e3 * statistics.median(seconds[1:]))  # the first run may compile
    return times_ms
