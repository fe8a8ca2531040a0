"""Tests of primary hits, against planes worked out by hand."""

import numpy as np
import pytest

from tests.render.frames import rays
from tests.render.plain import plane
from thalweg.render import Camera, Renderer
from thalweg.render.records.classes import GROUND, SKY


@pytest.mark.parametrize("quality", ["full", "fast"])
@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.15, 0.0), (-0.1, 0.0), (-0.05, 0.12)])
def test_depth_on_a_plane_is_where_each_ray_meets_it(slope, quality):
    camera = Camera(48, 48)
    pose = np.array([1.3, -2.1, 3.0 + slope[0] * 1.3 - slope[1] * 2.1, 0.4])
    frame = Renderer([plane(slope_x=slope[0], slope_y=slope[1])], camera, quality).render_layers(pose[None])
    ray = rays(camera, pose[3])
    expected = 3.0 / np.maximum(ray[..., :2] @ slope - ray[..., 2], 1e-9)
    x, y = pose[0] + ray[..., 0] * expected, pose[1] + ray[..., 1] * expected
    # The reduced quality interpolates over the edge of the plane, where the ground turns level.
    edge = 49 if quality == "full" else 45
    inside = (expected < 100) & (np.abs(x) < edge) & (np.abs(y) < edge)
    assert inside.sum() > 800
    np.testing.assert_allclose(frame.depth_m[0][inside], expected[inside], rtol=2e-3, atol=2e-3)


def test_rays_above_the_horizon_of_a_flat_world_see_the_sky():
    camera = Camera(64, 64)
    frame = Renderer([plane()], camera).render_layers([[0.0, 0.0, 2.0, 0.0]])
    rises = rays(camera, 0.0)[..., 2] > 1e-3
    assert (frame.class_id[0][rises] == SKY).all()
    assert (frame.depth_m[0][rises] == -1).all()
    assert (frame.class_id[0][rays(camera, 0.0)[..., 2] < -0.05] == GROUND).all()


@pytest.mark.parametrize("quality", ["full", "fast"])
def test_the_mask_ends_where_the_ground_leaves_the_water(quality):
    camera = Camera(64, 64)
    world = plane(slope_x=0.1, water_level=0.0)
    pose = np.array([[-6.0, 0.0, 2.0, 0.0]])
    frame = Renderer([world], camera, quality).render_layers(pose)
    ray = rays(camera, 0.0)
    down = ray[..., 2] < -0.02
    shore_x = pose[0, 0] + ray[..., 0] * (2.0 / np.maximum(-ray[..., 2], 1e-9))
    np.testing.assert_array_equal(
        frame.mask[0][down & (np.abs(shore_x) > 0.02)], (shore_x < 0)[down & (np.abs(shore_x) > 0.02)]
    )
