"""Tests of the file of a segmenter of water."""

from pathlib import Path

import torch

from thalweg.encoder.files import FORMAT, read_tensors
from thalweg.encoder.water import KIND, WaterSegmenter, load_segmenter, save_segmenter


def test_the_record_of_a_training_cannot_change_kind_and_format(tmp_path: Path):
    path = tmp_path / "water.safetensors"
    save_segmenter(path, WaterSegmenter(), {"kind": "another", "format": 0, "run": "mine"})
    about = read_tensors(path, KIND)[1]
    assert (about["kind"], about["format"], about["run"]) == (KIND, FORMAT, "mine")


def test_loading_one_leaves_the_global_generator_alone():
    before = torch.get_rng_state()
    load_segmenter()
    assert torch.equal(torch.get_rng_state(), before)
