"""Tests of `Renderer`: layers, and requests that are refused."""

import numpy as np
import pytest

from tests.render.frames import on_river
from tests.render.plain import plane
from thalweg.render import Camera, Renderer
from thalweg.render.records.classes import SKY, WATER
from thalweg.render.renderer import Layer


@pytest.mark.slow
def test_layers_do_not_change_the_picture(easy_world):
    renderer = Renderer([easy_world], Camera(64, 64))
    poses = on_river(easy_world, 3, 9)
    image, layers = renderer.render(poses), renderer.render_layers(poses)
    np.testing.assert_array_equal(image[..., :3], layers.rgb)
    np.testing.assert_array_equal(image[..., 3] == 255, layers.mask)
    assert set(np.unique(image[..., 3])) <= {0, 255}
    np.testing.assert_array_equal(layers.mask, layers.class_id == WATER)
    np.testing.assert_array_equal(layers.depth_m == -1, layers.class_id == SKY)


@pytest.mark.slow
def test_layers_that_are_not_asked_for_are_none_and_the_others_those_of_the_frame(easy_world):
    renderer = Renderer([easy_world], Camera(64, 64))
    poses = on_river(easy_world, 2, 4)
    whole = renderer.render_layers(poses)
    choices: list[tuple[Layer, ...]] = [("mask",), ("depth_m",), ("class_id", "mask"), ("rgb",), ("rgb", "depth_m")]
    for layers in choices:
        some = renderer.render_layers(poses, layers=layers)
        for name in ("rgb", "mask", "depth_m", "class_id"):
            if name in layers:
                np.testing.assert_array_equal(getattr(some, name), getattr(whole, name))
            else:
                assert getattr(some, name) is None


def test_bad_requests_name_the_value_and_what_would_be_right():
    renderer = Renderer([plane()], Camera(32, 32))
    with pytest.raises(ValueError, match=r"shape \[3\].*\[N, 4\]"):
        renderer.render([0.0, 0.0, 2.0])
    with pytest.raises(ValueError, match="pose 1 is not finite"):
        renderer.render([[0, 0, 2, 0], [0, np.nan, 2, 0]])
    with pytest.raises(ValueError, match=r"pose 1 holds 1e\+12; its numbers lie within ±1e\+06"):
        renderer.render([[0, 0, 2, 0], [0, 1e12, 2, 0]])
    for time_s in (np.nan, np.inf, 1e12, [-1e12]):
        with pytest.raises(ValueError, match=r"time_s holds (nan|inf|-?1e\+12); times lie within ±1e\+06 s"):
            renderer.render([[0, 0, 2, 0]], time_s=time_s)
    with pytest.raises(ValueError, match=r"time_s has shape \[2\]; it must be one number or \[1\]"):
        renderer.render([[0, 0, 2, 0]], time_s=[0.0, 1.0])
    for wind in ([[1e200, 0.0]], [[0.0, np.nan]], [0.0, 1.0]):
        with pytest.raises(ValueError, match=r"it must be \[1, 2\] in m/s east and north, within ±1000"):
            renderer.render([[0, 0, 2, 0]], wind=wind)
    with pytest.raises(ValueError, match=r"world_index must be whole numbers, not float64"):
        renderer.render([[0, 0, 2, 0]], [0.7])
    with pytest.raises(ValueError, match=r"world_index must be in 0\.\.0; got 1\.\.1"):
        renderer.render([[0, 0, 2, 0]], [1])
    with pytest.raises(ValueError, match=r"must be contiguous uint8 \[1, 32, 32, 4\]"):
        renderer.render([[0, 0, 2, 0]], out=np.zeros((1, 32, 32, 3), np.uint8))
    with pytest.raises(ValueError, match=r"must be contiguous uint8 \[1, 32, 32\]"):
        renderer.render_mask([[0, 0, 2, 0]], out=np.zeros((1, 32, 32, 1), np.uint8))
    with pytest.raises(ValueError, match=r"unknown layer 'depth'.*; known: rgb, mask, depth_m, class_id"):
        renderer.render_layers([[0, 0, 2, 0]], layers=("depth",))  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="name at least one of the layers rgb, mask, depth_m, class_id"):
        renderer.render_layers([[0, 0, 2, 0]], layers=())
    with pytest.raises(ValueError, match="at least one world"):
        Renderer([])
    with pytest.raises(ValueError, match="quality = 'quick': choose one of full, fast"):
        Renderer([plane()], Camera(32, 32), "quick")  # pyright: ignore[reportArgumentType]
