"""The same source on a GPU: the undecorated functions under Numba's CUDA simulator, against the CPU's frames."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.render.cuda import cases
from thalweg.render.batch import bands_of, draw
from thalweg.render.classes import BRIDGE, GROUND, PLANT, SKY, WATER
from thalweg.render.look import look_rows, look_values
from thalweg.render.scene import build_scene


def frames_of_the_cpu(quality: str) -> tuple[np.ndarray, np.ndarray]:
    """Frames [N, SIDE, SIDE] uint32, smaller than a `Camera` may be, and the class of each pixel."""
    count, side = len(cases.POSES), cases.SIDE
    images = np.zeros((count, side, side), np.uint32)
    looks = look_rows(look_values(cases.LOOKS, count), cases.CAMERA)
    near = np.float32(cases.CAMERA.near_m)
    layers = np.empty((count, side, side), np.float32), np.empty((count, side, side), np.uint8)
    scene = build_scene([cases.world()])  # also leaves the atlas in the cache, which the simulator is too slow to grow
    where = np.zeros(count, np.int64)
    draw(
        scene,
        where,
        cases.POSES,
        cases.TIMES,
        looks,
        (side, side, near, quality == "fast"),
        images,
        True,
        *layers,
        bands_of(side, 1, count),
    )
    return images, layers[1]


@pytest.mark.slow
@pytest.mark.parametrize("quality", ["full", "fast"])
def test_one_thread_a_pixel_in_the_simulator_draws_what_the_cpu_draws(tmp_path: Path, quality: str):
    images, classes = frames_of_the_cpu(quality)
    assert set(np.unique(classes)) == {SKY, WATER, GROUND, PLANT, BRIDGE}
    path = tmp_path / "simulated.npy"
    environment = os.environ | {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1", "PYTHONWARNINGS": "ignore"}
    command = [sys.executable, "-m", "tests.render.cuda.simulate", str(path), quality]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=Path(__file__).parents[3])
    assert done.returncode == 0, done.stderr
    ours, simulated = (a.view(np.uint8).reshape(*a.shape, 4).astype(int) for a in (images, np.load(path)))
    assert ours[..., :3].std() > 30
    np.testing.assert_array_equal(ours[..., 3], simulated[..., 3])
    apart = np.abs(ours - simulated)[..., :3]
    assert (apart <= 2).mean() > 0.999
    assert apart.max() <= 8
