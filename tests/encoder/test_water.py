"""Tests of the file of a segmenter of water, and of the images that it takes."""

import re
from pathlib import Path

import numpy as np
import pytest
import torch

from thalweg.encoder.files import FORMAT, read_tensors
from thalweg.encoder.vae import EncoderInputError
from thalweg.encoder.water import KIND, WaterSegmenter, load_segmenter, save_segmenter, water_in


def test_the_record_of_a_training_cannot_change_kind_and_format(tmp_path: Path):
    path = tmp_path / "water.safetensors"
    save_segmenter(path, WaterSegmenter(), {"kind": "another", "format": 0, "run": "mine"})
    about = read_tensors(path, KIND)[1]
    assert (about["kind"], about["format"], about["run"]) == (KIND, FORMAT, "mine")


def test_loading_one_leaves_the_global_generator_alone():
    before = torch.get_rng_state()
    load_segmenter()
    assert torch.equal(torch.get_rng_state(), before)


def test_no_images_have_an_empty_mask():
    found = water_in(WaterSegmenter().eval(), np.zeros((0, 20, 24, 3), np.uint8))
    assert found.shape == (0, 20, 24) and found.dtype == bool


@pytest.mark.parametrize("shape", [(20, 24, 3), (2, 20, 24), (2, 20, 24, 1), (2, 0, 24, 3)])
def test_colours_of_another_shape_are_refused_by_name(shape: tuple[int, ...]):
    with pytest.raises(EncoderInputError, match=re.escape(f"colours must be [K, H, W, 3], not {list(shape)}")):
        water_in(WaterSegmenter().eval(), np.zeros(shape, np.uint8))
