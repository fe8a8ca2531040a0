"""Tests of layers without colours: masks equal those of whole frames to the bit, depth and class those of layers."""

import numpy as np
import pytest

from tests.render.frames import ARCH, on_river
from tests.render.plain import plane, plants_at
from thalweg.core.compute.threads import get_num_threads, set_num_threads
from thalweg.render import Camera, Look, Renderer
from thalweg.render.batch import bands_of
from thalweg.render.kernels.layers import asked_depth
from thalweg.render.records.classes import BRIDGE, GROUND, PLANT, SKY, WATER

LOOKS = [
    Look(),
    Look(pitch_deg=25.0, fov_deg=-20.0),
    Look(pitch_deg=-18.0, fov_deg=25.0),
    Look(plant_density=0.3, haze=8.0, season=1.0, noise=9.0),
    Look(plant_density=0.0, pitch_deg=8.0),
    Look(fov_deg=50.0),
]


def anywhere(world, count: int, seed: int) -> np.ndarray:
    """Poses over the water and over the land beside it, at all heights and headings."""
    rng = np.random.default_rng(seed)
    poses = on_river(world, count, seed)
    poses[:, :2] += rng.normal(0.0, 3.0, (count, 2))
    poses[:, 2] += rng.uniform(-0.5, 4.0, count)
    poses[:, 3] = rng.uniform(-np.pi, np.pi, count)
    return poses


@pytest.mark.slow
@pytest.mark.parametrize("quality", ["full", "fast"])
@pytest.mark.parametrize(("height", "width"), [(128, 128), (57, 70)])
def test_a_mask_is_the_fourth_channel_of_the_frame(easy_world, hard_world, quality, height, width):
    renderer = Renderer([easy_world, hard_world], Camera(height, width), quality)
    count = 240
    poses = np.vstack([anywhere(easy_world, count // 2, 11), anywhere(hard_world, count // 2, 12)])
    index = np.repeat([0, 1], count // 2)
    looks = [LOOKS[k % len(LOOKS)] for k in range(count)]
    frames = renderer.render(poses, index, look=looks)
    masks = renderer.render_mask(poses, index, look=looks)
    np.testing.assert_array_equal(masks, frames[..., 3])
    assert 0.1 < (masks > 0).mean() < 0.9
    for k in range(0, count, 40):
        alone = renderer.render_mask(poses[k : k + 1], index[k : k + 1], look=looks[k])
        np.testing.assert_array_equal(alone[0], masks[k])


@pytest.mark.slow
@pytest.mark.parametrize("quality", ["full", "fast"])
def test_a_mask_does_not_depend_on_threads_or_bands(easy_world, quality):
    renderer = Renderer([easy_world], Camera(72, 64), quality)
    poses = anywhere(easy_world, 6, 3)
    whole = renderer.render_mask(poses)
    before = get_num_threads()
    set_num_threads(1)
    try:
        np.testing.assert_array_equal(renderer.render_mask(poses), whole)
    finally:
        set_num_threads(before)
    for threads in (2, 3, 16):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("thalweg.render.renderer.bands_of", lambda *_, t=threads: bands_of(72, t, 1))
            np.testing.assert_array_equal(renderer.render_mask(poses), whole)


@pytest.mark.slow
@pytest.mark.parametrize("quality", ["full", "fast"])
def test_depth_and_class_without_colours_are_those_of_the_frame(easy_world, quality):
    slope = plane(bridges=ARCH, water_level=-0.1, slope_x=0.02, plants=plants_at([(9.0, 2.0), (30.0, -4.0)], kind=2))
    renderer = Renderer([easy_world, slope], Camera(70, 57), quality)
    poses = np.vstack([anywhere(easy_world, 20, 5), [[-6, 4.0, 1.2, -0.5]]])
    index = np.array([0] * 20 + [1])
    frame = renderer.render_layers(poses, index)
    ours = renderer.render_layers(poses, index, layers=("depth_m", "class_id", "mask"))
    assert set(np.unique(frame.class_id)) == {SKY, WATER, GROUND, PLANT, BRIDGE}
    np.testing.assert_array_equal(ours.class_id, frame.class_id)
    np.testing.assert_array_equal(ours.mask, frame.mask)
    np.testing.assert_array_equal(ours.depth_m, frame.depth_m)


@pytest.mark.slow
def test_bridges_hide_water_in_a_mask():
    renderer = Renderer([plane(bridges=ARCH, water_level=0.5), plane(water_level=0.5)], Camera(64, 64))
    poses = np.array([[-12.0, 0.0, 2.5, 0.0]] * 2)
    with_bridge, without = renderer.render_mask(poses, [0, 1]) > 0
    assert 100 < (without & ~with_bridge).sum() < 2000
    assert not (with_bridge & ~without).any()


def test_only_water_is_asked_for_in_a_mask():
    depth = np.arange(1, 9, dtype=np.float32).reshape(2, 4)
    kind = np.array([[WATER, SKY, WATER, WATER], [GROUND, WATER, BRIDGE, WATER]], np.uint8)
    behind = np.empty((2, 4), np.float32)
    asked_depth(depth, kind, True, behind)
    np.testing.assert_array_equal(behind, [[1, 0, 3, 4], [0, 6, 0, 8]])
    asked_depth(depth, kind, False, behind)
    np.testing.assert_array_equal(behind, depth)
