"""Sight: pixels and the ground under them, banks where they are, and bridges that do not become land."""

import numpy as np
import pytest

from tests.env.shield.channel import Channel, optics_of, rays_of, straight
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.initial_poses import project_anywhere
from thalweg.env.shield.shield import Shield
from thalweg.env.shield.sight import (
    COARSEST_M,
    camera_at,
    ground_of,
    look,
    pixel_of,
    top_line,
)
from thalweg.env.shield.water_map import CELL_M, SIZE, WaterMaps, empty_maps, follow
from thalweg.env.task.altimeter import heights_above_water
from thalweg.env.task.motion import Pose
from thalweg.env.task.termination import island_at, metres_past_bank
from thalweg.render import Camera
from thalweg.render.kernels.camera_rays import pose_camera, ray_through
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.render.records.view import FrameSettings
from thalweg.world import load_or_build

TALL = Camera(96, 128, fov_deg=50.0, pitch_deg=35.0)


def see(maps: WaterMaps, channel: Channel, pose: np.ndarray) -> None:
    """Enter what a channel looks like from a pose."""
    mask = channel.mask(pose)
    follow(maps, 0, pose[0], pose[1])
    look(maps, 0, Pose(*pose), optics_of(channel.camera), mask, np.empty_like(mask))


def known(maps: WaterMaps) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return x, y and odds [K] of the known cells."""
    u, v = np.nonzero(maps.odds[0])
    i, j = (corner + (place - corner) % SIZE for corner, place in zip(maps.corner[0], (u, v), strict=True))
    return (i + 0.5) * CELL_M, (j + 0.5) * CELL_M, maps.odds[0, u, v]


@pytest.mark.parametrize("camera", [Camera(), TALL], ids=["default", "tall"])
def test_pixels_see_the_ground_where_the_renderers_rays_meet_it(camera: Camera):
    pose = np.array([3.0, -2.0, 5.0, 0.7])
    rays = rays_of(camera, pose)
    settings = FrameSettings(camera.height_px, camera.width_px, np.float32(camera.near_m), False)
    posed = pose_camera(pose, look_rows(look_values(None, 1), camera)[0], settings)
    at = camera_at(Pose(*pose), optics_of(camera), 0, camera.height_px, camera.width_px)
    top = top_line(at)
    assert 0 < top < camera.height_px - 20
    for line in range(top, camera.height_px, 7):
        for column in range(0, camera.width_px, 9):
            ray = rays[line, column]
            assert np.allclose(ray, ray_through(posed, line, column), atol=1e-5)
            expected = pose[:2] + ray[:2] * pose[2] / -ray[2]
            ground = ground_of(at, line, column)
            assert np.allclose((ground.x, ground.y), expected, atol=1e-4)
            assert pixel_of(at, ground.x, ground.y) == (line, column)


def test_nothing_is_read_that_a_pixel_covers_too_coarsely():
    at = camera_at(Pose(0.0, 0.0, 5.0, 0.0), optics_of(Camera()), 0, 128, 128)
    top = top_line(at)
    near, far = (ground_of(at, line, 64) for line in (top, top - 1))
    assert near.covered < COARSEST_M < far.covered
    # A pixel covers the distance between the grounds of its neighbours.
    below = ground_of(at, top + 1, 64)
    assert near.x - below.x == pytest.approx(near.covered, rel=0.1)


@pytest.mark.parametrize("yaw", [0.0, 0.4, -2.0])
def test_the_banks_of_a_canal_are_where_they_are(yaw: float):
    cos, sin = np.cos(yaw), np.sin(yaw)
    channel = Channel(lambda x, y: np.abs(y * cos - x * sin) < 3.0)
    maps = empty_maps(1)
    for ahead in range(6):
        see(maps, channel, np.array([ahead * cos, ahead * sin, 5.0, yaw]))
    x, y, odds = known(maps)
    aside = np.abs(y * cos - x * sin)
    assert (odds > 0).sum() > 1000 < (odds < 0).sum()
    assert aside[odds > 0].max() < 3.0
    assert aside[odds < 0].min() > 3.0 - COARSEST_M


def test_a_blind_spot_stays_unknown():
    maps = empty_maps(1)
    see(maps, Channel(straight(3.0)), np.array([0.0, 0.0, 5.0, 0.0]))
    x, _, _ = known(maps)
    # The lowest rays fall by 50 degrees.
    assert x.min() > 5.0 / np.tan(np.radians(50.0)) - CELL_M


@pytest.mark.parametrize("height", [4.5, 6.0, 8.0])
def test_a_bridge_flown_over_leaves_no_land_on_the_water(height: float):
    channel = Channel(straight(3.0), decks=[(20.0, 23.0, 1.75, 2.9)])
    maps = empty_maps(1)
    for ahead in range(32):
        see(maps, channel, np.array([float(ahead), 0.0, height, 0.0]))
    x, y, odds = known(maps)
    wrong = (odds < 0) & (np.abs(y) < 2.5) & (x > 2.0) & (x < 30.0)
    assert not wrong.any()
    assert ((odds < 0) & (np.abs(y) > 3.0) & (x < 15.0)).sum() > 500  # and the banks are land


def test_an_island_is_land_though_water_is_seen_behind_it():
    channel = Channel(lambda x, y: (np.abs(y) < 6.0) & ((x - 12.0) ** 2 + y**2 > 4.0))
    maps = empty_maps(1)
    for ahead in range(6):
        see(maps, channel, np.array([float(ahead), 0.0, 5.0, 0.0]))
    x, y, odds = known(maps)
    inside = (x - 12.0) ** 2 + y**2 < 1.6**2
    assert inside.sum() > 100 and (odds[inside] < 0).all()


def test_nothing_is_read_from_the_water_itself_or_looking_up():
    maps = empty_maps(1)
    see(maps, Channel(straight(3.0), camera=Camera(pitch_deg=-60.0)), np.array([0.0, 0.0, 5.0, 0.0]))
    look(
        maps,
        0,
        Pose(0.0, 0.0, 0.0, 0.0),
        optics_of(Camera()),
        np.full((128, 128), 255, np.uint8),
        np.empty((128, 128), np.uint8),
    )
    assert not maps.odds.any()


@pytest.mark.slow
@pytest.mark.parametrize("level", ["Medium", "Hard"])
def test_the_map_of_a_drawn_river_is_that_of_its_course(level: str):
    env = RiverVectorEnv([load_or_build(level)], 6, EnvConfig(observation="mask"))
    masks, _ = env.reset(seed=5)
    starts, shield, flown = env.state.pose.copy(), Shield(6), []
    for _ in range(40):
        flown.append(env.state.pose[:, :2].copy())
        heights = heights_above_water(env.courses, env.state)
        made, _ = shield.screen(np.arange(6), masks[..., 0], heights, env.pilot_actions("steady"))
        masks, *_ = env.step(made)
    wrong, blocked, wet = [], [], []
    for row, start in enumerate(starts):
        u, v = np.nonzero(shield.maps.odds[row])
        corner = shield.maps.corner[row]
        x, y = ((c + (place - c) % SIZE + 0.5) * CELL_M for c, place in zip(corner, (u, v), strict=True))
        cos, sin = np.cos(start[3]), np.sin(start[3])
        at = np.column_stack([start[0] + x * cos - y * sin, start[1] + x * sin + y * cos])
        projections = [project_anywhere(env.courses, 0, *point) for point in at]
        past = np.array([metres_past_bank(env.courses, 0, projection) for projection in projections])
        island = np.array([island_at(env.courses, 0, *point) >= 0 for point in at])
        odds = shield.maps.odds[row, u, v]
        wet.append(((odds > 0) & (past < 0)).sum())
        # Water seen on land lies within a cell of the bank, but for side channels, which are water and no course.
        wrong.append(np.mean((past[odds > 0] > CELL_M) | island[odds > 0]))
        # Near the flight, land seen on water lies within two cells of the bank; one flight may begin behind a bridge.
        away = np.linalg.norm(at[:, None] - np.array(flown)[None, :, row], axis=-1).min(axis=1)
        near = (away < 4.0) & (past < -2 * CELL_M) & ~island
        blocked.append(np.mean(odds[near] < 0))
    assert np.median(wrong) < 0.001 and np.median(wet) > 2000
    assert sorted(blocked)[-2] < 0.03
