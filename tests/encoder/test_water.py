"""The overlap of water, on pictures small enough to count, and a finder that learns what water looks like."""

import numpy as np
import pytest

from thalweg.encoder import EncoderInputError
from thalweg.encoder.water import mean_iou, train_finder, water_in


def masks(*rows: str) -> np.ndarray:
    """One mask per row of two lines, # for water."""
    return np.array([[[cell == "#" for cell in line] for line in row.split("/")] for row in rows])


def test_the_overlap_is_counted_for_each_image_and_then_averaged():
    found = masks("##/..", "#./..", "../..", "#./..")
    truth = masks("#./#.", "#./..", "../..", "../..")
    assert mean_iou(found, truth) == pytest.approx((1 / 3 + 1 + 1 + 0) / 4)


def test_masks_of_other_shapes_or_kinds_are_named():
    with pytest.raises(EncoderInputError, match=r"bool \[1, 2, 2\] and bool \[2, 2, 2\]"):
        mean_iou(masks("##/.."), masks("##/..", "##/.."))
    with pytest.raises(EncoderInputError, match=r"not uint8 .* and bool"):
        mean_iou(masks("##/..").astype(np.uint8), masks("##/.."))


def test_a_finder_learns_what_water_looks_like():
    generator = np.random.default_rng(0)
    frames = np.zeros((96, 32, 32, 4), np.uint8)
    for frame in frames:  # a bluish stripe on sand, under light that varies
        left, width = generator.integers(0, 20), generator.integers(4, 12)
        light = generator.uniform(0.6, 1.0)
        frame[..., :3] = np.array([210, 190, 140]) * light + generator.normal(0, 8, (32, 32, 3))
        frame[:, left : left + width, :3] = np.array([110, 130, 150]) * light + generator.normal(0, 8, (32, width, 3))
        frame[:, left : left + width, 3] = 255
    finder = train_finder(frames[:64], epochs=40)
    truth = frames[64:, ..., 3] > 0
    assert mean_iou(water_in(finder, frames[64:, ..., :3]), truth) > 0.8
    as_shares = frames[64:, ..., :3].astype(np.float32) / 255
    assert np.array_equal(water_in(finder, as_shares), water_in(finder, frames[64:, ..., :3]))
