"""Tests of the march over the height field, against the reference renderer."""

import numpy as np
import pytest

from tests.render.frames import on_river, posed, rays
from thalweg.render import Camera, Renderer
from thalweg.render.kernels.camera_rays import Origin, Rays, square_rays
from thalweg.render.kernels.terrain import heightfield_march
from thalweg.render.kernels.terrain.heightfield_march import TILE
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.render.reference import frame as reference


@pytest.mark.slow
def test_bundles_of_rays_start_no_farther_than_the_nearest_surface(hard_world):
    renderer = Renderer([hard_world], Camera(64, 64))
    scene, world = renderer.scene, hard_world
    inv_cell = np.float32(1 / world.grid.cell_m)
    look = look_rows(look_values(None, 1), renderer.camera)[0]
    starts = []
    for pose in on_river(world, 6, 2):
        camera = posed(pose, look, renderer.camera)
        rays_of_tiles = Rays(*np.empty((3, 8), np.float32))
        origin = Origin(
            (camera.x - np.float32(world.grid.origin_x_m)) * inv_cell,
            (camera.y - np.float32(world.grid.origin_y_m)) * inv_cell,
            camera.z,
        )
        spread = heightfield_march.bundle_spread(camera)
        depth = reference.meet_ground(reference.Materials(world, look), pose[:3], rays(renderer.camera, pose[3]), 0.3)
        nearest = depth.reshape(8, TILE, 8, TILE).min(axis=(1, 3))
        for row in range(8):
            square_rays(camera, row * TILE, TILE, inv_cell, rays_of_tiles, 0, 8)
            start = np.full(8, 0.3, np.float32)
            heightfield_march.advance_bundles(scene, 0, origin, np.float32(spread), rays_of_tiles, start, 8)
            assert (start <= nearest[row] + 1e-3).all()
            starts.append(start)
    assert np.median(starts) > 3.0
