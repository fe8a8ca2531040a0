"""Matrices of a pinhole camera in OpenCV's convention, for arrays and for tensors.

Pixel (u, v) of the image, in columns and rows, shows the point X of the world with λ (u, v, 1) = K (R X + t). The x
axis of a camera points right, y down, and z along the optical axis; λ is the depth in metres. Whole numbers (u, v) are
the centres of pixels, (0, 0) that of the top left one. Source: Hartley and Zisserman, "Multiple View Geometry", 2004,
chapter 6; https://docs.opencv.org/4.x/d9/d0c/group__calib3d.html
"""

from typing import Any, NamedTuple


class CameraMatrices(NamedTuple):
    """Matrices of M cameras; without the first dimension, of one."""

    K: Any
    """[M, 3, 3] float64, intrinsics in pixels."""
    R: Any
    """[M, 3, 3] float64, rotation from the world's axes (x east, y north, z up) to the camera's."""
    t: Any
    """[M, 3] float64, the world's origin in the camera's axes, in metres. The camera is at -Rᵀ t."""


def intrinsics(maths: Any, half_width: Any, half_height: Any, height_px: int, width_px: int) -> Any:
    """Return K [..., 3, 3] of cameras with half the width and height [...] of the image plane at distance one.

    `maths`: `numpy` for arrays, `torch` for tensors.
    """
    zero = half_width * 0.0
    focal_x, focal_y = 0.5 * width_px / half_width, 0.5 * height_px / half_height
    # The middle of the image lies between pixels where their number is even.
    middle_x, middle_y = zero + 0.5 * (width_px - 1), zero + 0.5 * (height_px - 1)
    return _matrices(maths, [[focal_x, zero, middle_x], [zero, focal_y, middle_y], [zero, zero, zero + 1.0]])


def extrinsics(maths: Any, poses: Any, pitch: Any) -> tuple[Any, Any]:
    """Return R [M, 3, 3] and t [M, 3] of cameras at poses [M, 4] (x, y, z in metres, yaw in radians), whose axes point
    `pitch` [M] radians below the horizon; `maths` as in `intrinsics`."""
    cos_yaw, sin_yaw = maths.cos(poses[:, 3]), maths.sin(poses[:, 3])
    cos_pitch, sin_pitch = maths.cos(pitch), maths.sin(pitch)
    right = [sin_yaw, -cos_yaw, cos_yaw * 0.0]
    down = [-cos_yaw * sin_pitch, -sin_yaw * sin_pitch, -cos_pitch]
    forward = [cos_yaw * cos_pitch, sin_yaw * cos_pitch, -sin_pitch]
    rotation = _matrices(maths, [right, down, forward])
    return rotation, -(rotation @ poses[:, :3, None])[..., 0]


def _matrices(maths: Any, rows: list[list[Any]]) -> Any:
    """Return matrices [M, 3, 3] of entries [M]."""
    return maths.stack([maths.stack(row, -1) for row in rows], -2)
