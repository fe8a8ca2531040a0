"""Tests of checkpoints of encoders that are damaged, but are whole files: each is refused with what is wrong in it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import nn

from thalweg.encoder import EncoderFileError
from thalweg.encoder.checkpoint import check_folder, read_checkpoint, restore_state, state_tensors
from thalweg.encoder.files import FORMAT, write_tensors
from thalweg.encoder.geometry_training import GEOMETRY_FOLDER, KIND

ROW = {"epoch": 1, "loss": 0.5, "held_out": None}
MOMENTS = ("step", "exp_avg", "exp_avg_sq")
Tensors = dict[str, torch.Tensor]


def model() -> tuple[nn.Module, torch.optim.Adam]:
    """A layer after a step of Adam."""
    torch.manual_seed(0)
    layer = nn.Linear(3, 2)
    optimizer = torch.optim.Adam(layer.parameters(), 0.1)
    layer(torch.ones(1, 3)).sum().backward()
    optimizer.step()
    return layer, optimizer


def written(path: Path, change: Callable[[Tensors], Any] = lambda tensors: None, **about: Any) -> Path:
    """A checkpoint with the tensors that `change` leaves."""
    tensors = state_tensors(model()[0], "network.", model()[1])
    change(tensors)
    write_tensors(path, tensors, {"kind": KIND, "format": FORMAT, "run": {"seed": 1}, "rows": [ROW], **about})
    return path


def resumed(path: Path) -> list:
    tensors, rows, _ = read_checkpoint(path, KIND, tuple(ROW))
    restore_state(path, tensors, *model()[:1], "network.", model()[1])
    return rows


def test_a_whole_checkpoint_has_its_rows_and_what_the_run_says_of_itself(tmp_path: Path):
    path = written(tmp_path / "checkpoint.safetensors")
    assert resumed(path) == [ROW]
    assert read_checkpoint(path, KIND, tuple(ROW))[2] == {"seed": 1}


@pytest.mark.parametrize(
    ("about", "words"),
    [
        ({"run": [1]}, r"its run is \[1\], not a mapping"),
        ({"rows": {"a": 1}}, "its epochs are .*, not a list"),
        ({"rows": [ROW, 3]}, "its epoch 2 lacks a number of epoch, loss, held_out"),
        ({"rows": [{"epoch": 1, "loss": 0.5}]}, "its epoch 1 lacks a number"),
        ({"rows": [ROW | {"loss": "low"}]}, "its epoch 1 lacks a number"),
        ({"rows": [ROW | {"loss": 10**400}]}, "its epoch 1 lacks a number"),
        ({"rows": [ROW, ROW]}, "its epoch 2 is called 1"),
    ],
)
def test_rows_and_a_run_of_another_kind_are_refused(about: dict, words: str, tmp_path: Path):
    path = written(tmp_path / "checkpoint.safetensors", **about)
    with pytest.raises(EncoderFileError, match=rf"checkpoint\.safetensors: {words}.*train in a new folder"):
        resumed(path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda tensors: tensors.pop("adam.1.step"), "the tensors don't fit the model"),
        (lambda tensors: [tensors.pop(f"adam.1.{name}") for name in MOMENTS], "of 1 weights, of 2"),
        (lambda tensors: tensors.update({"adam.x.step": torch.ones(1)}), "the tensors don't fit the model"),
        (lambda tensors: tensors.update({"adam.7": torch.ones(1)}), "the tensors don't fit the model"),
        (lambda tensors: tensors.update({"adam.0.exp_avg": torch.ones(3, 2)}), r"exp_avg has shape \(3, 2\), not"),
        (lambda tensors: tensors.update({"adam.0.step": torch.ones(2)}), "Adam's steps are 2 numbers"),
        (lambda tensors: tensors.pop("network.bias"), "the tensors don't fit the model"),
        (lambda tensors: tensors["network.bias"].data.fill_(float("nan")), "network.bias holds numbers that are not"),
    ],
)  # fmt: skip
def test_tensors_that_do_not_fit_are_refused(change: Callable[[Tensors], Any], words: str, tmp_path: Path):
    path = written(tmp_path / "checkpoint.safetensors", change)
    with pytest.raises(EncoderFileError, match=rf"checkpoint\.safetensors: .*{words}"):
        resumed(path)


def test_the_folder_of_a_training_whose_run_is_no_mapping_is_refused(tmp_path: Path):
    written(tmp_path / GEOMETRY_FOLDER.record, run=3)
    with pytest.raises(EncoderFileError, match="its run is 3, not a mapping"):
        check_folder(tmp_path, GEOMETRY_FOLDER, {"seed": 1})
