"""Tests of antialiased edges of bridges, against the reference renderer."""

import numpy as np
import pytest

from tests.render.frames import ARCH, posed
from tests.render.plain import plane
from thalweg.render import Camera, Renderer
from thalweg.render.kernels.bridge_edges import soften_edges
from thalweg.render.kernels.frame import draw_rows, empty_planes
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.render.records.classes import BRIDGE
from thalweg.render.records.view import COLOURS, Planes, View
from thalweg.render.reference import frame as reference


@pytest.mark.parametrize("height", [64, 57])
@pytest.mark.slow
def test_antialiased_edges_of_bridges_are_nearer_to_the_reference_and_feet_stay_as_they_are(height):
    world, pose = plane(bridges=ARCH, water_level=-0.1), np.array([-6, 4.0, 1.2, -0.5])
    camera = Camera(height, 64)
    renderer = Renderer([world], camera)
    look = look_rows(look_values(None, 1), camera)[0]
    view = View(0, look, posed(pose, look, camera), np.float32(0))
    planes = empty_planes(height, 64)
    draw_rows(renderer.scene, view, False, COLOURS, 0, height, planes)
    planes = Planes(*(np.ascontiguousarray(plane[:height]) for plane in planes))
    hard = np.stack([planes.red, planes.green, planes.blue], axis=-1)
    soften_edges(renderer.scene, view, planes)
    soft = np.stack([planes.red, planes.green, planes.blue], axis=-1)
    stone = planes.kind == BRIDGE
    depth = planes.depth
    padded, far = np.pad(stone, 1, mode="edge"), np.pad(depth, 1, mode="edge")
    around = [(slice(1 + y, height + 1 + y), slice(1 + x, 65 + x)) for y, x in ((-1, 0), (1, 0), (0, -1), (0, 1))]
    edge = np.any([padded[place] != stone for place in around], axis=0)
    behind = np.any([~padded[place] & (far[place] > depth) for place in around], axis=0)
    foot = stone & edge & ~behind
    assert foot.sum() > 5
    np.testing.assert_array_equal(soft[foot | ~edge], hard[foot | ~edge])
    changed = (soft != hard).any(axis=-1)
    assert changed.sum() > 40
    camera_rays = reference.trace(reference.Materials(world, look.astype(np.float64)), pose, camera, 8, 0.0)[0]
    truth = camera_rays.reshape(height, 8, 64, 8, 3).mean(axis=(1, 3))
    before, after = (np.abs(each - truth)[changed].mean() for each in (hard, soft))
    assert after < 0.7 * before
