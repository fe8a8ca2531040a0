"""Tests of cameras of calibration files: what is taken over, and which files are refused."""

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from thalweg.render import Camera, RenderError
from thalweg.render.optics.lens import Lens
from thalweg.render.records.calibration import camera_of_calibration

ROS = """
image_width: 640
image_height: 480
camera_name: down
camera_matrix:
  rows: 3
  cols: 3
  data: [{fx}, 0.0, {cx}, 0.0, 400.0, {cy}, 0.0, 0.0, 1.0]
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: 5
  data: {coefficients}
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
   data: [ {coefficients} ]
"""
USUAL = {"fx": 400.0, "cx": 319.5, "cy": 239.5, "model": "plumb_bob", "coefficients": [0.0] * 5}


def written(folder: Path, text: str = ROS, **values: Any) -> Path:
    path = folder / "camera.yaml"
    path.write_text(text.format(**{**USUAL, **values}) if text is ROS else text)
    return path


@pytest.mark.parametrize("text", [ROS, OPENCV.format(coefficients="0., 0., 0., 0., 0.")], ids=["ROS", "OpenCV"])
def test_a_pinhole_has_the_intrinsics_of_the_file(text: str, tmp_path: Path):
    camera = camera_of_calibration(written(tmp_path, text), pitch_deg=35.0)
    assert (camera.height_px, camera.width_px, camera.pitch_deg) == (480, 640, 35.0)
    np.testing.assert_allclose(camera.intrinsics(), [[400, 0, 319.5], [0, 400, 239.5], [0, 0, 1]], atol=1e-9)
    assert camera.near_m == Camera().near_m and camera.lens is None


def test_a_lens_has_the_intrinsics_and_coefficients_of_the_file(tmp_path: Path):
    given = [-0.2, 0.05, 0.001, -0.002, 0.003]
    camera = camera_of_calibration(written(tmp_path, fx=420.0, cx=300.0, cy=250.0, coefficients=given), pitch_deg=35.0)
    np.testing.assert_allclose(camera.intrinsics(), [[420, 0, 300], [0, 400, 250], [0, 0, 1]], atol=1e-9)
    np.testing.assert_allclose(camera.camera_matrices([[1.0, 2.0, 3.0, 0.4]]).K[0], camera.intrinsics(), atol=1e-9)
    model, coefficients = camera.distortion()
    assert model == "plumb_bob" and camera.pitch_deg == 35.0
    np.testing.assert_array_equal(coefficients, given)


@pytest.mark.parametrize(
    ("model", "coefficients", "taken"),
    [
        ("rational_polynomial", [0.1, 0.0, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.0], "rational_polynomial"),
        ("equidistant", [-0.01, 0.0, 0.0, 0.0], "equidistant"),
        ("fisheye", [-0.01, 0.0, 0.0, 0.0], "equidistant"),
        ("radtan", [-0.1, 0.0, 0.0, 0.0], "plumb_bob"),
    ],
)
def test_models_have_the_names_that_programs_write(model: str, coefficients: list, taken: str, tmp_path: Path):
    camera = camera_of_calibration(written(tmp_path, model=model, coefficients=coefficients))
    assert camera.lens is not None and camera.lens.model == taken


def test_eight_coefficients_of_opencv_are_those_of_the_rational_model(tmp_path: Path):
    text = OPENCV.format(coefficients="0.1, 0., 0., 0., 0., 0.2, 0., 0.")
    camera = camera_of_calibration(written(tmp_path, text))
    assert camera.lens == Lens("rational_polynomial", (0.1, 0.0, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0))


@pytest.mark.parametrize(("fisheye", "taken"), [(1, "equidistant"), ("true", "equidistant"), (0, "plumb_bob")])
def test_files_of_opencv_say_whether_the_lens_is_a_fisheye(fisheye: Any, taken: str, tmp_path: Path):
    text = f"{OPENCV.format(coefficients='-0.01, 0.002, 0., 0.')}fisheye_model: {fisheye}\n"
    camera = camera_of_calibration(written(tmp_path, text))
    assert camera.lens is not None and camera.lens.model == taken


def test_four_coefficients_without_a_model_are_refused(tmp_path: Path):
    with pytest.raises(RenderError, match=r"may be those of plumb_bob or of equidistant .* name the model"):
        camera_of_calibration(written(tmp_path, OPENCV.format(coefficients="0., 0., 0., 0.")))


@pytest.mark.parametrize(
    ("model", "fisheye", "told"),
    [
        ("plumb_bob", 1, "fisheye_model is 1, but distortion_model is 'plumb_bob': leave out one of them"),
        ("plumb_bob", 2, "fisheye_model must be 0 or 1, not 2"),
    ],
)
def test_a_fisheye_that_is_none_is_refused(model: str, fisheye: Any, told: str, tmp_path: Path):
    path = written(tmp_path, model=model)
    path.write_text(f"{path.read_text()}fisheye_model: {fisheye}\n")
    with pytest.raises(RenderError, match=told):
        camera_of_calibration(path)


def test_a_lens_that_moves_no_pixel_by_more_than_a_tenth_is_left_out(tmp_path: Path):
    # The corners are at x = 320 / 400 and y = 240 / 400, r = 1; they move by k1 r³ f = 400 k1 pixels.
    assert camera_of_calibration(written(tmp_path, coefficients=[0.00024])).lens is None
    assert camera_of_calibration(written(tmp_path, coefficients=[0.00026])).lens is not None
    assert camera_of_calibration(written(tmp_path, cx=319.59)).lens is None
    assert camera_of_calibration(written(tmp_path, cx=319.61)).lens is not None


def test_images_of_another_size_are_cut_about_their_middle_and_resized(tmp_path: Path):
    # 480 x 480 of the 640 x 480 pixels from column 80 on, at a quarter: column 100 becomes (100.5 - 80) / 4 - 0.5.
    path = written(tmp_path, cx=100.0, cy=239.5, coefficients=[-0.02])
    camera = camera_of_calibration(path, height_px=120, width_px=120)
    np.testing.assert_allclose(camera.intrinsics(), [[100, 0, 4.625], [0, 100, 59.5], [0, 0, 1]], atol=1e-9)
    np.testing.assert_array_equal(camera.distortion().coefficients, [-0.02, 0, 0, 0, 0])


def test_the_record_of_a_camera_gives_the_same_camera(tmp_path: Path):
    camera = camera_of_calibration(written(tmp_path, cx=300.0, coefficients=[-0.1, 0.02]), height_px=48, width_px=64)
    data = camera.as_data()
    assert data["lens"]["coefficients"] == [-0.1, 0.02]
    assert Camera(**data) == camera != Camera(**{**data, "lens": {**data["lens"], "coefficients": [-0.1, 0.03]}})
    assert "lens" not in Camera().as_data()


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"model": "thin_prism"}, "of the model 'thin_prism'; known: plumb_bob, rational_polynomial, equidistant"),
        ({"coefficients": [0.1] * 8}, "has 8 coefficients; plumb_bob has 5, k1, k2, p1, p2, k3: rectify"),
        # r (1 - 0.5 r²) rises up to r = √(2/3), 39.2 degrees; the corners are at r = 1.
        (
            {"coefficients": [-0.5]},
            r"camera.yaml: the lens folds .* valid up to 39\.2 degrees beside the axis, 218 pixels",
        ),
        ({"fx": -1.0}, "focal lengths fx = -1 and fy = 400 pixels must be above 0"),
        ({"coefficients": [".nan"]}, "distortion_coefficients has numbers that are not finite"),
        ({"fx": "wide"}, "camera_matrix has no list of numbers"),
        ({"cx": 1e9}, "camera.yaml: .* degrees beside the axis"),
    ],
)
def test_what_no_camera_has_is_refused_by_name(values: dict[str, Any], told: str, tmp_path: Path):
    values = {name: str(value).replace("'", "") if isinstance(value, list) else value for name, value in values.items()}
    with pytest.raises(RenderError, match=told):
        camera_of_calibration(written(tmp_path, **values))


def test_the_field_of_view_of_a_lens_is_that_of_the_file(tmp_path: Path):
    assert camera_of_calibration(written(tmp_path), fov_deg=70.0).fov_deg == 70.0
    with pytest.raises(RenderError, match="fov_deg is that of the calibration"):
        camera_of_calibration(written(tmp_path, coefficients=[-0.1]), fov_deg=70.0)


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
        (ROS.format(**{**USUAL, "model": "[1]"}), r"of the model \[1\]"),
    ],
)
def test_a_file_that_is_no_calibration_is_refused(text: str, told: str, tmp_path: Path):
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    with pytest.raises(RenderError, match=told) as refused:
        camera_of_calibration(path)
    assert str(path) in str(refused.value)


@pytest.mark.parametrize(
    ("matrix", "shown"),
    [
        ([400, 0.01, 319.5, 0, 400, 239.5, 0, 0, 1], "400, 0.01, 319.5, 0, 400, 239.5, 0, 0, 1"),
        ([800, 0, 639, 0, 800, 479, 0, 0, 2], "800, 0, 639, 0, 800, 479, 0, 0, 2"),
        ([400, 0, 0, 0, 400, 0, 319.5, 239.5, 1], "400, 0, 0, 0, 400, 0, 319.5, 239.5, 1"),
    ],
    ids=["skewed", "scaled", "transposed"],
)
def test_a_matrix_that_is_not_of_a_camera_without_skew_is_refused(matrix: list[float], shown: str, tmp_path: Path):
    text = f"image_width: 640\nimage_height: 480\ncamera_matrix: {matrix}"
    with pytest.raises(RenderError, match=re.escape(f"without skew, not [{shown}]")):
        camera_of_calibration(written(tmp_path, text))


def test_rounding_in_a_matrix_is_no_skew(tmp_path: Path):
    text = "image_width: 640\nimage_height: 480\ncamera_matrix: [400, 1.0e-9, 319.5, 0, 400, 239.5, 0, 0, 1.0]"
    assert camera_of_calibration(written(tmp_path, text)).lens is None


def test_a_coefficient_beyond_all_lenses_is_refused(tmp_path: Path):
    path = tmp_path / "camera.yaml"
    text = "image_width: 640\nimage_height: 480\ncamera_matrix: [200, 0, 319.5, 0, 200, 239.5, 0, 0, 1]\n"
    path.write_text(text)
    camera_of_calibration(path)
    path.write_text(text + "distortion_coefficients: [1.0e+308, -1.0e+308]")
    with pytest.raises(RenderError, match=r"camera\.yaml: .*k1 must be within 1e\+09 of 0, got 1e\+308"):
        camera_of_calibration(path)


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(RenderError, match=r"none\.yaml cannot be read as a calibration"):
        camera_of_calibration(tmp_path / "none.yaml")


def test_points_beyond_a_lens_are_on_no_pixel():
    camera = Camera(fov_deg=40.0, lens=Lens("plumb_bob", (-0.3,), offset_x_px=3.0))
    column, row = camera.pixels_of(np.array([[0.0, 0.0, 5.0], [2.0, 0.0, 5.0], [6.0, 0.0, 5.0], [0.0, 0.0, -5.0]]))
    focal = 64 / math.tan(math.radians(20))
    # 6 / 5 lies behind the fold at 1 / √0.9; without that it would be shown at 0.68, inside that of 1.05.
    np.testing.assert_allclose(column, [66.5, 66.5 + focal * 0.4 * (1 - 0.3 * 0.16), np.nan, np.nan])
    np.testing.assert_allclose(row, [63.5, 63.5, np.nan, np.nan])
