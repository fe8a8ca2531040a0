"""Tests of frames drawn together: batch size, order, threads and bands of rows change nothing."""

import numpy as np
import pytest

from tests.render.frames import ARCH, on_river
from tests.render.plain import plane, plants_at
from thalweg.core.compute.threads import get_num_threads, set_num_threads
from thalweg.render import Camera, Frame, Renderer
from thalweg.render.batch import bands_of
from thalweg.render.kernels.shading.background import ROWS_TOGETHER
from thalweg.render.records.classes import BRIDGE, GROUND, PLANT, SKY, WATER


@pytest.mark.slow
def test_a_frame_does_not_depend_on_batch_order_or_threads(easy_world):
    other = plane(bridges=ARCH, water_level=-0.1)
    renderer = Renderer([easy_world, other], Camera(64, 64))
    poses = np.vstack([on_river(easy_world, 5, 7), [[-6, 4.0, 1.2, -0.5]]])
    index = np.array([0, 0, 0, 0, 0, 1])
    times = np.linspace(0, 9, 6)
    whole = renderer.render(poses, index, times)
    turned = renderer.render(poses[::-1], index[::-1], times[::-1])[::-1]
    np.testing.assert_array_equal(whole, turned)
    for k in range(6):
        np.testing.assert_array_equal(
            whole[k : k + 1], renderer.render(poses[k : k + 1], index[k : k + 1], times[k : k + 1])
        )
    np.testing.assert_array_equal(whole[5], Renderer([other], Camera(64, 64)).render(poses[5:], None, times[5:])[0])
    before = get_num_threads()
    if before < 2:
        pytest.skip("one thread only: nothing to compare with")
    set_num_threads(1)
    try:
        np.testing.assert_array_equal(whole, renderer.render(poses, index, times))
    finally:
        set_num_threads(before)


@pytest.mark.slow
@pytest.mark.parametrize(("quality", "height"), [("full", 72), ("fast", 72), ("full", 57), ("fast", 57)])
def test_threads_that_share_a_frame_draw_what_one_draws(easy_world, quality, height):
    world = plane(bridges=ARCH, water_level=-0.1, slope_x=0.02, plants=plants_at([(9.0, 2.0), (30.0, -4.0)], kind=2))
    renderer = Renderer([easy_world, world], Camera(height, 64), quality)
    poses = np.vstack([on_river(easy_world, 2, 8), [[-6, 4.0, 1.2, -0.5]]])
    kinds = set()
    for pose, where in zip(poses, ([0], [0], [1]), strict=True):
        whole, *parts = (
            drawn_in(renderer, pose[None], where, bands_of(height, threads, 1)) for threads in (1, 2, 3, 16)
        )
        kinds |= set(np.unique(whole.class_id))
        for part in parts:
            np.testing.assert_array_equal(whole.rgb, part.rgb)
            np.testing.assert_array_equal(whole.depth_m, part.depth_m)
            np.testing.assert_array_equal(whole.class_id, part.class_id)
    assert kinds == {SKY, WATER, GROUND, PLANT, BRIDGE}


def drawn_in(renderer: Renderer, poses: np.ndarray, index: list[int], bands: np.ndarray) -> Frame:
    """Layers drawn in these bands of rows."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("thalweg.render.renderer.bands_of", lambda *_: bands)
        return renderer.render_layers(poses, index)


@pytest.mark.parametrize(
    ("height", "threads", "frames"), [(128, 2, 1), (128, 16, 1), (72, 3, 2), (16, 8, 1), (33, 2, 1)]
)
def test_bands_share_all_rows_out_and_begin_where_tiles_do(height, threads, frames):
    bands = bands_of(height, threads, frames)
    rows = np.concatenate([np.arange(first, last) for first, last in bands])
    np.testing.assert_array_equal(np.sort(rows), np.arange(height))
    assert (bands[:, 0] % ROWS_TOGETHER == 0).all()
    assert len(bands) >= min(threads, height // ROWS_TOGETHER)


def test_enough_frames_for_all_threads_are_not_divided():
    np.testing.assert_array_equal(bands_of(128, 2, 2), [[0, 128]])
    np.testing.assert_array_equal(bands_of(128, 2, 1), [[0, 32], [96, 128], [32, 64], [64, 96]])
