"""`Camera`: a pinhole camera, pitched down by a fixed angle, without roll."""

import math
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from thalweg.core.config import Hint, WholeNumber, frozen_config
from thalweg.render.errors import RenderError
from thalweg.render.records import pinhole
from thalweg.render.records.pinhole import CameraMatrices

Pixels = Annotated[WholeNumber, Field(ge=16, le=2048)]


@frozen_config(RenderError, numpy_scalars=True)
class Camera:
    """A pinhole camera; its pose (x, y, z, yaw) comes with each frame."""

    height_px: Pixels = 128
    """Rows of the image."""
    width_px: Pixels = 128
    """Columns of the image."""
    fov_deg: Annotated[float, Field(ge=5, le=150)] = 60.0
    """Vertical field of view; the horizontal one follows from square pixels."""
    pitch_deg: Annotated[float, Field(ge=-89, le=89), Hint("negative looks up, positive down")] = 20.0
    """How far the optical axis points below the horizon."""
    near_m: Annotated[float, Field(ge=0.01, le=10)] = 0.3
    """Nothing nearer than this along the optical axis is drawn."""

    @property
    def half_height(self) -> float:
        """Half the height of the image plane at distance one."""
        return math.tan(math.radians(self.fov_deg) / 2)

    @property
    def half_width(self) -> float:
        """Half the width of the image plane at distance one."""
        return self.half_height * self.width_px / self.height_px

    @property
    def pixel(self) -> float:
        """Side of a pixel on the image plane at distance one."""
        return 2 * self.half_height / self.height_px

    def intrinsics(self) -> np.ndarray:
        """Return the matrix K [3, 3] float64 of the camera in OpenCV's convention, see
        `thalweg.render.records.pinhole`."""
        return pinhole.intrinsics(
            np, np.float64(self.half_width), np.float64(self.half_height), self.height_px, self.width_px
        )

    def camera_matrices(self, poses: ArrayLike, pitch_deg: ArrayLike = 0.0, fov_deg: ArrayLike = 0.0) -> CameraMatrices:
        """Return the matrices K [M, 3, 3], R [M, 3, 3] and t [M, 3] of the camera at poses [M, 4], x, y, z in metres
        and yaw in radians, in OpenCV's convention, see `thalweg.render.records.pinhole`.

        pitch_deg, fov_deg: added to those of the camera, as those of a `thalweg.render.Look` are; numbers or [M].
        Raises `RenderError` for poses of another shape.
        """
        at = np.array(poses, np.float64)
        if at.ndim != 2 or at.shape[1] != 4:
            raise RenderError(f"poses have shape {list(at.shape)}; they must be [M, 4]: x, y, z, yaw")
        pitch = np.radians(np.broadcast_to(self.pitch_deg + np.asarray(pitch_deg, np.float64), len(at)))
        fov = np.radians(np.broadcast_to(self.fov_deg + np.asarray(fov_deg, np.float64), len(at)))
        half_height = np.tan(fov / 2)
        half_width = half_height * self.width_px / self.height_px
        matrix = pinhole.intrinsics(np, half_width, half_height, self.height_px, self.width_px)
        return CameraMatrices(matrix, *pinhole.extrinsics(np, at, pitch))
