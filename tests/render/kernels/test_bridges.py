"""Tests of drawn bridges, against dense sampling."""

import numpy as np
import pytest

from tests.render.frames import ARCH, rays
from tests.render.plain import plane
from thalweg.render import Camera, Renderer
from thalweg.render.records.classes import BRIDGE
from thalweg.render.reference import bridge as reference_bridge


@pytest.mark.slow
def test_a_bridge_is_where_dense_sampling_finds_it():
    world = plane(bridges=ARCH, water_level=-0.1)
    camera = Camera(64, 64)
    poses = np.array([[-6, 4.0, 1.2, -0.5], [5.0, 9.0, 3.5, -2.0], [0.5, -8.0, 1.0, 1.6], [-1.0, 1.0, 4.0, 0.0]])
    frames = Renderer([world], camera).render_layers(poses)
    for pose, kinds, depth in zip(poses, frames.class_id, frames.depth_m, strict=True):
        expected, _, _ = reference_bridge.meet_bridge(
            ARCH[0], pose[:3], rays(camera, pose[3]), camera.near_m, np.full((64, 64), 400.0)
        )
        ground = np.where(rays(camera, pose[3])[..., 2] < 0, -pose[2] / rays(camera, pose[3])[..., 2], np.inf)
        met = expected < ground
        assert (kinds == BRIDGE).sum() > 150
        assert np.mean(met == (kinds == BRIDGE)) > 0.99
        both = met & (kinds == BRIDGE)
        assert np.median(np.abs(depth[both] - expected[both])) < 1e-3
        assert np.quantile(np.abs(depth[both] - expected[both]), 0.97) < 0.05


def test_the_nearer_of_two_bridges_is_seen_whatever_their_order():
    behind = ARCH.copy()
    behind[0, 1] = 7.0
    pose = np.array([[0.5, -8.0, 3.2, 1.6]])
    frames = [
        Renderer([plane(bridges=np.vstack(pair), water_level=-0.1)], Camera(64, 64)).render_layers(pose)
        for pair in ((ARCH, behind), (behind, ARCH))
    ]
    assert (frames[0].class_id == BRIDGE).sum() > 150
    np.testing.assert_array_equal(frames[0].rgb, frames[1].rgb)
    np.testing.assert_array_equal(frames[0].depth_m, frames[1].depth_m)
