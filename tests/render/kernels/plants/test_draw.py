"""Tests of drawn plants: their window, their depth and their order."""

import numpy as np
import pytest

from tests.render.frames import rays
from tests.render.plain import plane, plants_at
from thalweg.render import Camera, Renderer
from thalweg.render.bake.scene_tables import build_scene
from thalweg.render.kernels.camera_rays import pose_camera
from thalweg.render.kernels.frame import empty_buffers
from thalweg.render.kernels.plants.billboard import stopped
from thalweg.render.kernels.plants.draw import draw_plants
from thalweg.render.records import layout
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.render.records.classes import PLANT
from thalweg.render.records.view import COLOURS, Buffers, FrameSettings, PosedCamera, View
from thalweg.render.reference import frame as reference
from thalweg.render.reference import plants as reference_plants
from thalweg.world.species import KINDS


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


def wooded_scene():
    """A scene of plants of all kinds, 2 to 60 m away in all directions."""
    rng = np.random.default_rng(3)
    away, turn = rng.uniform(2, 60, 400), rng.uniform(-np.pi, np.pi, 400)
    world = plane(plants=plants_at(list(zip(away * np.cos(turn), away * np.sin(turn), strict=True)), kind=0))
    world.plants.kind[:] = np.arange(400) % len(KINDS)
    return build_scene([world])


def drawn_plants(scene, pose, reduced: bool) -> Buffers:
    """The buffers of a frame with nothing but plants in front of a wall 40 m away."""
    camera = Camera(100, 90)
    look = look_rows(look_values(None, 1), camera)[0]
    settings = FrameSettings(camera.height_px, camera.width_px, np.float32(camera.near_m), reduced)
    *numbers, height, width = pose_camera(np.array(pose), look, settings)
    posed = PosedCamera._make((*(np.float32(number) for number in numbers), height, width))
    buffers = Buffers(*empty_buffers(height, width, COLOURS))
    buffers.depth[...] = 40.0
    draw_plants(scene, View(0, look, posed, np.float32(0)), 0, reduced, buffers)
    return buffers


@pytest.mark.parametrize("reduced", [False, True])
@pytest.mark.parametrize("yaw", [0.0, 2.0, 4.0])
def test_outlines_and_chunks_save_time_and_change_no_bit(reduced, yaw):
    scene = wooded_scene()
    everything = scene._replace(
        outlines=np.tile(np.array([-1, 1], np.float32), (len(scene.outlines), scene.outlines.shape[1] // 2)),
        chunks=scene.chunks * np.array([1, 1, 1, 0], np.float32) + np.array([0, 0, 0, 1e3], np.float32),
    )
    pose = [0.0, 0.0, 2.5, yaw]
    drawn, expected = drawn_plants(scene, pose, reduced), drawn_plants(everything, pose, reduced)
    assert (drawn.transmittance < 0.5).mean() > 0.2
    for name in ("red", "green", "blue", "transmittance", "plant_depth"):
        np.testing.assert_array_equal(getattr(drawn, name), getattr(expected, name), err_msg=name)


def test_an_outline_that_is_too_narrow_changes_the_picture():
    scene = wooded_scene()
    pose = [0.0, 0.0, 2.5, 0.0]
    narrow = drawn_plants(scene._replace(outlines=scene.outlines * np.float32(0.6)), pose, False)
    assert (narrow.transmittance != drawn_plants(scene, pose, False).transmittance).any()


def test_the_sphere_of_a_chunk_holds_its_plants():
    scene = wooded_scene()
    assert len(scene.chunks) == -(-len(scene.plants) // layout.CHUNK)
    for k, (x, y, z, radius) in enumerate(scene.chunks):
        part = scene.plants[k * layout.CHUNK : (k + 1) * layout.CHUNK]
        half = part[:, layout.P_HEIGHT] / 2
        reach = np.hypot(np.hypot(part[:, layout.P_X] - x, part[:, layout.P_Y] - y), part[:, layout.P_Z] + half - z)
        assert (reach + half + part[:, layout.P_HALF] <= radius).all()


def test_a_pixel_that_is_almost_covered_is_closed():
    f32 = np.float32
    assert stopped(f32(0.5), f32(0.5), f32(0.02)) == f32(0.25)
    assert stopped(f32(0.5), f32(0.97), f32(0.02)) == f32(0.5)
    assert stopped(f32(0.5), f32(0), f32(0.02)) == 0
