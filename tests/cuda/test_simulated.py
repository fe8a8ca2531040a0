"""Tests that kernels under Numba's CUDA simulator give the results of the CPU."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.cuda import cases
from thalweg.render import Renderer
from thalweg.render.bake.scene_tables import build_scene
from thalweg.render.batch import bands_of, draw
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.render.records.classes import BRIDGE, BUOY, GROUND, KAYAK, PLANT, SKY, STATION, SWIMMER, WATER
from thalweg.render.records.props import NO_PROPS
from thalweg.render.records.view import COLOURS, FrameSettings, Views, output

ROOT = Path(__file__).parents[2]


def simulated(module: str, *arguments: str) -> None:
    """Run a module of this folder in a process whose kernels are plain Python."""
    environment = os.environ | {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1", "PYTHONWARNINGS": "ignore"}
    command = [sys.executable, "-m", f"tests.cuda.{module}", *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr


def frames_of_the_cpu(quality: str, props: np.ndarray = NO_PROPS) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frames [N, SIDE, SIDE] uint32, smaller than a `Camera` may be, and the depth and class of each pixel."""
    count, side = len(cases.POSES), cases.SIDE
    images = np.zeros((count, side, side), np.uint32)
    looks = look_rows(look_values(cases.LOOKS, count), cases.CAMERA)
    settings = FrameSettings(side, side, np.float32(cases.CAMERA.near_m), quality == "fast")
    layers = np.empty((count, side, side), np.float32), np.empty((count, side, side), np.uint8)
    scene = build_scene(cases.drawn_worlds())
    bands = bands_of(side, 1, count)
    views = Views(cases.WORLD_INDEX, cases.POSES, cases.TIMES, looks)
    draw(scene, views, settings, output(COLOURS, images, None, layers), bands, props)
    return images, *layers


@pytest.mark.slow
@pytest.mark.parametrize("quality", ["full", "fast"])
def test_frames_and_layers_equal_those_of_the_cpu(tmp_path: Path, quality: str):
    images, depth, classes = frames_of_the_cpu(quality)
    assert set(np.unique(classes)) == {SKY, WATER, GROUND, PLANT, BRIDGE}
    path = tmp_path / "simulated.npz"
    # Plants, clouds and canopies are baked by compiled kernels, which are far too slow in the simulator.
    np.savez(tmp_path / "scene.npz", **build_scene(cases.drawn_worlds())._asdict())
    simulated("simulate_frames", str(path), str(tmp_path / "scene.npz"), quality)
    found = np.load(path)
    ours = check_images(images, found["images"])
    assert ours[..., :3].std() > 30
    if quality == "fast":
        wanted = Renderer(cases.drawn_worlds(), cases.CAMERA, "fast").render_layers(
            cases.POSES[:1], look=cases.LOOKS[:1]
        )
        assert np.abs(found["rgb"].astype(int) - wanted.rgb).max() <= 8
        np.testing.assert_array_equal(found["class_id"], wanted.class_id)
        np.testing.assert_allclose(found["depth_m"], wanted.depth_m, rtol=1e-5)
        np.testing.assert_array_equal(found["public_mask"] > 0, wanted.mask)
    np.testing.assert_array_equal(found["only_mask"], ours[..., 3])
    for alone in ("", "alone_"):
        np.testing.assert_array_equal(found[f"{alone}mask"], ours[..., 3])
        np.testing.assert_array_equal(found[f"{alone}kind"], classes)
        np.testing.assert_allclose(found[f"{alone}depth"], depth, rtol=1e-5)
    images, depth, shown = frames_of_the_cpu(quality, cases.PROPS)
    assert {SWIMMER, KAYAK, BUOY, STATION} & set(np.unique(shown)) and (shown != classes).any()
    ours = check_images(images, found["props_images"])
    for mask in ("props_mask", "props_only_mask"):
        np.testing.assert_array_equal(found[mask], ours[..., 3])
    np.testing.assert_array_equal(found["props_kind"], shown)
    np.testing.assert_allclose(found["props_depth"], depth, rtol=1e-4)


def check_images(images: np.ndarray, simulated: np.ndarray) -> np.ndarray:
    """Compare images [N, SIDE, SIDE] uint32 of the CPU with simulated ones; returns the CPU's as [N, SIDE, SIDE, 4]."""
    ours, theirs = (a.view(np.uint8).reshape(*a.shape, 4).astype(int) for a in (images, simulated))
    np.testing.assert_array_equal(theirs[..., 3], ours[..., 3])
    apart = np.abs(ours - theirs)[..., :3]
    assert (apart <= 2).mean() > 0.999
    assert apart.max() <= 8
    return ours


@pytest.mark.slow
@pytest.mark.parametrize("task", ["River", "Swimmers", "Nests", "RacingLine", "Portage"])
def test_flights_equal_those_of_the_cpu(tmp_path: Path, task: str):
    path = tmp_path / "flown.npz"
    simulated("simulate_rules", str(path), task)
    found, wanted = np.load(path), cases.flown(task)
    assert len(set(wanted["reason"].ravel())) >= 3 and (wanted["costs"].sum((0, 1)) > 0).all()
    np.testing.assert_array_equal(found["reason"], wanted["reason"])
    np.testing.assert_array_equal(found["costs"], wanted["costs"])
    np.testing.assert_array_equal(found["reward"], wanted["reward"])
    np.testing.assert_allclose(found["pose"], wanted["pose"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found["seen"], wanted["seen"], rtol=0, atol=1e-5)
    np.testing.assert_allclose(found["felt"], wanted["felt"], rtol=0, atol=1e-5)
    assert wanted["felt"].std((0, 1)).min() > 0.1
    assert wanted["seen"][..., 5:].std((0, 1)).min() == 0 < wanted["seen"][..., :5].std((0, 1)).min()


@pytest.mark.slow
def test_flights_under_wind_current_and_inertia_equal_those_of_the_cpu(tmp_path: Path):
    path = tmp_path / "flown.npz"
    simulated("simulate_rules", str(path), "wind")
    found, wanted = np.load(path), cases.flown_in_wind()
    assert np.abs(wanted["wind"]).max() > 1 and np.abs(wanted["velocity"]).max() > 1
    for name, values in wanted.items():
        np.testing.assert_allclose(found[name], values, rtol=0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("windy", [False, True])
def test_boats_go_where_those_of_the_cpu_go_and_see_what_they_see(tmp_path: Path, windy: bool):
    path = tmp_path / "flown.npz"
    simulated("simulate_rules", str(path), "boats in wind" if windy else "boats")
    found, wanted = np.load(path), cases.flown_by_boats(windy)
    assert len(set(wanted["done_reason"].ravel())) >= 3 and wanted["seen"].std((0, 1)).max() > 0.1
    for name, values in wanted.items():
        np.testing.assert_allclose(found[name], values, rtol=0, atol=1e-5 if name == "seen" else 1e-9)
