"""Tests of outlines: how far a picture reaches to either side, by bands of its height."""

import numpy as np
import pytest

from thalweg.render.bake.outlines import BANDS, outlines


def test_an_outline_by_hand():
    """One texel of a picture of 16 x 8, in row 4 and column 2: interpolation shows it from column 1 to column 3."""
    filled = np.zeros((1, 16, 8), bool)
    filled[0, 4, 2] = True
    (outline,) = outlines(filled)
    # The middle of column c is at u = 1 - (c + 1/2) / 4, and that of row r at v = (r + 1/2) / 16.
    for band in (3, 4, 5):
        assert outline[band] == pytest.approx([1 - 3.5 / 4, 1 - 1.5 / 4])
    for band in set(range(BANDS)) - {3, 4, 5}:
        assert outline[band, 0] > outline[band, 1]


def test_a_full_picture_reaches_its_edges():
    assert (outlines(np.ones((1, 8, 4), bool)) == [-1, 1]).all()
