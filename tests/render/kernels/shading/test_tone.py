"""Tests of tone mapping: the curve, its encoding and the exposure."""

import numpy as np
import pytest

from thalweg.core.compute.jit import kernel
from thalweg.render import Camera
from thalweg.render.kernels.camera_rays import Radiance
from thalweg.render.kernels.shading import tone
from thalweg.render.records.appearance import look_rows, look_values


def test_srgb_and_the_curve_at_known_points():
    np.testing.assert_allclose(tone.encode(np.array([0.0, 0.0031308, 0.214041, 1.0])), [0, 0.04045, 0.5, 1], atol=2e-5)
    # Narkowicz at 1: (2.51 + 0.03) / (2.43 + 0.59 + 0.14).
    assert tone.curve(np.array(1.0)) == pytest.approx(2.54 / 3.16)
    codes = tone.code_table().astype(int)
    assert codes[0] == 0
    assert (np.diff(codes) >= 0).all()


@kernel
def expose(red, green, blue, look, image):
    tone.write_image(Radiance(red, green, blue), np.zeros(red.shape, np.uint8), look, np.uint32(0), image)


def test_exposure_takes_away_most_of_a_change_of_light():
    rng = np.random.default_rng(3)
    planes = [rng.uniform(0.02, 0.4, (16, 16)).astype(np.float32) for _ in range(3)]
    pictures = []
    for light in (1.0, 2.0):
        image = np.zeros((16, 16, 4), np.uint8)
        (row,) = look_rows(look_values(None, 1), Camera())
        expose(*(p * np.float32(light) for p in planes), row, image.view(np.uint32)[..., 0])
        pictures.append(image[..., :3].astype(float))
    radiance = np.stack(planes, -1).astype(float)
    luma = radiance @ np.array(tone.LUMA)
    vivid = np.maximum(luma[..., None] + (radiance - luma[..., None]) * tone.SATURATION, 0)
    by_hand = tone.encode(tone.curve(vivid * (tone.KEY / luma.mean()) ** tone.ADAPTATION)) * 255
    assert np.abs(pictures[0] - by_hand).max() < 2.0
    assert 0 < pictures[1].mean() - pictures[0].mean() < 20
