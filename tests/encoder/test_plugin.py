"""Tests of encoders from outside the package: what is asked of them, and what they return."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from tests.plugins import SQUARES, no_plugins  # noqa: F401  (a fixture)
from thalweg.core.plugins.lookup import add_files
from thalweg.core.plugins.record import PluginError
from thalweg.encoder import EncoderInputError, EncoderPlugin, PluginEncoder, encoder_names, encoder_plugin

pytestmark = pytest.mark.usefixtures("no_plugins")


@pytest.fixture
def squares(tmp_path: Path) -> PluginEncoder:
    """The encoder of docs/extend.md."""
    (tmp_path / "squares.py").write_text(SQUARES)
    add_files([tmp_path / "squares.py"])
    plugin = encoder_plugin("squares")
    assert plugin is not None
    return PluginEncoder(plugin)


def test_the_encoder_of_the_docs_averages_masks(squares: PluginEncoder):
    frames = np.zeros((2, 128, 128, 4), np.uint8)
    frames[1, :16, 16:24, 3] = 255  # half of the second square
    codes = squares(frames)
    assert (codes.shape, codes.dtype) == ((2, 64), np.float32)
    assert (codes[0].sum(), codes[1, 1], codes[1].sum()) == (0.0, 0.5, 0.5)
    np.testing.assert_array_equal(squares(frames[..., 3:]), codes)
    assert (squares.latent, squares.inputs, squares.identity) == (64, "mask", "squares 1")
    assert encoder_names() == ["default", "geometry", "geometry-tasks", "squares"]


def test_frames_of_another_size_are_refused_and_there_is_no_decoder(squares: PluginEncoder):
    with pytest.raises(EncoderInputError, match="this encoder takes frames of 128 x 128 pixels, not of 64 x 128"):
        squares(np.zeros((1, 64, 128, 4), np.uint8))
    with pytest.raises(EncoderInputError, match="the encoder squares of a plug-in has no decoder"):
        squares.decode(np.zeros((1, 64), np.float32))


@pytest.mark.parametrize(
    ("wrong", "found"),
    [
        (lambda frames: torch.zeros(len(frames), 3), r"torch.float32 \[1, 3\]"),
        (lambda frames: torch.zeros(len(frames), 64).double(), r"torch.float64 \[1, 64\]"),
        (lambda frames: None, "NoneType"),
    ],
)
def test_codes_of_another_shape_or_type_are_refused_by_name(squares: PluginEncoder, wrong: Any, found: str):
    squares.model = wrong
    words = rf"the encoder squares \(.*squares\.py, line 14\) must return float32 \[1, 64\] for 1 frames, not {found}"
    with pytest.raises(EncoderInputError, match=words):
        squares(np.zeros((1, 128, 128, 4), np.uint8))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"name": "default"}, "the encoder 'default' comes with the package"),
        ({"name": "render"}, "the encoder 'render' comes with the package"),
        ({"name": "Mine"}, "the name of the encoder is 'Mine'; it must begin with a small letter"),
        ({"version": 0}, "the encoder mine has the version 0"),
        ({"inputs": "depth"}, "inputs of mine are 'depth'; there are rgb, mask, rgb+mask"),
        ({"size_px": (96, 1.5)}, "size_px of mine: it must be a whole number from 16, or height and width"),
        ({"latent": 0}, "latent of mine is 0; it must be a whole number above 0"),
        ({"make": None}, "make of mine is None; it must be called as make(device)"),
    ],
)
def test_what_an_encoder_lacks_is_said(changes: dict[str, Any], words: str):
    given: dict[str, Any] = {"name": "mine", "make": lambda device: None, "latent": 2, "about": "a test", "version": 1}
    assert EncoderPlugin(**given).size_px == 128 and EncoderPlugin(**given, size_px=(96, 160)).size_px == (96, 160)
    with pytest.raises(PluginError, match=re.escape(words)):
        EncoderPlugin(**(given | changes))
