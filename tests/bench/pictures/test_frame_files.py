"""Tests of files of single frames."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from thalweg.bench.pictures.frame_files import FARTHEST, SKY, depth_pixels
from thalweg.cli.main import main
from thalweg.env import sample_starts
from thalweg.render import Camera, Renderer
from thalweg.world import World


def test_depths_are_centimetres_of_16_bits_and_the_sky_is_apart():
    found = depth_pixels(np.array([[-1.0, 0.0, 1.234, 655.34, 2000.0]], np.float32))
    assert found.dtype == np.uint16
    assert found.tolist() == [[SKY, 0, 123, FARTHEST, FARTHEST]]


def test_every_layer_of_a_frame_and_its_pose_are_written(
    tmp_path: Path, easy_world: World, capsys: pytest.CaptureFixture
):
    folder = tmp_path / "frames"
    options = ["--level", "easy", "--count", "2", "--size", "32", "--out", str(tmp_path / "sheet.png")]
    assert main(["render", *options, "--frames", str(folder)]) == 0
    names = {f"000{index}{layer}.png" for index in (0, 1) for layer in ("", "-mask", "-depth", "-class")}
    assert {path.name for path in folder.iterdir()} == names | {"poses.csv"}
    poses = sample_starts(easy_world, 2, 0)
    table = np.loadtxt(folder / "poses.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(table, np.column_stack([[0, 1], poses]))
    frame = Renderer([easy_world], Camera(32, 32)).render_layers(poses)
    for index in (0, 1):
        layers = {name: np.asarray(Image.open(folder / f"000{index}{name}.png")) for name in ("", "-mask", "-class")}
        np.testing.assert_array_equal(layers[""], frame.rgb[index])
        np.testing.assert_array_equal(layers["-mask"], frame.mask[index] * 255)
        np.testing.assert_array_equal(layers["-class"], frame.class_id[index])
        depth = np.asarray(Image.open(folder / f"000{index}-depth.png"))
        np.testing.assert_array_equal(depth == SKY, frame.depth_m[index] < 0)
        seen = frame.depth_m[index] >= 0
        np.testing.assert_allclose(depth[seen] / 100.0, np.minimum(frame.depth_m[index][seen], 655.34), atol=0.0051)
