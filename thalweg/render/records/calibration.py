"""Cameras of calibration files: intrinsics and distortion as ROS's camera_calibration and OpenCV write them in YAML.

The renderer's camera has no distortion, square pixels and its axis in the middle of the image. A file of another camera
is refused: its images are to be rectified first.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from thalweg.core.yaml12 import load
from thalweg.render.errors import RenderError
from thalweg.render.records.camera import Camera

MODELS = ("plumb_bob", "none")
"""Models of distortion whose coefficients are k1, k2, p1, p2, k3."""
LARGEST_SHIFT_PX = 2.0
"""Greatest distortion of a corner of the image that is left out."""
LARGEST_SHARE = 0.02
"""Greatest difference of the two focal lengths, and distance of the axis from the middle, as shares of focal length and
size, that are left out."""
MOST_PX = 100_000
"""Greatest height and width of an image."""


def camera_of_calibration(path: Path, **others: Any) -> Camera:
    """Return the camera of a calibration file; `others` are its further fields, such as `pitch_deg`.

    Raises `RenderError`, with the path, for a file that is no calibration, and for a camera that the renderer does not
    have: distorted, without square pixels, or with its axis beside the middle.
    """
    told = _read(path)
    width, height, matrix = _of(told, path)
    focal_x, focal_y = matrix[0, 0], matrix[1, 1]
    if not (focal_x > 0 and focal_y > 0 and abs(focal_x / focal_y - 1.0) <= LARGEST_SHARE):
        raise RenderError(
            f"{path}: the focal lengths fx = {focal_x:g} and fy = {focal_y:g} pixels differ; the renderer's pixels are"
            " square: resize the images"
        )
    middle, axis = (np.array([width, height]) - 1) / 2, matrix[:2, 2]
    if np.any(np.abs(axis - middle) > LARGEST_SHARE * np.array([width, height])):
        raise RenderError(
            f"{path}: the axis of the camera is at cx = {axis[0]:g}, cy = {axis[1]:g}; that of the renderer's is in the"
            f" middle, at {middle[0]:g}, {middle[1]:g}: rectify and crop the images"
        )
    shift = largest_shift_px(told, path, matrix, width, height)
    if not shift <= LARGEST_SHIFT_PX:  # NaN where terms of infinite size cancel
        raise RenderError(
            f"{path}: the lens moves a corner of the image by {shift:.1f} pixels; the renderer's camera has no"
            " distortion: rectify the images, and give the calibration of the rectified ones, without coefficients"
        )
    fov_deg = math.degrees(2 * math.atan(height / (focal_x + focal_y)))
    try:
        return Camera(**{"height_px": height, "width_px": width, "fov_deg": fov_deg, **others})
    except RenderError as error:
        raise RenderError(f"{path}: {error}") from error


def largest_shift_px(told: dict[str, Any], path: Path, matrix: np.ndarray, width: int, height: int) -> float:
    """Return by how many pixels the distortion of a calibration moves a corner at most.

    x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²), and y' likewise, of points (x, y) at distance one
    (Brown 1971; https://docs.opencv.org/4.x/d9/d0c/group__calib3d.html). Raises `RenderError` for another model.
    """
    model = told.get("distortion_model", MODELS[0])
    given = _numbers(told.get("distortion_coefficients", []), path, "distortion_coefficients")
    if model not in MODELS or np.any(given[5:]):
        raise RenderError(
            f"{path}: the distortion is that of the model {model!r} with {len(given)} coefficients; known is"
            " plumb_bob with up to five: rectify the images"
        )
    k1, k2, p1, p2, k3 = np.pad(given[:5], (0, 5 - len(given[:5])))
    corners = np.array([[u, v] for u in (0, width - 1) for v in (0, height - 1)], np.float64)
    focal = np.array([matrix[0, 0], matrix[1, 1]])
    x, y = ((corners - matrix[:2, 2]) / focal).T
    with np.errstate(over="ignore", invalid="ignore"):
        square = x**2 + y**2
        radial = k1 * square + k2 * square**2 + k3 * square**3
        moved_x = x * radial + 2 * p1 * x * y + p2 * (square + 2 * x**2)
        moved_y = y * radial + p1 * (square + 2 * y**2) + 2 * p2 * x * y
        return float(np.hypot(moved_x * focal[0], moved_y * focal[1]).max())


def _read(path: Path) -> dict[str, Any]:
    """Return the content of a file as plain data."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
        # OpenCV's first line and its tag for matrices are no YAML that other readers know.
        told = load("\n".join(line for line in lines if not line.startswith("%")).replace("!!opencv-matrix", ""))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise RenderError(f"{path} cannot be read as a calibration: {' '.join(str(error).split())}") from error
    if not isinstance(told, dict):
        raise RenderError(f"{path} is no calibration: it has no image_width, image_height and camera_matrix")
    return told


def _of(told: dict[str, Any], path: Path) -> tuple[int, int, np.ndarray]:
    """Return width and height in pixels, and the matrix [3, 3] of a calibration."""
    for name in ("image_width", "image_height", "camera_matrix"):
        if name not in told:
            raise RenderError(f"{path} is no calibration: it has no {name}")
    numbers = _numbers(told["camera_matrix"], path, "camera_matrix")
    if numbers.size != 9:
        raise RenderError(f"{path}: camera_matrix has {numbers.size} numbers, not 9")
    width, height = told["image_width"], told["image_height"]
    for name in ("image_width", "image_height"):
        if not isinstance(told[name], int) or not 0 < told[name] <= MOST_PX:
            raise RenderError(f"{path}: {name} must be a whole number from 1 to {MOST_PX}, not {told[name]!r:.40}")
    return width, height, numbers.reshape(3, 3)


def _numbers(value: Any, path: Path, name: str) -> np.ndarray:
    """Return the numbers [K] of a list, or of a matrix with its `data`."""
    try:
        found = np.array(value["data"] if isinstance(value, dict) else value, np.float64).ravel()
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise RenderError(f"{path}: {name} has no list of numbers") from error
    if not np.isfinite(found).all():
        raise RenderError(f"{path}: {name} has numbers that are not finite")
    return found
