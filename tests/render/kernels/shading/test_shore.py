"""Tests of the shore line, against the shares of water that many rays through a pixel find."""

import numpy as np
import pytest

from tests.render.frames import posed, rays
from tests.render.plain import plane
from thalweg.render import Camera, Renderer
from thalweg.render.kernels.camera_rays import map_origin
from thalweg.render.kernels.shading.shore import water_shares
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.render.records.view import View

f32 = np.float32
FINE = 16
"""Rays along each side of a pixel."""


def shares(world, camera, pose):
    """The kernel's share of water [H, W] in each pixel, and the class."""
    renderer = Renderer([world], camera)
    frame = renderer.render_layers(pose[None])
    look = look_rows(look_values(None, 1), camera)[0]
    view = View(0, look, posed(pose, look, camera), f32(0))
    origin = map_origin(renderer.scene, view)
    origin = origin._make(f32(value) for value in origin)
    share = np.empty((camera.height_px, camera.width_px), f32)
    # The places of a row's pixels, counted from that row on, are their columns.
    columns = np.arange(camera.width_px, dtype=np.int32)
    for row in range(camera.height_px):
        depth = np.maximum(frame.depth_m[0, row], 0).astype(f32)
        water_shares(
            renderer.scene, view, origin, row, columns, depth, frame.class_id[0, row], share[row], camera.width_px
        )  # fmt: skip
    return share, frame.class_id[0]


@pytest.mark.parametrize("yaw", [0.1, 0.5, 1.4, 2.6])
def test_a_pixel_on_the_shore_has_the_share_of_water_that_rays_find(yaw):
    # Water for x < 0; the bank rises by a tenth.
    world, camera = plane(slope_x=0.1, water_level=0.0), Camera(40, 40)
    pose = np.array([-4.0 if abs(yaw) < 1.5 else 3.0, 0.0, 2.0, yaw])
    share, kind = shares(world, camera, pose)
    ray = rays(Camera(40 * FINE, 40 * FINE), yaw)
    # A ray meets the higher of level water and bank.
    height = 2.0
    to_water = height / np.maximum(-ray[..., 2], 1e-9)
    wet = (pose[0] + ray[..., 0] * to_water < 0) & (ray[..., 2] < 0)
    expected = wet.reshape(40, FINE, 40, FINE).mean(axis=(1, 3))
    surface = (kind == 1) | (kind == 2)
    down = surface & (rays(camera, yaw)[..., 2] < -0.1)
    shore = down & (expected > 0.05) & (expected < 0.95)
    assert shore.sum() >= 10
    assert np.abs(share - expected)[shore].max() < 0.08
    assert np.abs(share - expected)[shore].mean() < 0.03
    clear = down & ((expected == 0) | (expected == 1))
    assert np.abs(share - expected)[clear].max() < 0.02
    assert ((share > 0.5) == (kind == 1))[down & (np.abs(share - 0.5) > 1e-3)].all()
