"""`LensDrawing`: frames behind a lens, looked up in undistorted ones before exposure, noise and the tone curve.

So a frame has the exposure of what it shows, and each of its pixels noise of its own, as behind a plain camera.
"""

from functools import partial

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.core.compute.threads import get_num_threads, run_in_threads
from thalweg.render.batch import BANDS, bands_of, buffers_of, draw_jobs, shared_buffers
from thalweg.render.kernels.bridge_edges import soften_edges
from thalweg.render.kernels.camera_rays import pose_camera
from thalweg.render.kernels.frame import empty_buffers, finish_frame, rows_of
from thalweg.render.kernels.lens import look_through
from thalweg.render.optics.wide_frame import wide_frame
from thalweg.render.records.appearance import HALF_H, HALF_W
from thalweg.render.records.camera import Camera
from thalweg.render.records.scene import Scene
from thalweg.render.records.view import COLOURS, FrameSettings, Output, View, Views, output

f32 = np.float32

FRAMES_PER_THREAD = 4
"""Undistorted frames that are drawn before they are looked up, for each thread."""
MOST_BYTES = 256 << 20
"""Memory of the undistorted frames that are drawn together, unless one alone takes more."""
BYTES_OF_A_PIXEL = 29
"""Those of `Buffers`."""


class LensDrawing:
    """Draws the frames of a camera with a lens."""

    def __init__(self, camera: Camera, settings: FrameSettings) -> None:
        """Compute where the pixels of the camera lie in an undistorted frame. settings: those of the camera."""
        assert camera.lens is not None
        self._settings, self._half_height = settings, camera.half_height
        self.wide = wide_frame(camera.lens, camera.intrinsics(), camera.height_px, camera.width_px)
        self._wide_settings = settings._replace(height=self.wide.height_px, width=self.wide.width_px)

    def draw(self, scene: Scene, views: Views, wanted: Output, props: np.ndarray) -> None:
        """Draw one frame per view into `wanted`; props [N, P, PROP_COLUMNS] float32, or `NO_PROPS`."""
        size = self.wide.height_px * self.wide.width_px * BYTES_OF_A_PIXEL
        most = max(1, min(FRAMES_PER_THREAD * get_num_threads(), MOST_BYTES // size))
        views = views._replace(looks=self._wide_looks(views.looks))
        for first in range(0, len(views.poses), most):
            part = slice(first, first + most)
            own_props = props[part] if props.shape[1] else props
            self._draw_part(scene, Views(*(values[part] for values in views)), wanted, first, own_props)

    def _wide_looks(self, looks: np.ndarray) -> np.ndarray:
        """Return looks [N, LOOK_COLUMNS] with the image plane of the wide frame."""
        # A look that widens the field of view makes all rays steeper, and the places of pixels stay the same.
        looks, factor = looks.copy(), looks[:, HALF_H] / self._half_height
        looks[:, HALF_H], looks[:, HALF_W] = factor * self.wide.half_height, factor * self.wide.half_width
        return looks

    def _draw_part(self, scene: Scene, views: Views, wanted: Output, first: int, props: np.ndarray) -> None:
        """Draw the frames of some views, which are those from number `first` on in `wanted`."""
        count, settings = len(views.poses), self._wide_settings
        bands = bands_of(settings.height, get_num_threads(), count)
        buffers = shared_buffers(count, settings.height, settings.width, wanted.drawn)
        wide = partial(draw_jobs, scene, views, settings, output(wanted.drawn), bands, props, buffers, BANDS)
        run_in_threads(count * len(bands), wide, unequal=True)
        finish = partial(finish_jobs, scene, views, settings, self._settings, self.wide.places, buffers, wanted, first)
        run_in_threads(count, finish)


@kernel
def finish_jobs(scene, views, wide_settings, settings, places, buffers, wanted, offset, first, last):
    """Write the frames first to last of the views as numbers offset + first on of `Output` wanted.

    buffers: those of `shared_buffers` with the wide frames; places: [H, W, 6] of `WideFrame`.
    """
    for n in range(first, last):
        look = views.looks[n]
        camera = pose_camera(views.poses[n], look, wide_settings)
        view = View(views.world_index[n], look, camera, f32(views.times[n]))
        wide = buffers_of(buffers, n)
        if wanted.drawn == COLOURS and not settings.reduced:
            # As `finish_frame` does, whose own call leaves the image as it is in the reduced quality.
            soften_edges(scene, view, rows_of(wide, 0, wide_settings.height))
        image = empty_buffers(settings.height, settings.width, wanted.drawn)
        look_through(places, wanted.drawn, wide, image)
        softened = FrameSettings(settings.height, settings.width, settings.near_m, True)
        finish_frame(scene, view, softened, image, offset + n, wanted)
