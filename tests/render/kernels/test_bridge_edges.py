"""Tests of antialiased edges of bridges, against the reference renderer."""

import numpy as np
import pytest

from tests.render.frames import ARCH, posed
from tests.render.plain import plane
from thalweg.core.compute.jit import kernel
from thalweg.render import Camera, Look, Renderer
from thalweg.render.kernels.bridge_edges import edge_colour, soften_edges
from thalweg.render.kernels.frame import draw_rows, empty_buffers
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.render.records.classes import BRIDGE
from thalweg.render.records.props import NO_PROPS
from thalweg.render.records.view import COLOURS, Buffers, View
from thalweg.render.reference import frame as reference


@pytest.mark.parametrize("height", [64, 57])
@pytest.mark.slow
def test_antialiased_edges_of_bridges_are_nearer_to_the_reference_and_feet_stay_as_they_are(height):
    world, pose = plane(bridges=ARCH, water_level=-0.1), np.array([-6, 4.0, 1.2, -0.5])
    camera = Camera(height, 64)
    renderer = Renderer([world], camera)
    look = look_rows(look_values(None, 1), camera)[0]
    view = View(0, look, posed(pose, look, camera), np.float32(0))
    buffers = empty_buffers(height, 64, COLOURS)
    draw_rows(renderer.scene, view, NO_PROPS[0], False, COLOURS, 0, height, buffers)
    buffers = Buffers(*(np.ascontiguousarray(buffer[:height]) for buffer in buffers))
    hard = np.stack([buffers.red, buffers.green, buffers.blue], axis=-1)
    soften_edges(renderer.scene, view, buffers)
    soft = np.stack([buffers.red, buffers.green, buffers.blue], axis=-1)
    stone = buffers.kind == BRIDGE
    depth = buffers.depth
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


@kernel
def soften_every_pixel(scene, view, buffers, red, green, blue):
    """The plain way: each pixel is asked for its colour."""
    for r in range(red.shape[0]):
        for c in range(view.camera.width):
            red[r, c], green[r, c], blue[r, c] = edge_colour(scene, view, buffers, r, c)


@pytest.mark.parametrize("pose", [[-6, 4.0, 1.2, -0.5], [-2.0, -14.0, 3.4, 1.45], [-6, 4.0, 1.2, 2.6]])
@pytest.mark.slow
def test_testing_neighbours_first_leaves_out_no_pixel(pose):
    height, width = 61, 70
    camera = Camera(height, width)
    renderer = Renderer([plane(bridges=ARCH, water_level=-0.1)], camera)
    look = look_rows(look_values(None, 1), camera)[0]
    view = View(0, look, posed(np.array(pose), look, camera), np.float32(0))
    buffers = empty_buffers(height, width, COLOURS)
    draw_rows(renderer.scene, view, NO_PROPS[0], False, COLOURS, 0, height, buffers)
    buffers = Buffers(*(np.ascontiguousarray(buffer[:height]) for buffer in buffers))
    # Half of the pixels lie behind leaves, some of which hide an edge altogether.
    buffers.transmittance[...] = np.random.default_rng(1).choice([0.2, 0.6, 1.0], buffers.kind.shape)
    before = np.stack([buffers.red, buffers.green, buffers.blue])
    expected = before.copy()
    soften_every_pixel(renderer.scene, view, buffers, *expected)
    soften_edges(renderer.scene, view, buffers)
    after = np.stack([buffers.red, buffers.green, buffers.blue])
    other = (expected == before).all(axis=0)
    np.testing.assert_array_equal(after[:, other], before[:, other])
    # One function, but inlined into two callers: with fastmath the last bit may differ.
    np.testing.assert_allclose(after, expected, rtol=1e-6)
    assert ((after != before).any(axis=0).sum() > 40) == (buffers.kind == BRIDGE).any()


@pytest.mark.slow
def test_the_sunlit_top_of_a_thin_parapet_is_a_line_and_not_dashes():
    long = ARCH.copy()
    long[0, 3] = 24.0
    world, camera = plane(bridges=long, water_level=-0.1), Camera(64, 64, fov_deg=40, pitch_deg=9.0)
    pose, look = np.array([4.0, -16.0, 5.5, 1.9]), Look(clouds=0.0)
    drawn = Renderer([world], camera).render(pose[None], look=look)[0, ..., :3].astype(float)
    truth = reference.draw(world, pose, camera, samples=5, look=look).rgb.astype(float)
    # The sun is warmer than the sky that lights the faces, so the line stands out by red less blue. It is there in each
    # column, and as bright on the whole as the reference has it.
    stone = Renderer([world], camera).render_layers(pose[None], look=look).class_id[0] == BRIDGE
    first = int(np.flatnonzero(stone.any(axis=1))[0])
    line, expected = (each[first + 1 : first + 5, :, 0] - each[first + 1 : first + 5, :, 2] for each in (drawn, truth))
    assert line.sum(axis=0).min() > 0.8 * line.sum(axis=0).mean()
    assert line.sum() == pytest.approx(expected.sum(), rel=0.17)
