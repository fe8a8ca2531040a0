"""Tests of images in a mirror."""

import numpy as np
import pytest

from thalweg.train.flip import flipped


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_left_and_right_change_places(channels: int):
    images = np.random.default_rng(0).integers(0, 256, (2, 3, 5, 7, channels), np.uint8)
    expected = images[..., ::-1, :].copy()
    assert np.array_equal(flipped(images), expected)
    assert np.array_equal(flipped(images[:, [0, 2]]), expected[:, [0, 2]])
    assert np.array_equal(flipped(images[:, ::2]), expected[:, ::2])  # not contiguous
