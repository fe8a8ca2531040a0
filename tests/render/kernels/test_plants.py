"""Tests of drawn plants: their window, their depth and their order."""

import numpy as np
import pytest

from tests.render.frames import rays
from tests.render.plain import plane, plants_at
from thalweg.render import Camera, Renderer
from thalweg.render.records.classes import PLANT
from thalweg.render.reference import frame as reference
from thalweg.render.reference import plants as reference_plants


@pytest.mark.parametrize(("quality", "apart"), [("full", 1e-4), ("fast", 5e-3)])
def test_a_plant_covers_only_its_window_and_hides_what_is_behind(quality, apart):
    camera = Camera(96, 96)
    world = plane(plants=plants_at([(10.0, 0.0)], kind=0))
    pose = np.array([0.0, 0.0, 3.0, 0.0])
    frame = Renderer([world], camera, quality).render_layers(pose[None])
    seen = frame.class_id[0] == PLANT
    box = reference_plants.window(
        np.array([10.0, 0.0, -3.0]),
        8.0,
        2.0,
        reference.axes(0.0, np.radians(20)),
        camera,
        camera.height_px,
        camera.width_px,
    )
    assert box is not None
    outside = seen.copy()
    outside[box] = False
    assert seen.sum() > 100
    assert not outside.any()
    ray = rays(camera, 0.0)
    np.testing.assert_allclose(frame.depth_m[0][seen], (10.0 / ray[..., 0])[seen], rtol=apart)


def test_a_nearer_plant_is_drawn_over_a_farther_one_whatever_their_order():
    near_first = plane(plants=plants_at([(8.0, 0.3), (12.0, -0.3)], kind=1))
    far_first = plane(plants=plants_at([(12.0, -0.3), (8.0, 0.3)], kind=1))
    pose = [[0.0, 0.0, 3.0, 0.0]]
    np.testing.assert_array_equal(Renderer([near_first]).render(pose), Renderer([far_first]).render(pose))
