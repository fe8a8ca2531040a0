"""Tests of the reduced quality, against the full one."""

import numpy as np
import pytest

from tests.render.frames import on_river, psnr
from thalweg.render import Camera, Renderer


@pytest.mark.slow
def test_the_reduced_quality_sees_the_same_river_in_about_the_same_colours(easy_world):
    poses = on_river(easy_world, 6, 5)
    full, fast = (Renderer([easy_world], Camera(), quality).render_layers(poses) for quality in ("full", "fast"))
    assert np.mean(full.mask == fast.mask) > 0.99
    np.testing.assert_allclose(full.rgb.mean(axis=(1, 2)), fast.rgb.mean(axis=(1, 2)), atol=13)
    assert (full.rgb != fast.rgb).any(axis=-1).mean() > 0.3
    assert psnr(full.rgb, fast.rgb) > 17
    for ours, other in zip(full.rgb, fast.rgb, strict=True):
        assert np.corrcoef(ours.ravel(), other.ravel())[0, 1] > 0.75
