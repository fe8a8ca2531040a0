"""`Camera`: a camera that is pitched down by a fixed angle, without roll; a pinhole, or behind a lens that distorts."""

import math
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from thalweg.core.config import Hint, WholeNumber, frozen_config, to_plain
from thalweg.render.errors import RenderError
from thalweg.render.optics.lens import COEFFICIENTS, Lens
from thalweg.render.optics.wide_frame import cover
from thalweg.render.records import pinhole
from thalweg.render.records.pinhole import CameraMatrices

LIMITS_PX = 16, 2048
"""Least and greatest number of rows and columns of an image."""
Pixels = Annotated[WholeNumber, Field(ge=LIMITS_PX[0], le=LIMITS_PX[1])]


class Distortion(NamedTuple):
    """Distortion of M cameras, in OpenCV's convention."""

    model: str
    """`plumb_bob`, `rational_polynomial` or `equidistant`, see `thalweg.render.optics.lens`."""
    coefficients: Any
    """[M, D] float64, in OpenCV's order; without the first dimension, of one camera."""


@frozen_config(RenderError, numpy_scalars=True)
class Camera:
    """A camera; its pose (x, y, z, yaw) comes with each frame."""

    height_px: Pixels = 128
    """Rows of the image."""
    width_px: Pixels = 128
    """Columns of the image."""
    fov_deg: Annotated[float, Field(ge=5, le=150)] = 60.0
    """Vertical field of view; the horizontal one follows from square pixels. With a lens, that of a pinhole with the
    same vertical focal length in pixels."""
    pitch_deg: Annotated[float, Field(ge=-89, le=89), Hint("negative looks up, positive down")] = 20.0
    """How far the optical axis points below the horizon."""
    near_m: Annotated[float, Field(ge=0.01, le=10)] = 0.3
    """Nothing nearer than this along the optical axis is drawn."""
    lens: Lens | None = None
    """Distortion, shape of pixels, and place of the axis in the image; None is a pinhole with square pixels and its
    axis in the middle. Such cameras are drawn on the CPU only."""

    @model_validator(mode="after")
    def _lens_has_a_ray_for_each_pixel(self) -> Self:
        if self.lens is not None:
            cover(self.lens, self.intrinsics(), self.height_px, self.width_px)
        return self

    def as_data(self) -> dict[str, Any]:
        """Return the camera as plain data, without `lens` for a pinhole: earlier versions knew no other."""
        return {name: value for name, value in to_plain(self).items() if name != "lens" or value is not None}

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
        return self.with_lens(
            pinhole.intrinsics(
                np, np.float64(self.half_width), np.float64(self.half_height), self.height_px, self.width_px
            )
        )

    def with_lens(self, matrix: Any) -> Any:
        """Return K [..., 3, 3] of a pinhole, an array or a tensor, changed in place to that of this camera."""
        return matrix if self.lens is None else self.lens.adjust(matrix)

    def distortion(self, fov_deg: ArrayLike = 0.0) -> Distortion:
        """Return the `Distortion` of M cameras with looks that add fov_deg [M], or of one for a number.

        A look that widens the field of view makes all rays steeper by the same factor. Raises `RenderError` for such a
        look and the model equidistant, which then has no coefficients.
        """
        lens = self.lens or Lens()
        added = np.asarray(fov_deg, np.float64)
        factors = np.where(added, np.tan(np.radians(self.fov_deg + added) / 2) / self.half_height, 1.0)
        rows = [lens.scaled(float(factor)) for factor in factors.ravel()]
        return Distortion(lens.model, np.reshape(rows, (*factors.shape, len(COEFFICIENTS[lens.model]))))

    def pixels_of(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the columns and rows [...] of the pixels that show points [..., 3] in the camera's axes, x right, y
        down and z along the optical axis, in metres; NaN for points that are not before it, or beyond the lens."""
        depth = np.where(points[..., 2] > self.near_m, points[..., 2], np.nan)
        x, y = points[..., 0] / depth, points[..., 1] / depth
        if self.lens is not None:
            beyond = np.hypot(x, y) > self.lens.radii()[0][-1]
            x, y = (np.where(beyond, np.nan, moved) for moved in self.lens.distort(x, y))
        matrix = self.intrinsics()
        return matrix[0, 0] * x + matrix[0, 2], matrix[1, 1] * y + matrix[1, 2]

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
        matrix = self.with_lens(pinhole.intrinsics(np, half_width, half_height, self.height_px, self.width_px))
        return CameraMatrices(matrix, *pinhole.extrinsics(np, at, pitch))
