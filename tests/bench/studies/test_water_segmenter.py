"""The overlap of water, on pictures small enough to count, and a segmenter that learns what water looks like."""

from pathlib import Path

import numpy as np
import pytest
import torch

from thalweg.bench.studies.water_segmenter import train_segmenter
from thalweg.encoder import DEFAULT_PATH, EncoderFileError, EncoderInputError
from thalweg.encoder.water import WaterSegmenter, load_segmenter, mean_iou, save_segmenter, water_in


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


@pytest.fixture(scope="module")
def frames() -> np.ndarray:
    """A bluish stripe on sand, under light that varies."""
    generator = np.random.default_rng(0)
    frames = np.zeros((96, 32, 32, 4), np.uint8)
    for frame in frames:
        left, width = generator.integers(0, 20), generator.integers(4, 12)
        light = generator.uniform(0.6, 1.0)
        frame[..., :3] = np.array([210, 190, 140]) * light + generator.normal(0, 8, (32, 32, 3))
        frame[:, left : left + width, :3] = np.array([110, 130, 150]) * light + generator.normal(0, 8, (32, width, 3))
        frame[:, left : left + width, 3] = 255
    return frames


@pytest.fixture(scope="module")
def segmenter(frames: np.ndarray) -> WaterSegmenter:
    return train_segmenter(frames[:64], epochs=60)


@pytest.mark.slow
def test_a_segmenter_learns_what_water_looks_like(frames: np.ndarray, segmenter: WaterSegmenter):
    truth = frames[64:, ..., 3] > 0
    found = water_in(segmenter, frames[64:, ..., :3])
    assert mean_iou(found, truth) > 0.95
    as_shares = frames[64:, ..., :3].astype(np.float32) / 255
    assert np.array_equal(water_in(segmenter, as_shares), found)


@pytest.mark.slow
def test_a_segmenter_tells_two_waters_apart_by_what_is_far_from_them():
    """Grey is water where the left edge is bright, 24 pixels away, and not where it is dark."""
    frames = np.full((96, 32, 32, 4), 128, np.uint8)
    wet = np.random.default_rng(0).random(96) < 0.5
    frames[..., :4, :3] = np.where(wet, 255, 0)[:, None, None, None]
    frames[..., 24:, 3] = np.where(wet, 255, 0)[:, None, None]
    frames[..., :24, 3] = 0
    found = water_in(train_segmenter(frames[:64], epochs=60), frames[64:, ..., :3])
    assert mean_iou(found, frames[64:, ..., 3] > 0) > 0.9


def test_a_saved_segmenter_is_restored(frames: np.ndarray, segmenter: WaterSegmenter, tmp_path: Path):
    save_segmenter(tmp_path / "finder.safetensors", segmenter)
    again = load_segmenter(tmp_path / "finder.safetensors")
    assert np.array_equal(water_in(again, frames), water_in(segmenter, frames))
    with pytest.raises(EncoderFileError, match="no finder of water"):
        load_segmenter(DEFAULT_PATH)


def test_a_segmenter_learns_in_bfloat16_too_and_is_in_float32(frames: np.ndarray):
    found = train_segmenter(frames[:64], epochs=1, precision="bfloat16")
    assert {tensor.dtype for tensor in found.parameters()} == {torch.float32}
    other = train_segmenter(frames[:64], epochs=1, precision="float32")
    assert not torch.equal(found.last.weight, other.last.weight)


def test_bad_training_images_are_errors():
    with pytest.raises(EncoderInputError, match=r"multiples of 16, not uint8 \[2, 24, 32, 4\]"):
        train_segmenter(np.zeros((2, 24, 32, 4), np.uint8))
    with pytest.raises(EncoderInputError, match=r"not float64 \[2, 32, 32, 4\]"):
        train_segmenter(np.zeros((2, 32, 32, 4)))
    with pytest.raises(EncoderInputError, match="unknown precision 'half'"):
        train_segmenter(np.zeros((2, 32, 32, 4), np.uint8), precision="half")
