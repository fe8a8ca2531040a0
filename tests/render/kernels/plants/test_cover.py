"""Tests of plants as coverage: the light and the depth of `plants.draw_plants`, in the pixels that are asked for."""

import numpy as np
import pytest

from tests.render.frames import posed
from tests.render.plain import plane, plants_at
from thalweg.render import Camera, Look, Renderer
from thalweg.render.kernels.frame import empty_buffers
from thalweg.render.kernels.layers import draw_layers
from thalweg.render.kernels.plants.draw import draw_plants
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.render.records.classes import GROUND, WATER
from thalweg.render.records.view import COLOURS, MASK, Buffers, View

CAMERA = Camera(64, 64)
ROW = 30
"""A row of the image on which all plants of `wood` lie one behind another."""


def wood(kind: int) -> tuple:
    """Scene and view of nine wide plants one behind another, of one kind, before ground at 60 m."""
    places = [(8.0 + 2.0 * k, 0.4 * k) for k in range(9)]
    renderer = Renderer([plane(plants=plants_at(places, kind, width=12.0))], CAMERA)
    look = look_rows(look_values(Look(), 1), CAMERA)[0]
    camera = posed(np.array([0.0, 0.0, 3.0, 0.0]), look, CAMERA)
    return renderer.scene, View(0, look, camera, np.float32(0))


def drawn(scene, view, reduced: bool) -> Buffers:
    buffers = Buffers(*empty_buffers(64, 64, COLOURS))
    buffers.depth[:] = 60.0
    draw_plants(scene, view, 0, reduced, buffers)
    return buffers


def covered(scene, view, reduced: bool, behind: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Light and depth of the plants before water at depths `behind`; 0 where there is none."""
    buffers = Buffers(*empty_buffers(64, 64, MASK))
    buffers.depth[:], buffers.kind[:] = behind, np.where(behind > 0, WATER, GROUND)
    draw_layers(scene, view, 0, reduced, True, buffers)
    return buffers.transmittance, buffers.plant_depth


@pytest.mark.slow
@pytest.mark.parametrize("reduced", [False, True])
@pytest.mark.parametrize("kind", [0, 7, 13])
def test_light_is_that_of_drawn_plants_until_half_of_it_is_gone(kind, reduced):
    scene, view = wood(kind)
    buffers = drawn(scene, view, reduced)
    light, depth = covered(scene, view, reduced, np.full((64, 64), 60.0, np.float32))
    seen = buffers.transmittance >= 0.5
    assert 0.02 < (~seen).mean() < 0.9 and ((buffers.transmittance < 1) & seen).sum() > 20
    np.testing.assert_array_equal(light >= 0.5, seen)
    np.testing.assert_array_equal(light[seen], buffers.transmittance[seen])
    np.testing.assert_array_equal(depth, buffers.plant_depth)


@pytest.mark.slow
@pytest.mark.parametrize("reduced", [False, True])
def test_pixels_that_nobody_asks_for_and_plants_behind_what_is_asked_for_are_left_out(reduced):
    scene, view = wood(0)
    everywhere = np.full((64, 64), 60.0, np.float32)
    light, _ = covered(scene, view, reduced, everywhere)
    some = everywhere.copy()
    some[: ROW + 2], some[ROW + 4 :] = 0.0, 0.0
    narrow, _ = covered(scene, view, reduced, some)
    assert (light[: ROW + 2] < 0.5).any() and (narrow[: ROW + 2] == 1).all() and (narrow[ROW + 4 :] == 1).all()
    np.testing.assert_array_equal(narrow[ROW + 2 : ROW + 4] >= 0.5, light[ROW + 2 : ROW + 4] >= 0.5)
    near, _ = covered(scene, view, reduced, np.minimum(everywhere, np.float32(5.0)))
    assert (near == 1).all()
