"""Tests of ground found by vertical planes: against hand-made worlds, the reference renderer and the march."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.render.frames import on_river, posed, rays
from tests.render.plain import CELL_M, HALF_M, NODES, plane
from thalweg.render import Camera, Renderer
from thalweg.render.kernels import camera_rays
from thalweg.render.kernels.terrain import azimuth_planes, primary_hits
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.render.records.classes import SKY
from thalweg.render.records.view import LANES, View
from thalweg.render.reference import frame as reference
from thalweg.world import World

f32 = np.float32


def view_at(renderer: Renderer, pose: np.ndarray) -> View:
    look = look_rows(look_values(None, 1), renderer.camera)[0]
    return View(0, look, posed(pose, look, renderer.camera), f32(0))


def planes_and_march(renderer: Renderer, pose: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Depth and kind of a view by planes, then by the march."""
    view = view_at(renderer, pose)
    shape = view.camera.height, -(-view.camera.width // LANES) * LANES
    found = []
    for find in (primary_hits.find_by_planes, primary_hits.find_by_march):
        depth, kind = np.zeros(shape, f32), np.zeros(shape, np.uint8)
        find(renderer.scene, view, 0, renderer.quality == "fast", depth, kind, np.empty(shape, f32))
        found.append((depth, kind))
    return found


def camera_at(pitch_deg: float, fov_deg: float = 60.0):
    camera = Camera(64, 64, pitch_deg=pitch_deg, fov_deg=fov_deg)
    return posed(np.array([0.0, 0.0, 5.0, 0.7]), look_rows(look_values(None, 1), camera)[0], camera)


@pytest.mark.parametrize("pitch", [-20.0, 0.0, 20.0, 40.0])
def test_the_row_of_a_slope_is_the_row_whose_rays_rise_by_it(pitch: float):
    camera = camera_at(pitch)
    assert azimuth_planes.can_serve(camera)
    fan = azimuth_planes.fan_of(camera, f32(2))
    for row in range(64):
        slope = f32(azimuth_planes.ray_slope(camera, row))
        ray = rays(Camera(64, 64, pitch_deg=pitch), 0.7)[row, 31]
        across = (31.5 / 32 - 1) * np.tan(np.radians(30))
        ahead = np.sqrt(ray[0] ** 2 + ray[1] ** 2 - across**2)
        assert slope == pytest.approx(ray[2] / ahead, rel=1e-5, abs=1e-6)
        # A surface a little higher is met by this row too, one a little lower only by the next.
        assert azimuth_planes.first_row_below(fan, slope + f32(1e-4), 0, 64) == row
        assert azimuth_planes.first_row_below(fan, slope - f32(1e-4), 0, 64) == row + 1


def test_slopes_outside_the_image_belong_to_its_first_row_or_to_none():
    camera = camera_at(20.0)
    fan = azimuth_planes.fan_of(camera, f32(2))
    # Straight above the camera the tangent of the angle in the image has turned over.
    for steep in (1.0, 3.0, 100.0):
        assert azimuth_planes.first_row_below(fan, f32(steep), 0, 64) == 0
    assert azimuth_planes.first_row_below(fan, f32(-100.0), 0, 64) == 64
    assert azimuth_planes.first_row_below(fan, f32(-100.0), 16, 32) == 32
    upwards = azimuth_planes.fan_of(camera_at(-40.0), f32(2))
    assert azimuth_planes.first_row_below(upwards, f32(-100.0), 0, 64) == 64


def test_planes_serve_no_camera_that_looks_nearly_straight_down_or_up():
    served = [azimuth_planes.can_serve(camera_at(pitch)) for pitch in (-80.0, -30.0, 0.0, 20.0, 40.0, 60.0, 85.0)]
    assert served == [False, True, True, True, True, False, False]
    assert not azimuth_planes.can_serve(camera_at(20.0, fov_deg=130.0))
    for pitch in (-30.0, 0.0, 20.0, 40.0):
        assert azimuth_planes.fan_of(camera_at(pitch), f32(2)).planes <= azimuth_planes.most_planes(64)


@pytest.mark.parametrize(("rows", "share"), [(32, 0.06), (128, 0.03), (512, 0.015)])
@pytest.mark.slow
def test_a_doubtful_pixel_is_left_two_samples_before_the_nearer_plane_in_images_of_any_height(rows: int, share: float):
    assert azimuth_planes.next_distance(f32(100), f32(CELL_M), rows) == pytest.approx(100 * (1 + share))
    renderer = Renderer([plane()], Camera(rows, 32, pitch_deg=0.0))
    view = view_at(renderer, np.array([0.0, 0.0, 3.0, 0.0]))
    fan = azimuth_planes.fan_of(view.camera, f32(1 / CELL_M))
    # Planes in turn meet something at 20 m and at 40 m, so that every pixel is doubtful.
    nearness = np.where(np.arange(fan.planes) % 2, 1 / 20, 1 / 40).astype(f32)
    row = rows - 1
    scratch, t, doubt = np.zeros((3, 32), f32), np.zeros(32, f32), np.zeros(32, np.uint8)
    rays_of_row = camera_rays.Rays(*scratch)
    camera_rays.row_rays(view.camera, row, 0, f32(1 / CELL_M), rays_of_row, 32)
    origin = camera_rays.map_origin(renderer.scene, view)
    azimuth_planes.settle_row(renderer.scene, view, origin, fan, row, 0, rays_of_row, nearness, t, doubt, 32)
    assert doubt.all()
    # Without pitch, metres along the axis are metres ahead. A sample is no closer than half a cell.
    np.testing.assert_allclose(t, 20 * (1 - 2 * share) - CELL_M, rtol=1e-5)


@pytest.fixture
def wall() -> World:
    """Level ground with a wall of 2 m from 6 m to 7 m ahead of the origin, and ground 1 m lower behind it."""
    world = plane()
    x = np.arange(NODES) * CELL_M - HALF_M
    profile = np.where(x < 6, 0.0, np.where(x <= 7, 2.0, -1.0)).astype(np.float32)
    return replace(world, ground_m=np.broadcast_to(profile, (NODES, NODES)).copy())


@pytest.mark.parametrize("quality", ["full", "fast"])
def test_a_wall_hides_the_ground_behind_it(wall: World, quality):
    camera = Camera(96, 96)
    frame = Renderer([wall], camera, quality).render_layers([[0.0, 0.0, 3.0, 0.0]])
    ray = rays(camera, 0.0)[:, 48]
    depth = frame.depth_m[0][:, 48]
    # The wall's face rises from 5.5 m to 6 m, its top reaches to 7 m, and the ground behind begins at 7.5 m.
    ahead = depth * ray[:, 0]
    height = 3.0 + depth * ray[:, 2]
    front = (-3.0 / ray[:, 2] < 5.4 / ray[:, 0]) & (ray[:, 2] < 0)
    # The reduced quality interpolates between samples, one of which may lie beyond the foot of the wall.
    np.testing.assert_allclose(height[front], 0.0, atol=2e-3 if quality == "full" else 0.03)
    slope = ray[:, 2] / ray[:, 0]
    on_wall = (slope > -3.0 / 5.6) & (slope < -1.0 / 7.0 - 0.01)
    assert on_wall.sum() > 20
    assert ((ahead[on_wall] > 5.4) & (ahead[on_wall] < 7.05)).all()
    behind = (slope > -1.0 / 7.0 + 0.02) & (slope < -0.09)
    assert behind.sum() >= 2
    np.testing.assert_allclose(ahead[behind], -4.0 / slope[behind], rtol=0.01)


@pytest.mark.parametrize(("quality", "share_met", "share_near"), [("full", 0.999, 0.995), ("fast", 0.997, 0.97)])
@pytest.mark.slow
def test_depths_are_those_of_the_reference(hard_world: World, quality, share_met: float, share_near: float):
    camera = Camera(64, 64)
    renderer = Renderer([hard_world], camera, quality)
    materials = reference.Materials(hard_world, look_rows(look_values(None, 1), camera)[0])
    agree, near = [], []
    for pose in on_river(hard_world, 8, 5):
        (depth, kind), (marched, _) = planes_and_march(renderer, pose)
        truth = reference.meet_ground(materials, pose[:3], rays(camera, pose[3]), 0.3)
        agree.append(((kind != SKY) == (truth < 320)).mean())
        met = (kind != SKY) & (truth < 300)
        near.append([(np.abs(found - truth)[met] < 0.01 * truth[met]).mean() for found in (depth, marched)])
    assert np.mean(agree) > share_met
    by_planes, by_march = np.mean(near, axis=0)
    assert by_planes > share_near
    # Here and there something small between two planes is missed, which the march of every ray would meet.
    assert by_planes > by_march - (0.004 if quality == "full" else 0.0)


@pytest.mark.slow
def test_no_seam_where_the_march_takes_over(hard_world: World):
    pose = on_river(hard_world, 1, 3)[0]
    served, frames = [], []
    pitches = np.arange(44.0, 48.0, 0.25)
    for pitch in pitches:
        camera = Camera(64, 64, pitch_deg=float(pitch))
        renderer = Renderer([hard_world], camera)
        served.append(bool(azimuth_planes.can_serve(view_at(renderer, pose).camera)))
        frames.append(renderer.render(pose[None])[0].astype(int))
    change = served.index(False)
    assert served == [True] * change + [False] * (len(pitches) - change) and 0 < change < len(pitches)
    apart = [np.abs(after - before)[..., :3].mean() for before, after in pairwise(frames)]
    # The step across the change is no larger than those beside it, which only turn the camera by a quarter degree.
    others = apart[: change - 1] + apart[change:]
    assert apart[change - 1] < 1.15 * max(others)
    wet = [abs(float((after[..., 3] - before[..., 3]).mean())) for before, after in pairwise(frames)]
    assert wet[change - 1] <= 1.5 * max(wet[: change - 1] + wet[change:])
