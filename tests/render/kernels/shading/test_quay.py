"""Tests of the stone of quays: against the reference, and that worlds without quays pay nothing for it."""

from dataclasses import replace

import numpy as np
import pytest

from tests.render.frames import psnr
from thalweg.render import Camera, Renderer
from thalweg.render.bake.scene_tables import build_scene
from thalweg.render.records import layout
from thalweg.render.records.classes import GROUND, PLANT, WATER
from thalweg.render.reference import frame as reference
from thalweg.world import World
from thalweg.world.banks import QUAY_WALL_M, quay_run_m, quay_slope, read_banks

HALF_M = 4.0


def straight(banks: str, seed: int = 0) -> World:
    """A river of 60 m along the x axis without plants; the sun stands at 46 degrees from the east to the north."""
    x = np.linspace(0.0, 60.0, 16)
    line = np.stack([x, 0 * x, 0 * x, 0 * x + 2 * HALF_M], axis=1)
    return World.from_centerline(line, False, seed=seed, plants=False, banks=banks)


@pytest.fixture(scope="module")
def quay() -> World:
    return straight("quay")


@pytest.mark.slow
@pytest.mark.parametrize("pose", [(10.0, -1.0, 2.0, 0.5), (30.0, 1.5, 5.0, -0.9), (45.0, 0.0, 10.0, 2.5)])
def test_the_kernel_agrees_with_the_reference(quay, pose):
    camera = Camera(32, 32)
    ours = Renderer([quay], camera).render_layers([pose])
    truth = reference.draw(quay, np.array(pose), camera, samples=4)
    assert psnr(ours.rgb[0], truth.rgb) > 22.0
    assert np.mean(ours.mask[0] == truth.mask) > 0.98
    assert np.mean(ours.class_id[0] == truth.class_id) > 0.95


def test_only_a_world_with_a_quay_has_the_slope_of_its_wall(quay):
    scene = build_scene([quay, straight("meadow"), straight("forest")])
    slopes = scene.constants[:, layout.QUAY_SLOPE]
    np.testing.assert_array_equal(slopes, np.array([quay_slope(0.25), 0.0, 0.0], np.float32))


@pytest.mark.parametrize("quality", ["full", "fast"])
def test_a_wall_in_the_sun_is_brighter_than_one_in_the_shade(quay, quality):
    """From the middle of the river each camera looks at one wall, straight across."""
    poses = [[30.0, 0.0, 1.2, yaw] for yaw in (-np.pi / 2, np.pi / 2)]
    seen = Renderer([quay], Camera(64, 64), quality).render_layers(poses)
    means = []
    for colour, depth, kind, pose in zip(seen.rgb, seen.depth_m, seen.class_id, poses, strict=True):
        height, distance = heights(depth, pose)
        wall = (kind == GROUND) & (height > 0.5) & (height < 0.8)
        assert wall.sum() > 50
        assert distance[wall] == pytest.approx(np.full(wall.sum(), HALF_M + 0.5), abs=0.3)
        means.append(colour[wall].mean())
    # The sun stands in the north-east: the southern wall, which faces north, is lit.
    assert means[0] > 1.3 * means[1]


def heights(depth: np.ndarray, pose: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """Height [H, W] over the water of what a camera straight across the river sees, and its distance from the
    middle."""
    camera = Camera(*depth.shape)
    rows = camera.half_height * (1 - 2 * (np.arange(depth.shape[0]) + 0.5) / depth.shape[0])
    pitch = np.radians(camera.pitch_deg)
    climb = (rows * np.cos(pitch) - np.sin(pitch))[:, None] * depth
    return pose[2] + climb, (np.cos(pitch) + rows * np.sin(pitch))[:, None] * depth


def test_courses_of_the_wall_show_from_near(quay):
    """Pixels of the wall differ by joints and blocks."""
    camera = Camera(128, 128)
    near = Renderer([quay], camera).render_layers([[30.0, 1.0, 1.2, np.pi / 2]])
    height, _ = heights(near.depth_m[0], [30.0, 1.0, 1.2, np.pi / 2])
    wall = (near.class_id[0] == GROUND) & (height > 0.45) & (height < 0.85)
    assert near.rgb[0][wall].mean(axis=1).std() > 3.0


def test_stones_smaller_than_a_pixel_give_way_to_the_paint(quay):
    """In 16 x 16 pixels of 120 degrees a pixel is 0.22 m high at a metre, and 0.9 m at the wall; in 128 x 128 0.1 m."""
    paint = replace(quay, banks=())
    pose = [[30.0, 0.0, 2.0, np.pi / 2]]
    for side, same in ((16, True), (128, False)):
        camera = Camera(side, side, fov_deg=120.0)
        stone, bare = (Renderer([world], camera).render(pose)[0] for world in (quay, paint))
        assert np.array_equal(stone, bare) == same


@pytest.mark.parametrize("banks", ["quay_left", "quay_20-40", "quay_0-60+meadow_right"])
def test_a_wall_beyond_the_end_of_a_quay_has_no_stone(quay, banks):
    """The ground is that of walls on both sides; what the banks do not call a quay looks as in a world without one."""
    other, none = (replace(quay, banks=read_banks(each)) for each in (banks, ()))
    poses = [[30.0, 0.0, 2.0, np.pi / 2], [30.0, 0.0, 2.0, -np.pi / 2], [8.0, 0.0, 2.0, np.pi / 2]]
    stone, found, bare = (Renderer([world], Camera(64, 64)).render(poses) for world in (quay, other, none))
    is_quay = [(frame == all_stone).all() for frame, all_stone in zip(found, stone, strict=True)]
    is_bare = [(frame == without).all() for frame, without in zip(found, bare, strict=True)]
    assert is_quay == ([True, True, False] if banks == "quay_20-40" else [True, False, True])
    assert is_bare == [not each for each in is_quay]


def test_a_quay_is_ground_and_the_water_before_it_water(quay):
    seen = Renderer([quay], Camera(64, 64)).render_layers([[30.0, 0.0, 3.0, np.pi / 2]])
    height, distance = heights(seen.depth_m[0], [30.0, 0.0, 3.0, np.pi / 2])
    kind = seen.class_id[0]
    assert (kind[(distance > 0) & (distance < HALF_M - 0.3)] == WATER).all()
    run = quay_run_m(quay.grid.cell_m)
    top = (distance > HALF_M + run + 0.4) & (distance < HALF_M + 4.0)
    assert top.sum() > 50
    assert (kind[top] == GROUND).all()
    assert height[top] == pytest.approx(np.full(top.sum(), QUAY_WALL_M + 0.04), abs=0.06)


@pytest.mark.slow
def test_reeds_hide_the_edge_of_the_water_and_are_plants():
    x = np.linspace(0.0, 60.0, 16)
    line = np.stack([x, 0 * x, 0 * x, 0 * x + 2 * HALF_M], axis=1)
    pose = [[30.0, 0.0, 2.0, np.pi / 2]]
    seen = {}
    for banks in ("forest", "reeds"):
        world = World.from_centerline(line, False, seed=1, banks=banks)
        seen[banks] = Renderer([world], Camera(64, 64)).render_layers(pose)
    assert seen["reeds"].mask.mean() < seen["forest"].mask.mean()
    assert (seen["reeds"].class_id == PLANT).mean() > (seen["forest"].class_id == PLANT).mean() + 0.05
