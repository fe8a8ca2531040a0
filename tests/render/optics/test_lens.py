"""Tests of lenses: OpenCV's formulas at points worked by hand, their inverse, and where they fold."""

import math

import numpy as np
import pytest

from thalweg.render import RenderError
from thalweg.render.optics.lens import Lens

LENSES = [
    Lens("plumb_bob", (-0.25, 0.08, 0.001, -0.002, -0.01)),
    Lens("rational_polynomial", (0.4, 0.1, 0.001, 0.002, 0.01, 0.7, 0.2, 0.03)),
    Lens("equidistant", (-0.02, 0.004, -0.001, 0.0002)),
]
NAMES = [lens.model for lens in LENSES]


@pytest.mark.parametrize(
    ("lens", "point", "shown"),
    [
        (Lens("plumb_bob", (0.1,)), (0.5, 0.0), (0.5 * 1.025, 0.0)),
        (Lens("plumb_bob", (0.0, 0.2, 0.0, 0.0, 0.4)), (0.0, 1.0), (0.0, 1.6)),
        # r² = 0.25: 2 p1 x y = 0.0024 to the right, and p1 (r² + 2 y²) = 0.0057 down.
        (Lens("plumb_bob", (0.0, 0.0, 0.01)), (0.3, 0.4), (0.3024, 0.4057)),
        # p2 (r² + 2 x²) = 0.0043 to the right, and 2 p2 x y = 0.0024 down.
        (Lens("plumb_bob", (0.0, 0.0, 0.0, 0.01)), (0.3, 0.4), (0.3043, 0.4024)),
        (Lens("rational_polynomial", (1.0, 0.0, 0.0, 0.0, 0.0, 2.0, 4.0, 8.0)), (1.0, 0.0), (2 / 15, 0.0)),
        (Lens("equidistant"), (0.0, 1.0), (0.0, math.pi / 4)),
        (
            Lens("equidistant", (0.5, 0.25, 0.125, 0.0625)),
            (math.tan(0.5), 0.0),
            (0.5 * (1 + 1 / 8 + 1 / 64 + 1 / 512 + 1 / 4096), 0.0),
        ),
    ],
)
def test_points_move_as_the_formulas_of_opencv_say(lens, point, shown):
    found = lens.distort(np.array(point[0]), np.array(point[1]))
    np.testing.assert_allclose(found, shown, atol=1e-12)


@pytest.mark.parametrize("lens", LENSES, ids=NAMES)
def test_undistorted_points_move_back_to_where_they_were_shown(lens: Lens):
    x, y = np.meshgrid(np.linspace(-0.7, 0.7, 15), np.linspace(-0.5, 0.5, 11))
    shown = lens.distort(x, y)
    assert np.abs(np.array(shown) - [x, y]).max() > 0.02
    np.testing.assert_allclose(lens.undistort(*shown), [x, y], atol=1e-8)


def test_a_lens_folds_where_the_slope_of_its_radius_is_zero():
    # r (1 - 0.3 r²) rises up to r = 1 / √0.9, where it is 0.7027.
    radius, shown = Lens("plumb_bob", (-0.3,)).radii()
    assert radius[-1] == pytest.approx(1 / math.sqrt(0.9), rel=2e-3)
    assert shown[-1] == pytest.approx(2 / 3 / math.sqrt(0.9), rel=1e-5)
    beyond = Lens("plumb_bob", (-0.3,)).undistort(np.array([0.70, 0.71]), np.zeros(2))
    np.testing.assert_array_equal(np.isnan(beyond), [[False, True], [False, True]])


@pytest.mark.parametrize("lens", LENSES[:2], ids=NAMES[:2])
def test_a_lens_with_steeper_rays_has_scaled_coefficients(lens: Lens):
    # The same pixels show points further out by the factor, of a camera with a focal length shorter by it.
    x, y = np.array([0.1, -0.4, 0.3]), np.array([0.2, 0.1, -0.5])
    steeper = Lens(lens.model, tuple(lens.scaled(1.25)))
    np.testing.assert_allclose(np.array(steeper.distort(1.25 * x, 1.25 * y)) / 1.25, lens.distort(x, y), atol=1e-12)


def test_steeper_rays_of_an_equidistant_lens_are_no_such_lens():
    with pytest.raises(RenderError, match="looks without fov_deg"):
        Lens("equidistant", (0.1,)).scaled(1.1)


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.int64])
def test_coefficients_may_be_an_array_as_calibrations_give_it(kind: type):
    lens = Lens("plumb_bob", np.array([-1, 0, 2], kind))  # pyright: ignore[reportArgumentType]
    assert lens == Lens("plumb_bob", (-1.0, 0.0, 2.0)) and {type(each) for each in lens.coefficients} == {float}


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"coefficients": (0.0,) * 6}, "plumb_bob has the coefficients k1, k2, p1, p2, k3; got 6 numbers"),
        ({"model": "fish"}, "model must be one of 'plumb_bob', 'rational_polynomial', 'equidistant', got 'fish'"),
        ({"coefficients": np.zeros((1, 5))}, "coefficients must be a list, got array"),
        ({"coefficients": (math.nan,)}, r"coefficients\[0\] must be a finite number, got nan"),
        ({"focal_ratio": 0.0}, "focal_ratio must be a number from 0.1 to 10, got 0"),
    ],
)
def test_values_that_no_lens_has_are_refused(values, told):
    with pytest.raises(RenderError, match=told):
        Lens(**values)
