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
from thalweg.render.kernels.billboard import BLOCK
from thalweg.render.kernels.camera_rays import aim, open_eye, reach
from thalweg.render.kernels.primary_hits import MISS, survey
from thalweg.render.kernels.shading import water
from thalweg.render.records import appearance as looks
from thalweg.render.records import classes
from thalweg.render.records import scene as table
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
    """The buffers of one frame of full quality, and the stages that draw it as calls without arguments."""

    def __init__(self, renderer: Renderer, pose: np.ndarray) -> None:
        camera = renderer.camera
        self.scene, self.width = renderer.scene, camera.width_px
        self.look = looks.look_rows(looks.look_values(None, 1), camera)[0]
        eye = open_eye(*pose, self.look, camera.width_px, f32(camera.near_m))
        # Python turns its numbers into doubles; the renderer uses single precision.
        self.eye = tuple(f32(number) for number in eye)
        wide = -(-camera.width_px // BLOCK) * BLOCK
        shape = camera.height_px, wide
        self.depth, self.solid = np.empty(shape, f32), np.full(shape, f32(MISS))
        self.kind, self.light = np.empty(shape, np.uint8), np.ones(shape, f32)
        self.red, self.green, self.blue = np.zeros((3, *shape), f32)
        self.image = np.zeros((camera.height_px, camera.width_px), np.uint32)

    def calls(self) -> Iterator[tuple[str, Callable[[], object], Callable[[], object]]]:
        """Yield name, preparation of the buffers, and call of each stage, to be run in this order."""
        scene, look, eye, height = self.scene, self.look, self.eye, len(self.depth)
        no_preparation = lambda: None  # noqa: E731
        yield "ground", no_preparation, lambda: survey(scene, 0, eye, height, 0, False, self.depth, self.kind)
        ground = self.depth.copy(), self.kind.copy()
        yield (
            "bridges",
            lambda: (np.copyto(self.depth, ground[0]), np.copyto(self.kind, ground[1])),
            lambda: frame.draw_bridges(scene, 0, look, eye, height, self.width, 0, self.depth, self.kind),
        )
        colours = self.red, self.green, self.blue
        yield (
            "plants",
            lambda: ([plane.fill(0) for plane in colours], self.light.fill(1)),
            lambda: plants.draw_plants(
                scene, 0, look, eye, height, 0, False, self.depth, *colours, self.light, self.solid
            ),
        )
        for name, wanted in (("sky", classes.SKY), ("ground", classes.GROUND), ("water", classes.WATER)):
            only = np.where(self.kind == wanted, self.kind, np.uint8(classes.BRIDGE))
            yield f"shading: {name}", no_preparation, lambda only=only: self._shade(only)
        yield REFLECTION, no_preparation, self._reflection()
        mask = self.kind.copy()
        frame.mask_water(mask, self.light)
        key = frame.noise_key(eye, f32(0))
        yield (
            "tone",
            no_preparation,
            lambda: frame.develop(*colours, mask, look, key, self.image, self.width),
        )

    def _shade(self, kind: np.ndarray) -> None:
        planes = self.light, self.red, self.green, self.blue
        height = len(self.depth)
        frame.shade(self.scene, 0, self.look, self.eye, f32(0), height, self.width, 0, False, self.depth, kind, *planes)

    def _reflection(self) -> Callable[[], None]:
        """Return the march of the reflected rays of all lit water pixels as a call, with its inputs computed."""
        scene, look, eye = self.scene, self.look, self.eye
        height, wide = self.depth.shape
        inv_cell = scene.number[0, table.INV_CELL]
        node_x, node_y = (
            (eye[i] - scene.number[0, origin]) * inv_cell for i, origin in ((0, table.ORIGIN_X), (1, table.ORIGIN_Y))
        )
        rays = np.empty((3, height, wide), f32)
        for r in range(height):
            aim(eye, height, r, 0, inv_cell, *rays[:, r], wide)
        at = np.flatnonzero((self.kind == classes.WATER) & (self.light > frame.SEEN)).astype(np.int32)
        count = len(at)
        x, y, z, dx, dy, dz, far = np.empty((7, max(count, 1)), f32)
        reach(
            node_x,
            node_y,
            eye[2],
            inv_cell,
            *rays.reshape(3, -1),
            self.depth.ravel(),
            at,
            x,
            y,
            z,
            dx,
            dy,
            dz,
            far,
            count,
        )
        slope_x, slope_y, spread, facing, rx, ry, rz, red, green, blue, passing = np.empty((11, max(count, 1)), f32)
        pixel = f32(2) * eye[12] / f32(height)
        water.ripple(
            scene, 0, look, x, y, dx, dy, dz, far, pixel, f32(0), slope_x, slope_y, spread, facing, rx, ry, rz, count
        )  # fmt: skip
        return lambda: water.mirror_canopy(scene, 0, look, x, y, z, rx, ry, rz, red, green, blue, passing, far, count)


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
