"""Tests of what water mirrors, against walls worked out by hand and the reference renderer."""

from dataclasses import replace

import numpy as np
import pytest

from tests.render.plain import CELL_M, HALF_M, NODES, plane
from thalweg.render import Camera
from thalweg.render.bake.scene_tables import build_scene
from thalweg.render.kernels.camera_rays import HitPoints, Radiance
from thalweg.render.kernels.shading.mirror import Mirrored, mirror_canopy
from thalweg.render.kernels.shading.water import Surface
from thalweg.render.kernels.shading.water_optics import ROUGHNESS
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.render.records.view import View
from thalweg.render.reference.materials import Materials

f32 = np.float32
LOOK = look_rows(look_values(None, 1), Camera())[0]


def wall(height=6.0, at=10.0):
    """Water with a wall of ground of this height from x = at on."""
    world = plane(water_level=0.0)
    ground = np.full((NODES, NODES), -1.0, f32)
    ground[:, np.arange(NODES) * CELL_M - HALF_M >= at] = height
    return replace(world, ground_m=ground, canopy_m=np.maximum(ground, world.water_m))


def mirrored(world, points, rays):
    """The kernel's radiance of canopies [n, 3] and passing share [n], for points [n, 2] in metres and unit rays."""
    scene = build_scene([world])
    n = len(points)
    node = ((points + HALF_M) / CELL_M).T.astype(f32)
    zero = np.zeros(n, f32)
    hits = HitPoints(node[0].copy(), node[1].copy(), zero, zero, zero, zero, zero)
    ray = rays.T.astype(f32)
    rough = np.full(n, ROUGHNESS, f32)
    surface = Surface(zero, zero, rough, zero, ray[0].copy(), ray[1].copy(), ray[2].copy())
    out = Mirrored(*np.empty((4, n), f32))
    scratch = Radiance(*np.empty((3, n), f32))
    mirror_canopy(scene, View(0, LOOK, None, f32(0)), hits, f32(0), surface, out, scratch, n)
    return np.stack([out.red, out.green, out.blue], axis=1), out.passing


def towards(x, angle):
    """Unit rays [n, 3] that rise by angles [n] towards x (1 or -1)."""
    return np.stack([x * np.cos(angle), np.zeros_like(angle), np.sin(angle)], axis=1)


@pytest.mark.parametrize("apart", [1.5, 4.0, 9.0, 25.0])
def test_a_wall_is_mirrored_up_to_its_top(apart):
    angle = np.linspace(0.02, 1.3, 200)
    points = np.tile([10.0 - apart, 0.3], (200, 1))
    light, passing = mirrored(wall(), points, towards(1, angle))
    top = np.arctan2(6.0, apart)
    assert (passing[angle < top - 0.12] < 0.01).all()
    assert (passing[angle > top + 0.15] > 0.99).all()
    assert (light[angle < top - 0.12] > 0.05).all()
    assert (light[angle > top + 0.15] < 0.01).all()


def test_open_water_is_not_mirrored():
    angle = np.linspace(0.02, 1.3, 50)
    _, passing = mirrored(plane(water_level=0.0, slope_x=1e-4), np.tile([-3.0, 0.0], (50, 1)), towards(-1, angle))
    assert (passing == 1).all()


def test_the_kernel_agrees_with_the_reference(easy_world):
    rng = np.random.default_rng(4)
    wet = np.argwhere(easy_world.water_m > easy_world.ground_m + 0.05)
    row, column = wet[rng.integers(0, len(wet), 4000)].T
    grid = easy_world.grid
    points = np.stack([column, row], axis=1) * grid.cell_m + (grid.origin_x_m, grid.origin_y_m)
    turn, rise = rng.uniform(0, 2 * np.pi, 4000), rng.uniform(0.02, 0.9, 4000)
    rays = np.stack([np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)], axis=1)
    scene_points = (points - (grid.origin_x_m, grid.origin_y_m)) / grid.cell_m * CELL_M - HALF_M
    light, passing = mirrored(easy_world, scene_points, rays)
    materials = Materials(easy_world, LOOK.astype(np.float64))
    level = easy_world.water_m[row, column].astype(float)
    expected, expected_passing = materials.mirrored(np.column_stack([points, level]), rays)
    expected -= materials.sky(rays) * expected_passing[:, None]
    assert np.mean(np.abs(passing - expected_passing) < 0.1) > 0.93
    assert np.abs(passing - expected_passing).mean() < 0.03
    np.testing.assert_allclose(light.mean(axis=0), expected.mean(axis=0), rtol=0.08)
    assert np.corrcoef(light[:, 1], expected[:, 1])[0, 1] > 0.85
