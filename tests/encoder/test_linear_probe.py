"""Tests of the linear probe on codes with known R²."""

import numpy as np
import pytest

from thalweg.encoder import EncoderInputError
from thalweg.encoder import linear_probe as probe
from thalweg.encoder.linear_probe import probe_r_squared


def drawn(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Codes [count, 3]; and truths: a line through them, that with noise of the same variance, noise, and a square."""
    generator = np.random.default_rng(seed)
    codes = generator.standard_normal((count, 3)) * [1.0, 10.0, 0.1] + [5.0, 0.0, -3.0]
    line = (codes - [5.0, 0.0, -3.0]) @ [1.0, 0.1, 10.0] + 40.0
    noisy = line + np.sqrt(3.0) * generator.standard_normal(count)
    return codes, np.column_stack([line, noisy, generator.standard_normal(count), (codes[:, 0] - 5.0) ** 2])


def test_r_squared_of_line_noisy_line_noise_and_square():
    fitted, judged = drawn(4000, 0), drawn(4000, 1)
    line, noisy, chance, square = probe_r_squared(*fitted, *judged)
    assert line == pytest.approx(1.0, abs=1e-5)
    assert noisy == pytest.approx(0.5, abs=0.05)
    assert chance == pytest.approx(0.0, abs=0.01) and square == pytest.approx(0.0, abs=0.01)


def test_r_squared_is_computed_on_other_images(monkeypatch: pytest.MonkeyPatch):
    codes, truths = drawn(20, 0)
    wide = np.hstack([codes, np.random.default_rng(2).standard_normal((20, 17))])
    monkeypatch.setattr(probe, "RIDGES", np.array([1e-9]))
    itself = probe_r_squared(wide, truths, wide, truths)[2]
    other_codes, other_truths = drawn(500, 1)
    others = np.hstack([other_codes, np.random.default_rng(3).standard_normal((500, 17))])
    assert itself > 0.9 and probe_r_squared(wide, truths, others, other_truths)[2] < 0


def test_penalty_finds_few_informative_numbers_among_a_thousand():
    generator = np.random.default_rng(0)
    codes = generator.standard_normal((2500, 1024))
    truths = (codes[:, :4].sum(1) + 2.0 * generator.standard_normal(2500))[:, None]  # half of its variance
    of_many = probe_r_squared(codes[:2000], truths[:2000], codes[2000:], truths[2000:])[0]
    of_few = probe_r_squared(codes[:2000, :16], truths[:2000], codes[2000:, :16], truths[2000:])[0]
    assert 0.15 < of_many < of_few and of_few == pytest.approx(0.5, abs=0.07)


def test_images_with_nan_are_left_out():
    codes, truths = drawn(400, 0)
    truths[::2, 0] = np.nan
    assert probe_r_squared(codes, truths, *drawn(400, 1))[0] == pytest.approx(1.0, abs=1e-4)
    truths[:, 0] = np.nan
    assert np.isnan(probe_r_squared(codes, truths, *drawn(400, 1))[0])


def test_constant_numbers_have_no_effect():
    codes, truths = drawn(400, 0)
    others, other_truths = drawn(400, 1)
    codes, others = (np.hstack([each, np.ones((400, 1))]) for each in (codes, others))
    assert probe_r_squared(codes, truths, others, other_truths)[0] == pytest.approx(1.0, abs=1e-4)


def test_mismatched_sizes_are_refused():
    codes, truths = drawn(10, 0)
    with pytest.raises(EncoderInputError, match=r"codes \[10, 3\] with truths \[10, 4\], and codes \[10, 2\]"):
        probe_r_squared(codes, truths, codes[:, :2], truths)
    with pytest.raises(EncoderInputError, match=r"truths \[9, 4\].*each code needs its truths"):
        probe_r_squared(codes, truths[:9], codes, truths)
