"""Tests of whole frames, against the reference renderer."""

import numpy as np
import pytest

from tests.render.frames import ARCH, on_river, psnr
from tests.render.plain import plane, plants_at
from thalweg.render import Camera, Renderer
from thalweg.render.reference import frame as reference


@pytest.mark.slow
def test_the_kernel_agrees_with_the_reference_where_the_water_falls(hard_world):
    river = hard_world.river
    steepest = int(np.argmax(np.abs(np.diff(river.level_m))))
    at = (steepest - 6) % len(river.arc_m)
    along = river.position_m[steepest] - river.position_m[at]
    pose = np.array([*river.position_m[at], river.level_m[at] + 4.0, np.arctan2(along[1], along[0])])
    camera = Camera(32, 32)
    ours = Renderer([hard_world], camera).render_layers(pose[None])
    truth = reference.draw(hard_world, pose, camera, samples=4)
    assert psnr(ours.rgb[0], truth.rgb) > 22.0
    assert np.mean(ours.mask[0] == truth.mask) > 0.98


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 4, 5])
def test_the_kernel_agrees_with_the_reference(easy_world, seed):
    camera = Camera(32, 32)
    pose = on_river(easy_world, 1, seed)
    ours = Renderer([easy_world], camera).render_layers(pose)
    truth = reference.draw(easy_world, pose[0], camera, samples=4)
    assert psnr(ours.rgb[0], truth.rgb) > 22.0
    assert np.mean(ours.mask[0] == truth.mask) > 0.99
    assert np.mean(ours.class_id[0] == truth.class_id) > 0.95


def test_time_moves_the_ripples_and_nothing_else():
    renderer = Renderer([plane(slope_x=0.1, water_level=0.0)], Camera(64, 64))
    pose = [[-6.0, 0.0, 2.0, 0.0]]
    now, later = renderer.render(pose, time_s=0.0)[0], renderer.render(pose, time_s=3.0)[0]
    wet = now[..., 3] == 255
    assert (now[..., :3] != later[..., :3]).any(axis=-1)[wet].mean() > 0.5
    # The mean of the frame sets the exposure, so that dry ground may shift by a shade.
    assert np.abs(now[..., :3].astype(int) - later[..., :3])[~wet].max() <= 3


@pytest.mark.parametrize(
    ("size", "quality", "least_db"),
    [((40, 72), "full", 24.0), ((72, 40), "full", 24.0), ((33, 57), "full", 24.0), ((33, 57), "fast", 20.0)],
)
@pytest.mark.slow
def test_sizes_need_not_be_multiples_of_anything(size, quality, least_db):
    world = plane(slope_x=0.1, water_level=0.0, bridges=ARCH, plants=plants_at([(9.0, 2.0)], kind=2))
    camera = Camera(*size)
    pose = np.array([-4.0, -3.0, 2.5, 0.3])
    ours = Renderer([world], camera, quality).render(pose[None])[0]
    truth = reference.draw(world, pose, camera, samples=3)
    assert ours.shape == (*size, 4)
    assert psnr(ours[..., :3], truth.rgb) > least_db
    assert np.mean((ours[..., 3] == 255) == truth.mask) > 0.99
