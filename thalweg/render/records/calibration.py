"""Cameras of calibration files: intrinsics and distortion as ROS's camera_calibration and OpenCV write them in YAML."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from thalweg.core.yaml12 import load
from thalweg.render.errors import RenderError
from thalweg.render.optics.lens import COEFFICIENTS, MODELS, DistortionModel, Lens
from thalweg.render.optics.wide_frame import KNOTS
from thalweg.render.records.camera import Camera

MOST_PX = 100_000
"""Greatest height and width of an image."""
OTHER_NAMES: dict[str, DistortionModel] = {"fisheye": "equidistant", "radtan": "plumb_bob", "none": "plumb_bob"}
"""Names of models that other programs write."""
MOST_ROUNDING = 1e-6
"""Greatest difference of the numbers of a camera_matrix that are 0 or 1 in cameras without skew."""
LEAST_SHIFT_PX = 0.1
"""Greatest distance in the image between a pixel of the calibration and that of a pinhole with square pixels and its
axis in the middle, at which the camera is taken for such a pinhole, which is drawn faster and also on a GPU."""


class Calibration(NamedTuple):
    """What a calibration says of the images of a camera."""

    width_px: int
    height_px: int
    focal_px: np.ndarray
    """[2], along a row and along a column."""
    axis_px: np.ndarray
    """[2], column and row of the optical axis; 0 is the centre of the first pixel."""
    model: DistortionModel
    coefficients: tuple[float, ...]


def camera_of_calibration(path: Path, **others: Any) -> Camera:
    """Return the camera of a calibration file; `others` are its further fields, such as `pitch_deg`.

    With another height_px or width_px, images are cut about their middle to that shape and resized, as videos are
    (`thalweg.deploy.follow.cut_to`). Raises `RenderError` for a file that is no calibration, for values that a `Camera`
    does not allow, and for a lens that has no ray for each pixel, see `thalweg.render.optics.wide_frame.cover`.
    """
    told = _calibration(path)
    sizes = {name: others.pop(name) for name in ("height_px", "width_px") if name in others}
    try:
        # A camera of this size, for the errors of sizes that are not allowed.
        size = Camera(**{"height_px": told.height_px, "width_px": told.width_px, **sizes})
        told = _cut(told, size.height_px, size.width_px)
        lens = _lens(told)
        fov = math.degrees(2 * math.atan(told.height_px / (2 * told.focal_px[1])))
        pinhole = Camera(**{"height_px": told.height_px, "width_px": told.width_px, "fov_deg": fov, **others})
        if "fov_deg" in others or _is_pinhole(lens, pinhole):
            _refuse_another_field_of_view(lens, pinhole, others)
            return pinhole
        return replace(pinhole, lens=lens)
    except RenderError as error:
        raise RenderError(f"{path}: {error}") from error


def _refuse_another_field_of_view(lens: Lens, pinhole: Camera, others: dict[str, Any]) -> None:
    """Raise `RenderError` for a given fov_deg, in a calibration that says another one of a lens."""
    if "fov_deg" in others and not _is_pinhole(lens, pinhole):
        raise RenderError("fov_deg is that of the calibration, whose lens no other one fits: leave it out")


def _is_pinhole(lens: Lens, pinhole: Camera) -> bool:
    """Return whether the image of a lens differs from that of a pinhole by less than `LEAST_SHIFT_PX` everywhere."""
    sides = pinhole.width_px, pinhole.height_px
    columns, rows = np.meshgrid(*(np.linspace(-0.5, side - 0.5, KNOTS) for side in sides))
    plain = pinhole.intrinsics()
    shown = lens.distort((columns - plain[0, 2]) / plain[0, 0], (rows - plain[1, 2]) / plain[1, 1])
    behind = lens.adjust(plain.copy())
    off = shown[0] * behind[0, 0] + behind[0, 2] - columns, shown[1] * behind[1, 1] + behind[1, 2] - rows
    return bool(np.hypot(*off).max() <= LEAST_SHIFT_PX)


def _lens(told: Calibration) -> Lens:
    """Return the lens of a calibration."""
    middle = (np.array([told.width_px, told.height_px]) - 1) / 2
    return Lens(
        told.model,
        told.coefficients,
        float(told.focal_px[0] / told.focal_px[1]),
        *(float(offset) for offset in told.axis_px - middle),
    )


def _cut(told: Calibration, height_px: int, width_px: int) -> Calibration:
    """Return the calibration of images that are cut about their middle to another shape, and resized."""
    scale = min(told.height_px / height_px, told.width_px / width_px)
    corner = (np.array([told.width_px, told.height_px]) - scale * np.array([width_px, height_px])) / 2
    # Pixels reach half of their side beyond their centres.
    axis = (told.axis_px + 0.5 - corner) / scale - 0.5
    return told._replace(width_px=width_px, height_px=height_px, focal_px=told.focal_px / scale, axis_px=axis)


def _calibration(path: Path) -> Calibration:
    """Return what a file says; raises `RenderError` for one that is no calibration, or of an unknown model."""
    told = _read(path)
    width, height, matrix = _of(told, path)
    fx, fy, (cx, cy) = matrix[0, 0], matrix[1, 1], matrix[:2, 2]
    if not np.allclose(matrix, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], rtol=0, atol=MOST_ROUNDING):
        raise RenderError(
            f"{path}: camera_matrix must be [fx, 0, cx, 0, fy, cy, 0, 0, 1], a camera without skew, not"
            f" [{', '.join(f'{number:g}' for number in matrix.ravel())}]"
        )
    if not (fx > 0 and fy > 0):
        raise RenderError(f"{path}: the focal lengths fx = {fx:g} and fy = {fy:g} pixels must be above 0")
    given = _numbers(told.get("distortion_coefficients", []), path, "distortion_coefficients")
    model = _model(told, given, path)
    if model not in MODELS:
        names = ", ".join((*MODELS, *OTHER_NAMES))
        raise RenderError(f"{path}: the distortion is that of the model {model!r}; known: {names}: rectify the images")
    most = len(COEFFICIENTS[model])
    if np.any(given[most:]):
        raise RenderError(
            f"{path}: the distortion has {len(given)} coefficients; {model} has {most},"
            f" {', '.join(COEFFICIENTS[model])}: rectify the images"
        )
    return Calibration(
        width, height, np.diag(matrix)[:2], matrix[:2, 2], model, tuple(float(number) for number in given[:most])
    )


def _model(told: dict[str, Any], given: np.ndarray, path: Path) -> Any:
    """Return the name of the model of the coefficients [K], which need not be one of `MODELS`.

    OpenCV names no model: its files of fisheye lenses have `fisheye_model: 1`, the others five coefficients or more,
    of which all after the fifth belong to the rational model. Four are of either kind of lens.
    """
    fisheye, named = told.get("fisheye_model"), told.get("distortion_model")
    if fisheye not in (None, 0, 1):
        raise RenderError(f"{path}: fisheye_model must be 0 or 1, not {fisheye!r:.40}")
    if named is not None:
        named = OTHER_NAMES.get(str(named), named)
        if fisheye and named != "equidistant":
            raise RenderError(f"{path}: fisheye_model is 1, but distortion_model is {named!r}: leave out one of them")
        return named
    if fisheye is None and len(given) == len(COEFFICIENTS["equidistant"]):
        raise RenderError(
            f"{path}: the four distortion_coefficients may be those of plumb_bob or of equidistant (fisheye): name the"
            " model by distortion_model"
        )
    if fisheye:
        return "equidistant"
    return "rational_polynomial" if np.any(given[len(COEFFICIENTS["plumb_bob"]) :]) else "plumb_bob"


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
