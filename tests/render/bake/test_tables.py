"""Tests of the tables behind a frame: cones, paint, sky and ripples, each against an independent computation."""

import math

import numpy as np
import pytest

from tests.render.plain import plane
from thalweg.render.bake import ripples, scene_tables, sky
from thalweg.render.bake.cone_map import cone_map
from thalweg.render.records import layout


def test_no_surface_pierces_a_cone():
    rng = np.random.default_rng(0)
    top = rng.normal(size=(96, 131)).cumsum(0).cumsum(1).astype(np.float32) * 0.02
    height, slope = cone_map(top, 0.5)
    rows, columns = np.indices(top.shape)
    for _ in range(300):
        y, x = rng.uniform(0, 95), rng.uniform(0, 130)
        cell = int(y) // layout.CONE_CELL, int(x) // layout.CONE_CELL
        apart = np.hypot(rows - y, columns - x) * 0.5
        assert (top <= height[cell] + slope[cell] * apart + 1e-4).all()


def test_paint_keeps_its_mean_light_at_every_level():
    rng = np.random.default_rng(1)
    lit = rng.uniform(0.05, 0.9, (128, 256, 3))
    levels = scene_tables.paint_levels(lit, np.full((128, 256), 200, np.uint8))
    assert [level.shape for level in levels] == [(128 >> k, 256 >> k) for k in range(layout.PAINT_LEVELS)]
    for level in levels:
        coded = np.stack([level >> shift & 255 for shift in (0, 8, 16)], axis=-1) / 255.0
        np.testing.assert_allclose((coded**2 * layout.PAINT_RANGE).mean((0, 1)), lit.mean((0, 1)), rtol=0.01)
        assert (level >> 24 == 200).all()


def test_ground_that_faces_the_sun_sends_out_its_reflectance_times_the_light():
    world = plane(grey=128)
    lit = scene_tables.ground_radiance(world, scene_tables.sun_vector(world))
    expected = (128 / 255) ** 2 * (math.sin(world.sun_elevation) * layout.SUN_RADIANCE + layout.SKY_RADIANCE)
    np.testing.assert_allclose(lit, np.broadcast_to(expected, lit.shape), rtol=1e-9)


def test_the_zenith_is_as_bright_as_preetham_says():
    sun = np.array([0.0, math.cos(math.radians(55)), math.sin(math.radians(55))])
    theta, turbidity = math.radians(35), 2.5
    chi = (4 / 9 - turbidity / 120) * (math.pi - 2 * theta)
    luminance = (4.0453 * turbidity - 4.9710) * math.tan(chi) - 0.2155 * turbidity + 2.4192
    zenith = sky.daylight(np.array([[0.0, 0.0, 1.0]]), sun, turbidity)[0]
    assert zenith @ np.array([0.2126, 0.7152, 0.0722]) * sky.SCALE_KCD == pytest.approx(luminance, rel=2e-3)
    assert zenith[2] > zenith[1] > zenith[0]


def test_what_filtering_takes_from_the_slopes_becomes_roughness():
    levels = ripples.tile()
    whole = (levels[0][..., :2] ** 2).sum(-1).mean()
    for level in levels:
        assert level[..., :2].mean() == pytest.approx(0, abs=1e-9)
        assert (level[..., :2] ** 2).sum(-1).mean() + level[..., 2].mean() == pytest.approx(whole, rel=1e-9)
        assert level[..., 3].mean() == pytest.approx(levels[0][..., 3].mean())
    assert levels[-1][..., 2].mean() > 0.9 * whole
