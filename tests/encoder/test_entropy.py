"""Tests of the relative entropy of codes against sums computed by hand."""

import math

import numpy as np
import pytest

from thalweg.encoder import EncoderInputError
from thalweg.encoder.entropy import histograms, relative_entropy


def column(*shares: int) -> np.ndarray:
    """Codes [9, 1] of nine images, so that there are three bins: so many at -1, 0 and 1."""
    return np.repeat([-1.0, 0.0, 1.0], shares)[:, None]


def test_bins_span_the_range_of_each_number():
    codes = column(2, 3, 4)
    assert histograms(codes).tolist() == [[2 / 9, 3 / 9, 4 / 9]]
    assert np.array_equal(histograms(codes), histograms(7.0 * codes - 100.0))


def test_2000_images_are_counted_in_45_bins_as_in_the_paper():
    codes = np.random.default_rng(0).standard_normal((2000, 3))
    shares = histograms(codes)
    assert shares.shape == (3, 45) and np.allclose(shares.sum(1), 1.0)


def test_constant_number_falls_into_the_middle_bin():
    assert histograms(np.full((9, 1), 5.0)).tolist() == [[0.0, 1.0, 0.0]]


def test_relative_entropy_equals_hand_computed_value():
    first, second = column(2, 3, 4), column(4, 4, 1)
    by_hand = (2 * math.log(2 / 4) + 3 * math.log(3 / 4) + 4 * math.log(4 / 1)) / 9
    assert relative_entropy(first, second, 1e-12) == pytest.approx(by_hand, rel=1e-9)
    assert relative_entropy(first, first) == 0.0
    assert relative_entropy(first, second, 1e-12) != pytest.approx(relative_entropy(second, first, 1e-12), rel=0.01)


def test_relative_entropy_is_the_mean_over_the_numbers_of_a_code():
    first, second = column(2, 3, 4), column(4, 4, 1)
    both = relative_entropy(np.hstack([first, first]), np.hstack([second, first]))
    assert both == pytest.approx(0.5 * relative_entropy(first, second))


def test_smoothing_determines_the_cost_of_an_empty_bin():
    first, second = column(3, 3, 3), column(4, 0, 5)
    total = 1 + 3e-3
    by_hand = sum(
        (p + 1e-3) / total * math.log((p + 1e-3) / (q + 1e-3))
        for p, q in ((1 / 3, 4 / 9), (1 / 3, 0.0), (1 / 3, 5 / 9))
    )
    assert relative_entropy(first, second, 1e-3) == pytest.approx(by_hand, rel=1e-9)
    assert relative_entropy(first, second, 1e-6) > 2 * by_hand


def test_incomparable_codes_are_refused():
    with pytest.raises(EncoderInputError, match=r"\[9, 1\] and \[9, 2\]"):
        relative_entropy(np.zeros((9, 1)), np.zeros((9, 2)))
    with pytest.raises(EncoderInputError, match="smoothing must be above 0, not 0"):
        relative_entropy(column(3, 3, 3), column(3, 3, 3), 0.0)
    with pytest.raises(EncoderInputError, match="1 of the 2 numbers of the codes are not finite"):
        histograms(np.array([[0.0], [np.nan]]))
