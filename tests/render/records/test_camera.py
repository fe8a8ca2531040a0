"""Tests of `Camera`: values that are refused."""

import pytest

from thalweg.render import Camera


@pytest.mark.parametrize(
    ("field", "value"), [("height_px", 4), ("width_px", 20.5), ("fov_deg", 180.0), ("pitch_deg", 95.0), ("near_m", 0.0)]
)
def test_a_camera_that_cannot_be_is_refused_by_name(field, value):
    with pytest.raises(ValueError, match=field):
        Camera(**{field: value})
