"""Tests of undistorted frames: their size, the places of pixels in them, and lenses that have no rays for an image."""

import math

import numpy as np
import pytest

from thalweg.render import Camera, RenderError
from thalweg.render.optics import wide_frame
from thalweg.render.optics.lens import Lens
from thalweg.render.optics.wide_frame import MARGIN_PX, OVERSAMPLING, cover, spread


def wide(camera: Camera) -> wide_frame.WideFrame:
    assert camera.lens is not None
    return wide_frame.wide_frame(camera.lens, camera.intrinsics(), camera.height_px, camera.width_px)


def test_without_distortion_the_frame_is_the_image_at_a_finer_resolution():
    frame = wide(Camera(100, 140, lens=Lens()))
    assert (frame.height_px, frame.width_px) == (150 + 2 * MARGIN_PX, 210 + 2 * MARGIN_PX)
    assert frame.half_height / frame.height_px == pytest.approx(math.tan(math.radians(30)) / 150)
    # The middle of the first pixel is half a pixel inside the image, in both.
    np.testing.assert_allclose(frame.places[0, 0, :2], 0.5 * OVERSAMPLING + MARGIN_PX - 0.5, atol=1e-4)
    np.testing.assert_allclose(frame.places[99, 139, :2], [150.75, 210.75], atol=1e-4)


def test_an_axis_beside_the_middle_takes_a_frame_that_is_wider_by_twice_the_offset():
    frame = wide(Camera(100, 140, lens=Lens(offset_x_px=-12.0)))
    assert frame.width_px == 2 * math.ceil((70 + 12) * OVERSAMPLING + MARGIN_PX)
    assert frame.places[50, 58, 1] - 0.5 * (frame.width_px - 1) == pytest.approx(0.5 * OVERSAMPLING, abs=1e-4)


@pytest.mark.parametrize(
    "lens",
    [Lens("plumb_bob", (-0.28, 0.07)), Lens("plumb_bob", (0.3, 0.1), 0.9, 9.0, -5.0), Lens("equidistant")],
    ids=["barrel", "pincushion", "fisheye"],
)
def test_a_frame_has_all_rays_and_is_nowhere_coarser_than_the_image(lens: Lens):
    frame = wide(Camera(96, 128, lens=lens))
    rows, columns = frame.places[..., 0], frame.places[..., 1]
    assert rows.min() >= 1 and rows.max() <= frame.height_px - 2
    assert columns.min() >= 1 and columns.max() <= frame.width_px - 2
    # The largest singular value of the image's pixels a texel is at most 1.
    slopes = np.array([[np.gradient(each, axis=axis) for axis in (0, 1)] for each in (rows, columns)])
    finest = np.linalg.norm(np.linalg.inv(np.moveaxis(slopes, (0, 1), (-2, -1))), 2, (-2, -1)).max()
    assert 0.97 / OVERSAMPLING < finest < 1.01 / OVERSAMPLING


def test_two_rays_between_texels_have_the_variance_of_a_pixel():
    # Of the triangle of a texel 1/4 of a pixel wide on either side, and two rays at ± s: 1/96 + s² = 1/12.
    np.testing.assert_allclose(spread(np.array([4.0, 0.0])), [4 * math.sqrt(7 / 96), 0.0])
    np.testing.assert_array_equal(spread(np.array([0.0, 1.2])), [0.0, 0.0])


@pytest.mark.parametrize(
    ("options", "told"),
    [
        # The corners are at √2 tan 30° = 0.816; k1 = -0.3 folds at 46.5°, which is shown at 0.703, 77.9 pixels.
        (
            {"lens": Lens("plumb_bob", (-0.3,))},
            "folds within the image: its plumb_bob coefficients are valid up to 46.5 degrees beside the axis, 78 pixels"
            " from the axis, and a corner of the image is 91 away",
        ),
        ({"lens": Lens("equidistant"), "fov_deg": 120.0}, "more than 80 degrees beside the axis"),
        ({"lens": Lens(), "height_px": 2048, "width_px": 2048}, None),
        (
            {"lens": Lens("plumb_bob", (0.0, 9.0)), "height_px": 2048, "width_px": 2048},
            "takes an undistorted frame of .* pixels a side; 4096 are the most: give the camera fewer pixels",
        ),
    ],
    ids=["folds", "too wide", "fits", "too large"],
)
def test_a_lens_without_a_ray_for_each_pixel_is_refused(options, told):
    if told is None:
        camera = Camera(**options)
        size = cover(camera.lens or Lens(), camera.intrinsics(), camera.height_px, camera.width_px)
        assert size.width_px <= 4096
        return
    with pytest.raises(RenderError, match=told):
        Camera(**options)
