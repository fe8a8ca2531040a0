"""The undistorted frame that the image of a lens is taken from: its size, and where each pixel lies in it.

The kernels draw pinholes with their axis in the middle: the walk over the ground, the outlines of plants and bridges
and the lists of tiles rest on straight lines of an image being straight in the world. So a wide frame is drawn that
has all rays of the image, with pixels that are nowhere coarser than the image's, and the image is looked up in it.
"""

import math
from typing import NamedTuple

import numpy as np

from thalweg.render.errors import RenderError
from thalweg.render.optics.lens import MOST_ANGLE_DEG, Lens

OVERSAMPLING = 1.5
"""Pixels of the wide frame along one of the image, where the image is finest."""
MOST_PX = 4096
"""Greatest width and height of a wide frame."""
MARGIN_PX = 2
"""Pixels of the wide frame around the outermost ray, which interpolation reads."""
KNOTS = 33
"""Points along the side of an image at which a lens is checked, its edges included."""


class WideFrame(NamedTuple):
    """A frame of a pinhole with square pixels that contains an image of H x W pixels."""

    height_px: int
    width_px: int
    half_height: float
    """Half the height of its image plane at distance one."""
    half_width: float
    places: np.ndarray
    """[H, W, 6] float32, in pixels of the frame: row and column of the centre of each pixel of the image, where 0 is
    the centre of the first one; then how far down and to the right two rays on either side of it lie, along the pixel's
    row and along its column."""


class Cover(NamedTuple):
    """Size of a wide frame."""

    height_px: int
    width_px: int
    focal_px: float
    """Focal length."""


def cover(lens: Lens, matrix: np.ndarray, height_px: int, width_px: int) -> Cover:
    """Return the size of the wide frame for an image with intrinsics [3, 3].

    Raises `RenderError` for a lens that folds within the image, and for an image with rays further from the axis than
    `MOST_ANGLE_DEG`, or that needs more than `MOST_PX`.
    """
    columns, rows = np.meshgrid(*(np.linspace(-0.5, side - 0.5, KNOTS) for side in (width_px, height_px)))
    x, y = rays_of(lens, matrix, columns, rows)
    if np.isnan(x).any():
        raise RenderError(_why_there_is_no_ray(lens, matrix, columns, rows))
    across, along = np.abs(x).max(), np.abs(y).max()
    finest = _finest(lens, matrix, x, y)
    room = (MOST_PX / 2 - MARGIN_PX - 1) / max(across, along)
    if room < finest:
        angle, side = math.degrees(math.atan(max(across, along))), 2 * max(across, along) * finest
        raise RenderError(
            f"the lens shows up to {angle:.1f} degrees beside its axis, which takes an undistorted frame of {side:.0f}"
            f" pixels a side; {MOST_PX} are the most: give the camera fewer pixels"
        )
    focal = min(OVERSAMPLING * finest, room)
    # Slopes are known to a millionth, which must not add a pixel.
    width, height = (2 * (math.ceil(half * focal - 0.01) + MARGIN_PX) for half in (across, along))
    return Cover(max(height, 16), max(width, 16), focal)


def wide_frame(lens: Lens, matrix: np.ndarray, height_px: int, width_px: int) -> WideFrame:
    """Return the wide frame for an image with intrinsics [3, 3]; raises the errors of `cover`."""
    height, width, focal = cover(lens, matrix, height_px, width_px)
    columns, rows = np.meshgrid(np.arange(width_px, dtype=np.float64), np.arange(height_px, dtype=np.float64))
    x, y = rays_of(lens, matrix, columns, rows)
    centre = np.stack([focal * y + 0.5 * (height - 1), focal * x + 0.5 * (width - 1)], axis=-1)
    beside = [spread(np.gradient(centre, axis=axis)) for axis in (1, 0)]
    places = np.concatenate([centre, *beside], axis=-1).astype(np.float32)
    return WideFrame(height, width, 0.5 * height / focal, 0.5 * width / focal, places)


def spread(step: np.ndarray) -> np.ndarray:
    """Return how far from the centre of a pixel [..., 2] rays lie along one of its sides; step [..., 2]: the way to the
    next pixel, both in pixels of the wide frame.

    Two rays that are interpolated between texels then weigh the frame with the variance of a box of one pixel, which is
    1/12: a texel's triangle has 1/6 of its own, smaller pixel. Where the pixels are alike, the triangle alone has more.
    """
    length = np.linalg.norm(step, axis=-1, keepdims=True)
    return step * np.sqrt(np.maximum(1 / 12 - 1 / (6 * length**2), 0.0))


def rays_of(lens: Lens, matrix: np.ndarray, columns: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the points (x, y), each [...], at distance one that pixels (columns, rows), each [...], show; NaN for
    those that show none."""
    return lens.undistort((columns - matrix[0, 2]) / matrix[0, 0], (rows - matrix[1, 2]) / matrix[1, 1])


def _finest(lens: Lens, matrix: np.ndarray, x: np.ndarray, y: np.ndarray) -> float:
    """Return the greatest number of the image's pixels along one unit at distance one, at points (x, y), each [...]."""
    a, b, c, d = lens.slopes(x, y, *lens.distort(x, y))
    scale = np.array([[matrix[0, 0]], [matrix[1, 1]]])
    return float(np.linalg.norm(scale * np.moveaxis(np.array([[a, b], [c, d]]), (0, 1), (-2, -1)), 2, (-2, -1)).max())


def _why_there_is_no_ray(lens: Lens, matrix: np.ndarray, columns: np.ndarray, rows: np.ndarray) -> str:
    """Return why some of the pixels (columns, rows), each [...], show no point."""
    radius, shown = lens.radii()
    angle = math.degrees(math.atan(radius[-1]))
    reach = np.hypot((columns - matrix[0, 2]) / matrix[0, 0], (rows - matrix[1, 2]) / matrix[1, 1]).max()
    focal = math.sqrt(matrix[0, 0] * matrix[1, 1])
    where = f"{shown[-1] * focal:.0f} pixels from the axis, and a corner of the image is {reach * focal:.0f} away"
    if angle > MOST_ANGLE_DEG - 0.1 and reach > shown[-1]:
        most = f"{MOST_ANGLE_DEG:g} degrees beside the axis, the most that is drawn"
        return f"the image shows more than {most}: they are {where}"
    return (
        f"the lens folds within the image: its {lens.model} coefficients are valid up to {angle:.1f} degrees beside the"
        f" axis, {where}; calibrate with points up to the corners, or cut the image"
    )
