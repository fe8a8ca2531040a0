"""Tests of the training of the finder of water."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from thalweg.encoder import EncoderFileError, EncoderInputError
from thalweg.encoder.water import load_segmenter
from thalweg.train.encoder.water import WaterTraining, varied


def training(folder: Path, epochs: int = 2, **changes: int) -> WaterTraining:
    settings: dict[str, Any] = {"images": 8, "held_out": 4, **changes}
    settings |= {"world_seeds": (1000,), "held_out_seeds": (1001,)}
    return WaterTraining(folder, levels=("Easy",), epochs=epochs, **settings)


def test_varied_frames_keep_water_under_its_colours():
    frames = np.zeros((6, 32, 32, 4), np.uint8)
    frames[:, 16:, :, 2:] = 255  # blue where there is water
    colours, water = varied(frames, np.random.default_rng(0))
    assert colours.shape == (6, 3, 32, 32) and 0.1 < float(water.mean()) < 0.9
    inner = (colours[:, 2] < 0.2) | (colours[:, 2] > 0.7)  # edges are mixed
    np.testing.assert_array_equal(np.asarray(colours[:, 2] > 0.5)[inner], np.asarray(water > 0)[inner])


@pytest.mark.slow
def test_a_training_that_was_interrupted_ends_with_the_same_network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    whole, iou = training(tmp_path / "whole").run(progress=False)
    assert 0.0 <= iou <= 1.0 and load_segmenter(whole) is not None

    from thalweg.train.encoder import water

    real = water._State.epoch

    def once(self, frames, held_out, epoch, epochs):
        if epoch:
            raise KeyboardInterrupt
        return real(self, frames, held_out, epoch, epochs)

    monkeypatch.setattr(water._State, "epoch", once)
    with pytest.raises(KeyboardInterrupt):
        training(tmp_path / "cut").run(progress=False)
    monkeypatch.setattr(water._State, "epoch", real)
    resumed, again = training(tmp_path / "cut").run(progress=False)
    assert again == iou and resumed.read_bytes() == whole.read_bytes()
    with pytest.raises(EncoderFileError, match="seed is 0 there and 1 here"):
        training(tmp_path / "cut", seed=1).run(progress=False)


def test_numbers_and_seeds_that_do_not_fit_are_refused(tmp_path: Path):
    with pytest.raises(EncoderInputError, match="images must be at least 1, not 0"):
        training(tmp_path / "run", images=0).run()
    with pytest.raises(EncoderInputError, match="1000 is in both"):
        WaterTraining(tmp_path / "run", held_out_seeds=(1000,)).run()
    assert not (tmp_path / "run").exists()
