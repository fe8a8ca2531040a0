"""Tests of cameras of calibration files: what is taken over, and which cameras are refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from thalweg.render import Camera, RenderError
from thalweg.render.records.calibration import camera_of_calibration

ROS = """
image_width: 640
image_height: 480
camera_name: down
camera_matrix:
  rows: 3
  cols: 3
  data: [{fx}, 0.0, {cx}, 0.0, 400.0, 239.5, 0.0, 0.0, 1.0]
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: 5
  data: [{k1}, 0.0, {p1}, 0.0, 0.0]
"""
OPENCV = """%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 4.0e+02, 0., 319.5, 0., 4.0e+02, 239.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 0., 0., 0., 0., 0. ]
"""


def written(folder: Path, text: str = ROS, **values: Any) -> Path:
    path = folder / "camera.yaml"
    usual = {"fx": 400.0, "cx": 319.5, "model": "plumb_bob", "k1": 0.0, "p1": 0.0}
    path.write_text(text.format(**{**usual, **values}) if text is ROS else text)
    return path


@pytest.mark.parametrize("text", [ROS, OPENCV], ids=["ROS", "OpenCV"])
def test_a_camera_has_the_intrinsics_of_the_file(text: str, tmp_path: Path):
    camera = camera_of_calibration(written(tmp_path, text), pitch_deg=35.0)
    assert (camera.height_px, camera.width_px, camera.pitch_deg) == (480, 640, 35.0)
    np.testing.assert_allclose(camera.intrinsics(), [[400, 0, 319.5], [0, 400, 239.5], [0, 0, 1]], atol=1e-9)
    assert camera.near_m == Camera().near_m


def test_a_lens_that_moves_corners_by_less_than_two_pixels_is_taken(tmp_path: Path):
    # The corners are at x = 319.5 / 400 and y = 239.5 / 400, r² = 0.9965; they move by k1 r³ fx = 398 k1 pixels.
    camera_of_calibration(written(tmp_path, k1=0.005))
    with pytest.raises(RenderError, match=r"moves a corner of the image by 2\.4 pixels; .*rectify"):
        camera_of_calibration(written(tmp_path, k1=0.006))


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"fx": 420.0}, "fx = 420 and fy = 400 pixels differ"),
        ({"cx": 340.0}, r"at cx = 340, cy = 239\.5; that of the renderer's is in the middle, at 319\.5, 239\.5"),
        ({"model": "equidistant"}, "of the model 'equidistant' with 5 coefficients"),
        ({"p1": 0.1}, "moves a corner of the image by"),
        ({"k1": ".nan"}, "distortion_coefficients has numbers that are not finite"),
        ({"fx": "wide"}, "camera_matrix has no list of numbers"),
    ],
)
def test_another_camera_is_refused_by_what_differs(values: dict[str, Any], told: str, tmp_path: Path):
    with pytest.raises(RenderError, match=told):
        camera_of_calibration(written(tmp_path, **values))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("image_width: 640", "no calibration: it has no image_height"),
        ("- 1", "no calibration: it has no image_width, image_height and camera_matrix"),
        ("a: [", "cannot be read as a calibration"),
        (
            "image_width: 640.5\nimage_height: 480\ncamera_matrix: [4, 0, 2, 0, 4, 2, 0, 0, 1]",
            "image_width must be a whole number from 1",
        ),
        (f"image_width: {10**400}\nimage_height: 480\ncamera_matrix: [4, 0, 2, 0, 4, 2, 0, 0, 1]", "not 1000"),
        (f"image_width: 640\nimage_height: 480\ncamera_matrix: [{10**400}]", "camera_matrix has no list of numbers"),
        ("image_width: 640\nimage_height: 480\ncamera_matrix: [1, 0, 319.5, 0, 1, 239.5, 0, 0, 1]", "fov_deg must be"),
        ("image_width: 640\nimage_height: 480\ncamera_matrix: [4, 0]", "camera_matrix has 2 numbers, not 9"),
    ],
)
def test_a_file_that_is_no_calibration_is_refused(text: str, told: str, tmp_path: Path):
    with pytest.raises(RenderError, match=told) as refused:
        camera_of_calibration(path := written(tmp_path, text))
    assert str(path) in str(refused.value)


def test_coefficients_that_cancel_beyond_all_numbers_are_refused(tmp_path: Path):
    text = "image_width: 640\nimage_height: 480\ncamera_matrix: [200, 0, 319.5, 0, 200, 239.5, 0, 0, 1]\n"
    camera_of_calibration(written(tmp_path, text))
    with pytest.raises(RenderError, match="moves a corner of the image by nan pixels"):
        camera_of_calibration(written(tmp_path, text + "distortion_coefficients: [1.0e+308, -1.0e+308]"))


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(RenderError, match=r"none\.yaml cannot be read as a calibration"):
        camera_of_calibration(tmp_path / "none.yaml")
