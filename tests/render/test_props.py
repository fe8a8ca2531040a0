"""Tests of props in frames: where they are, what they hide and what hides them, and how near the reference they are."""

from dataclasses import replace

import numpy as np
import pytest

from tests.render.frames import psnr
from tests.render.lake import ALL, LEVEL, POSE, arch_at, lake, row
from tests.render.plain import plane, plants_at
from thalweg.render import Camera, Look, Renderer
from thalweg.render.batch import bands_of
from thalweg.render.records.classes import BRIDGE, BUOY, GROUND, KAYAK, PLANT, STATION, SWIMMER, WATER
from thalweg.render.records.props import PropKind
from thalweg.render.reference import frame as reference
from thalweg.world.record import World

CLASSES = {SWIMMER, KAYAK, BUOY, STATION}


def pixel_of(camera: Camera, point: np.ndarray) -> tuple[float, float, float]:
    """Row, column and depth of a point [3] before the camera at `POSE`, as a pinhole camera sees it."""
    x, y, z = point - POSE[0, :3]
    pitch = np.radians(camera.pitch_deg)
    ahead, up = x * np.cos(pitch) - z * np.sin(pitch), x * np.sin(pitch) + z * np.cos(pitch)
    focal = camera.height_px / 2 / np.tan(np.radians(camera.fov_deg) / 2)
    return camera.height_px / 2 - focal * up / ahead, camera.width_px / 2 - focal * y / ahead, ahead


def test_a_buoy_is_where_a_pinhole_camera_sees_it():
    camera = Camera(128, 128)
    renderer = Renderer([lake()], camera)
    frame = renderer.render_layers(POSE, props=[[row(PropKind.BUOY, 12.0, 2.0)]])
    r, c, depth = pixel_of(camera, np.array([12.0, 2.0, LEVEL + 0.5]))
    r, c = int(r), int(c)
    # By hand: 12.13 m ahead, 1.755 m above the axis, 2 m to the left; the focal length is 64 / tan 30° = 110.85 pixels.
    assert (r, c) == (int(64 - 110.85 * 1.755 / 12.13), int(64 - 110.85 * 2 / 12.13)) == (47, 45)
    assert abs(depth - 12.13) < 0.01
    assert frame.class_id[0, r, c] == BUOY and not frame.mask[0, r, c]
    # Its skin is nearer than its middle, by less than its radius.
    assert depth - 0.5 < frame.depth_m[0, r, c] < depth
    for aside in (-1.5, 1.5):
        beside = pixel_of(camera, np.array([12.0, 2.0 + aside, LEVEL]))
        assert frame.class_id[0, int(beside[0]), int(beside[1])] == WATER
    # The top of the cross is two metres above the water.
    rows = np.flatnonzero((frame.class_id[0] == BUOY).any(axis=1))
    top = pixel_of(camera, np.array([12.0, 2.0, LEVEL + 2.0]))[0]
    assert abs(rows[0] - top) <= 1.5
    foot = pixel_of(camera, np.array([11.5, 2.0, LEVEL]))[0]
    assert abs(rows[-1] - foot) <= 1.5


@pytest.mark.parametrize("quality", ["full", "fast"])
def test_a_prop_beside_the_camera_is_seen_nowhere_else(quality):
    """Parts that the near plane cuts, from 400 places around a buoy: no ray that misses all of it shows it."""
    rng, camera = np.random.default_rng(0), Camera(64, 64)
    around, away = rng.uniform(-np.pi, np.pi, 400), rng.uniform(0.4, 2.4, 400)
    height, yaw = LEVEL + rng.uniform(0.5, 3.0, 400), rng.uniform(-np.pi, np.pi, 400)
    poses = np.column_stack([12.0 + away * np.cos(around), 2.0 + away * np.sin(around), height, yaw])
    rows = np.repeat(np.array([[row(PropKind.BUOY, 12.0, 2.0)]]), 400, axis=0)
    seen = Renderer([lake()], camera, quality).render_layers(poses, layers=("class_id",), props=rows).class_id == BUOY
    middle = np.array([12.0, 2.0, LEVEL + 0.9])
    frames = pixels = 0
    for pose, matrix, found in zip(poses, camera.camera_matrices(poses).R, seen, strict=True):
        r, c = np.nonzero(found)
        rays = np.linalg.solve(camera.intrinsics(), np.stack([c + 0.5, r + 0.5, np.ones(len(r))])).T @ matrix
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        towards = middle - pose[:3]
        along = np.maximum(rays @ towards, 0.0)
        missed = np.linalg.norm(towards - along[:, None] * rays, axis=1)
        # Nothing of a buoy is further than 1.3 m from its middle; a pixel is 2 cm wide at a metre.
        assert (missed < 1.35).all(), pose
        frames, pixels = frames + bool(len(r)), pixels + len(r)
    assert frames > 40 and pixels > 10_000


@pytest.mark.parametrize("quality", ["full", "fast"])
def test_mask_depth_and_class_are_those_of_the_props(quality):
    renderer = Renderer([lake()], Camera(96, 96), quality)
    without, frame = renderer.render_layers(POSE), renderer.render_layers(POSE, props=ALL)
    assert set(np.unique(frame.class_id)) >= CLASSES
    shown = np.isin(frame.class_id, list(CLASSES))
    np.testing.assert_array_equal(frame.mask, without.mask & ~shown)
    np.testing.assert_array_equal(frame.class_id[~shown], without.class_id[~shown])
    np.testing.assert_array_equal(frame.depth_m[~shown], without.depth_m[~shown])
    deep = np.where(without.depth_m < 0, np.inf, without.depth_m)
    # A part is cut at the water along a soft line.
    assert (frame.depth_m[shown] < deep[shown] * 1.02).all() and (frame.depth_m[shown] < deep[shown]).mean() > 0.97


@pytest.mark.parametrize("quality", ["full", "fast"])
def test_all_that_can_be_asked_for_agrees(quality):
    renderer = Renderer([lake(bridges=arch_at(20.0))], Camera(57, 64), quality)
    whole = renderer.render_layers(POSE, time_s=1.5, props=ALL)
    image = renderer.render(POSE, time_s=1.5, props=ALL)
    np.testing.assert_array_equal(image[..., :3], whole.rgb)
    np.testing.assert_array_equal(image[..., 3] > 0, whole.mask)
    np.testing.assert_array_equal(renderer.render_mask(POSE, props=ALL) > 0, whole.mask)
    layers = renderer.render_layers(POSE, layers=("depth_m", "class_id"), props=ALL)
    np.testing.assert_array_equal(layers.depth_m, whole.depth_m)
    np.testing.assert_array_equal(layers.class_id, whole.class_id)
    for threads in (1, 2, 16):
        with pytest.MonkeyPatch.context() as patch:
            bands = bands_of(57, threads, 1)
            patch.setattr("thalweg.render.renderer.bands_of", lambda *_, bands=bands: bands)
            np.testing.assert_array_equal(renderer.render(POSE, time_s=1.5, props=ALL), image)


@pytest.mark.parametrize("quality", ["full", "fast"])
def test_frames_without_visible_props_keep_their_bits(quality):
    renderer = Renderer([lake(plants=plants_at([(14.0, 2.0)], 2))], Camera(64, 64), quality)
    plain = renderer.render_layers(POSE, time_s=3.0)
    nothing = [row(PropKind.NONE, 8.0, 0.0), row(PropKind.BUOY, -30.0, 0.0), row(PropKind.KAYAK, 8.0, 60.0)]
    for props in (np.zeros((1, 0, 6)), [nothing], [nothing[:1]]):
        frame = renderer.render_layers(POSE, time_s=3.0, props=props)
        for name in ("rgb", "mask", "depth_m", "class_id"):
            np.testing.assert_array_equal(getattr(frame, name), getattr(plain, name))


def test_each_frame_has_its_own_props_whatever_the_batch():
    renderer = Renderer([lake()], Camera(64, 64))
    poses = np.repeat(POSE, 3, axis=0)
    props = np.stack([ALL[0], np.zeros_like(ALL[0]), ALL[0][::-1]])
    frames = renderer.render(poses, props=props)
    np.testing.assert_array_equal(frames[1], renderer.render(POSE)[0])
    # The order of the rows does not matter: they are drawn from near to far.
    np.testing.assert_array_equal(frames[0], frames[2])
    np.testing.assert_array_equal(frames[:1], renderer.render(POSE, props=ALL))


def shown_pixels(world: World, kind: PropKind, x: float, y: float, camera: Camera | None = None) -> int:
    renderer = Renderer([world], camera or Camera(64, 64))
    frame = renderer.render_layers(POSE, layers=["class_id"], props=[[row(kind, x, y)]])
    return int((frame.class_id > BRIDGE).sum())


def test_a_bank_a_bridge_and_a_plant_hide_what_is_behind_them():
    ground = lake().ground_m.copy()
    axis = np.arange(ground.shape[1]) * 0.5 - 50
    ground[:, (axis > 9) & (axis < 11)] = 8.0
    bank = replace(lake(), ground_m=ground, canopy_m=np.maximum(ground, LEVEL))
    bridge = lake(bridges=arch_at(10.0))
    for kind in (PropKind.SWIMMER, PropKind.KAYAK, PropKind.BUOY):
        assert shown_pixels(lake(), kind, 14.0, 6.0) > 4
        assert shown_pixels(bank, kind, 14.0, 6.0) == 0
        assert shown_pixels(bridge, kind, 14.0, 6.0) == 0
    reeds = plants_at([(9.0, y / 4) for y in range(-8, 9)], 2, height=4.0, width=3.0)
    free, covered = (shown_pixels(world, PropKind.BUOY, 14.0, 0.0) for world in (lake(), lake(plants=reeds)))
    assert covered < free / 4


def test_a_prop_hides_the_plants_behind_it():
    wood = lake(plants=plants_at([(18.0, y / 2) for y in range(-8, 9)], 2, height=3.0, width=3.0))
    camera = Camera(96, 96)
    frame = Renderer([wood], camera).render_layers(POSE, props=[[row(PropKind.BUOY, 8.0, 0.0)]])
    alone = Renderer([lake()], camera).render_layers(POSE, props=[[row(PropKind.BUOY, 8.0, 0.0)]])
    assert (frame.class_id == PLANT).any()
    np.testing.assert_array_equal(frame.class_id == BUOY, alone.class_id == BUOY)


def test_a_hut_stands_on_the_bank_and_its_staff_in_the_water():
    bank = plane(slope_x=0.25, water_level=0.0)  # the shore at x = 0
    pose = [[-14.0, 0.0, 4.0, 0.0]]
    station = [[PropKind.STATION, -1.5, 0.0, 0.0, np.pi, 0.0]]
    frame = Renderer([bank], Camera(128, 128)).render_layers(pose, props=[station])
    shown = np.argwhere(frame.class_id[0] == STATION)
    assert len(shown) > 60
    behind = {int(c) for c in np.unique(Renderer([bank]).render_layers(pose).class_id[0][tuple(shown.T)])}
    assert behind >= {WATER, GROUND}
    # Hut and staff stand 2.6 m apart.
    depth = frame.depth_m[0][tuple(shown.T)]
    assert 1.4 < depth.max() - depth.min() < 4.5


def test_water_mirrors_a_buoy_and_the_fast_quality_leaves_that_out():
    camera = Camera(128, 128)
    props = [[row(PropKind.BUOY, 8.0, 0.0)]]
    r, c, _ = pixel_of(camera, np.array([8.0, 0.0, LEVEL - 0.9]))
    part = np.s_[0, int(r) - 1 : int(r) + 3, int(c) - 2 : int(c) + 3]
    renderer = Renderer([lake()], camera)
    calm = Look(ripple=0.0)
    with_buoy, without = renderer.render(POSE, look=calm, props=props), renderer.render(POSE, look=calm)
    assert (with_buoy[..., 3][part] == 255).all()
    excess = lambda image: float((image[part][..., 0].astype(float) - image[part][..., 2]).mean())  # noqa: E731
    assert excess(with_buoy) > excess(without) + 15
    fast = Renderer([lake()], camera, "fast")
    assert abs(excess(fast.render(POSE, look=calm, props=props)) - excess(fast.render(POSE, look=calm))) < 3


def test_waves_spread_from_a_swimmer_with_its_phase():
    renderer = Renderer([lake()], Camera(128, 128))
    images = [
        renderer.render(POSE, look=Look(ripple=0.05), props=[[row(PropKind.SWIMMER, 7.0, 0.0, 0.0, phase)]])
        for phase in (0.0, 0.8)
    ]
    r, c, _ = pixel_of(Camera(128, 128), np.array([7.0, -1.2, LEVEL]))
    part = np.s_[0, int(r) - 3 : int(r) + 3, int(c) - 3 : int(c) + 3, :3]
    assert np.abs(images[0][part].astype(int) - images[1][part]).max() > 3


@pytest.mark.slow
@pytest.mark.parametrize("look", [Look(), Look(haze=20.0, warmth=0.5, turbidity=0.5, ripple=0.3)])
def test_frames_are_near_those_of_the_reference(look: Look):
    camera = Camera(48, 48)
    world = lake(bridges=arch_at(24.0))
    frame = Renderer([world], camera).render_layers(POSE, time_s=1.0, look=look, props=ALL)
    slow = reference.draw(world, POSE[0], camera, samples=4, time_s=1.0, look=look, props=ALL[0])
    assert psnr(frame.rgb[0], slow.rgb) > 22
    shown = np.isin(slow.class_id, list(CLASSES))
    assert psnr(frame.rgb[0][shown], slow.rgb[shown]) > 18
    assert (frame.mask[0] == slow.mask).mean() >= 0.98
    assert (frame.class_id[0] == slow.class_id).mean() >= 0.97
    both = shown & (frame.class_id[0] == slow.class_id)
    assert both.sum() > 80
    assert np.median(np.abs(frame.depth_m[0][both] - slow.depth_m[both])) < 0.05
