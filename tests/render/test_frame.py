"""Frames: against planes worked out by hand, against the reference, and that only pose, world and time count."""

import numpy as np
import pytest

from tests.render.plain import plane, plants_at
from thalweg.core.threads import get_num_threads, set_num_threads
from thalweg.render import Camera, Frame, Renderer
from thalweg.render.bake import impostors
from thalweg.render.batch import bands_of
from thalweg.render.kernels import heightfield_march
from thalweg.render.kernels.billboard import atlas_view
from thalweg.render.kernels.bridge_edges import soften_edges
from thalweg.render.kernels.camera_rays import Origin, Rays, pose_camera, square_rays
from thalweg.render.kernels.frame import ROWS_TOGETHER, draw_rows, empty_planes
from thalweg.render.kernels.heightfield_march import TILE
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.render.records.classes import BRIDGE, GROUND, PLANT, SKY, WATER
from thalweg.render.records.view import FrameSettings, Planes, PosedCamera, View
from thalweg.render.reference import bridge as reference_bridge
from thalweg.render.reference import frame as reference
from thalweg.world.record import World

ARCH = np.array([[0.0, 0.0, 0.3, 14.0, 3.0, 9.0, -0.2, 1.9, 2.2, 0.3, 0.5]])


def rays(camera: Camera, yaw: float) -> np.ndarray:
    forward, right, up = reference.axes(yaw, np.radians(camera.pitch_deg))
    sy = camera.half_height * (1 - 2 * (np.arange(camera.height_px) + 0.5) / camera.height_px)
    sx = camera.half_width * (2 * (np.arange(camera.width_px) + 0.5) / camera.width_px - 1)
    return forward + sy[:, None, None] * up + sx[None, :, None] * right


def posed(pose: np.ndarray, look: np.ndarray, camera: Camera) -> PosedCamera:
    """The camera at a pose as the kernels see it: a call from Python turns its numbers into double precision."""
    settings = FrameSettings(camera.height_px, camera.width_px, np.float32(camera.near_m), False)
    *numbers, height, width = pose_camera(pose, look, settings)
    return PosedCamera._make((*(np.float32(number) for number in numbers), height, width))


def on_river(world: World, count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    sample = rng.integers(0, len(world.river.arc_m), count)
    tangent = world.river.tangent[sample]
    return np.column_stack(
        [
            world.river.position_m[sample],
            world.river.level_m[sample] + rng.uniform(0.8, 9.0, count),
            np.arctan2(tangent[:, 1], tangent[:, 0]) + rng.uniform(-0.6, 0.6, count),
        ]
    )


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    return float(10 * np.log10(255**2 / np.mean((a.astype(float) - b) ** 2)))


@pytest.mark.parametrize("quality", ["full", "fast"])
@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.15, 0.0), (-0.1, 0.0), (-0.05, 0.12)])
def test_depth_on_a_plane_is_where_each_ray_meets_it(slope, quality):
    camera = Camera(48, 48)
    pose = np.array([1.3, -2.1, 3.0 + slope[0] * 1.3 - slope[1] * 2.1, 0.4])
    frame = Renderer([plane(slope_x=slope[0], slope_y=slope[1])], camera, quality).render_layers(pose[None])
    ray = rays(camera, pose[3])
    expected = 3.0 / np.maximum(ray[..., :2] @ slope - ray[..., 2], 1e-9)
    x, y = pose[0] + ray[..., 0] * expected, pose[1] + ray[..., 1] * expected
    inside = (expected < 100) & (np.abs(x) < 49) & (np.abs(y) < 49)
    if quality == "fast":  # there the edge of the plane goes by squares of four pixels
        inside &= inside.reshape(24, 2, 24, 2).all(axis=(1, 3)).repeat(2, axis=0).repeat(2, axis=1)
    assert inside.sum() > 800
    np.testing.assert_allclose(frame.depth_m[0][inside], expected[inside], rtol=2e-3, atol=2e-3)


def test_rays_above_the_horizon_of_a_flat_world_see_the_sky():
    camera = Camera(64, 64)
    frame = Renderer([plane()], camera).render_layers([[0.0, 0.0, 2.0, 0.0]])
    rises = rays(camera, 0.0)[..., 2] > 1e-3
    assert (frame.class_id[0][rises] == SKY).all()
    assert (frame.depth_m[0][rises] == -1).all()
    assert (frame.class_id[0][rays(camera, 0.0)[..., 2] < -0.05] == GROUND).all()


@pytest.mark.parametrize("quality", ["full", "fast"])
def test_the_mask_ends_where_the_ground_leaves_the_water(quality):
    camera = Camera(64, 64)
    world = plane(slope_x=0.1, water_level=0.0)
    pose = np.array([[-6.0, 0.0, 2.0, 0.0]])
    frame = Renderer([world], camera, quality).render_layers(pose)
    ray = rays(camera, 0.0)
    down = ray[..., 2] < -0.02
    shore_x = pose[0, 0] + ray[..., 0] * (2.0 / np.maximum(-ray[..., 2], 1e-9))
    np.testing.assert_array_equal(
        frame.mask[0][down & (np.abs(shore_x) > 0.02)], (shore_x < 0)[down & (np.abs(shore_x) > 0.02)]
    )


@pytest.mark.parametrize(("quality", "apart"), [("full", 1e-4), ("fast", 5e-3)])
def test_a_plant_covers_only_its_window_and_hides_what_is_behind(quality, apart):
    camera = Camera(96, 96)
    world = plane(plants=plants_at([(10.0, 0.0)], kind=0))
    pose = np.array([0.0, 0.0, 3.0, 0.0])
    frame = Renderer([world], camera, quality).render_layers(pose[None])
    seen = frame.class_id[0] == PLANT
    box = reference.window(
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


def test_the_atlas_view_is_the_one_nearest_to_the_direction_of_sight():
    rng = np.random.default_rng(4)
    for look, sun in rng.uniform(-np.pi, np.pi, (400, 2)):
        toward, sunward = ((np.float32(np.cos(a)), np.float32(np.sin(a))) for a in (look, sun))
        assert atlas_view(*toward, *sunward) == impostors.view_of(look, sun)


def test_a_nearer_plant_is_drawn_over_a_farther_one_whatever_their_order():
    near_first = plane(plants=plants_at([(8.0, 0.3), (12.0, -0.3)], kind=1))
    far_first = plane(plants=plants_at([(12.0, -0.3), (8.0, 0.3)], kind=1))
    pose = [[0.0, 0.0, 3.0, 0.0]]
    np.testing.assert_array_equal(Renderer([near_first]).render(pose), Renderer([far_first]).render(pose))


@pytest.mark.slow
def test_a_bridge_is_where_dense_sampling_finds_it():
    world = plane(bridges=ARCH, water_level=-0.1)
    camera = Camera(64, 64)
    poses = np.array([[-6, 4.0, 1.2, -0.5], [5.0, 9.0, 3.5, -2.0], [0.5, -8.0, 1.0, 1.6], [-1.0, 1.0, 4.0, 0.0]])
    frames = Renderer([world], camera).render_layers(poses)
    for pose, kinds, depth in zip(poses, frames.class_id, frames.depth_m, strict=True):
        expected, _, _ = reference_bridge.meet_bridge(
            ARCH[0], pose[:3], rays(camera, pose[3]), camera.near_m, np.full((64, 64), 400.0)
        )
        ground = np.where(rays(camera, pose[3])[..., 2] < 0, -pose[2] / rays(camera, pose[3])[..., 2], np.inf)
        met = expected < ground
        assert (kinds == BRIDGE).sum() > 150
        assert np.mean(met == (kinds == BRIDGE)) > 0.99
        both = met & (kinds == BRIDGE)
        assert np.median(np.abs(depth[both] - expected[both])) < 1e-3
        assert np.quantile(np.abs(depth[both] - expected[both]), 0.97) < 0.05


def test_the_nearer_of_two_bridges_is_seen_whatever_their_order():
    behind = ARCH.copy()
    behind[0, 1] = 7.0
    pose = np.array([[0.5, -8.0, 3.2, 1.6]])
    frames = [
        Renderer([plane(bridges=np.vstack(pair), water_level=-0.1)], Camera(64, 64)).render_layers(pose)
        for pair in ((ARCH, behind), (behind, ARCH))
    ]
    assert (frames[0].class_id == BRIDGE).sum() > 150
    np.testing.assert_array_equal(frames[0].rgb, frames[1].rgb)
    np.testing.assert_array_equal(frames[0].depth_m, frames[1].depth_m)


@pytest.mark.slow
def test_the_kernel_agrees_with_the_reference_where_the_water_falls(hard_world):
    river = hard_world.river
    steepest = int(np.argmax(np.abs(np.diff(river.level_m))))
    at = (steepest - 6) % len(river.arc_m)
    along = river.position_m[steepest] - river.position_m[at]
    pose = np.array([*river.position_m[at], river.level_m[at] + 4.0, np.arctan2(along[1], along[0])])
    camera = Camera(32, 32)
    ours = Renderer([hard_world], camera).render_layers(pose[None])
    truth = reference.draw(hard_world, pose, camera, samples=4)
    assert psnr(ours.rgb[0], truth.rgb) > 22.0
    assert np.mean(ours.mask[0] == truth.mask) > 0.98


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 4, 5])
def test_the_kernel_agrees_with_the_reference(easy_world, seed):
    camera = Camera(32, 32)
    pose = on_river(easy_world, 1, seed)
    ours = Renderer([easy_world], camera).render_layers(pose)
    truth = reference.draw(easy_world, pose[0], camera, samples=4)
    assert psnr(ours.rgb[0], truth.rgb) > 22.0
    assert np.mean(ours.mask[0] == truth.mask) > 0.99
    assert np.mean(ours.class_id[0] == truth.class_id) > 0.95


@pytest.mark.slow
def test_a_frame_does_not_depend_on_batch_order_or_threads(easy_world):
    other = plane(bridges=ARCH, water_level=-0.1)
    renderer = Renderer([easy_world, other], Camera(64, 64))
    poses = np.vstack([on_river(easy_world, 5, 7), [[-6, 4.0, 1.2, -0.5]]])
    index = np.array([0, 0, 0, 0, 0, 1])
    times = np.linspace(0, 9, 6)
    whole = renderer.render(poses, index, times)
    turned = renderer.render(poses[::-1], index[::-1], times[::-1])[::-1]
    np.testing.assert_array_equal(whole, turned)
    for k in range(6):
        np.testing.assert_array_equal(
            whole[k : k + 1], renderer.render(poses[k : k + 1], index[k : k + 1], times[k : k + 1])
        )
    np.testing.assert_array_equal(whole[5], Renderer([other], Camera(64, 64)).render(poses[5:], None, times[5:])[0])
    before = get_num_threads()
    if before < 2:
        pytest.skip("one thread only: nothing to compare with")
    set_num_threads(1)
    try:
        np.testing.assert_array_equal(whole, renderer.render(poses, index, times))
    finally:
        set_num_threads(before)


@pytest.mark.parametrize("height", [64, 57])
@pytest.mark.slow
def test_antialiased_edges_of_bridges_are_nearer_to_the_reference_and_feet_stay_as_they_are(height):
    world, pose = plane(bridges=ARCH, water_level=-0.1), np.array([-6, 4.0, 1.2, -0.5])
    camera = Camera(height, 64)
    renderer = Renderer([world], camera)
    look = look_rows(look_values(None, 1), camera)[0]
    view = View(0, look, posed(pose, look, camera), np.float32(0))
    planes = empty_planes(height, 64)
    draw_rows(renderer.scene, view, False, 0, height, planes)
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
    camera_rays = reference._Valley(world, look.astype(np.float64)).trace(pose, camera, 8, 0.0)[0]
    truth = camera_rays.reshape(height, 8, 64, 8, 3).mean(axis=(1, 3))
    before, after = (np.abs(each - truth)[changed].mean() for each in (hard, soft))
    assert after < 0.7 * before


@pytest.mark.slow
@pytest.mark.parametrize(("quality", "height"), [("full", 72), ("fast", 72), ("full", 57), ("fast", 57)])
def test_threads_that_share_a_frame_draw_what_one_draws(easy_world, quality, height):
    world = plane(bridges=ARCH, water_level=-0.1, slope_x=0.02, plants=plants_at([(9.0, 2.0), (30.0, -4.0)], kind=2))
    renderer = Renderer([easy_world, world], Camera(height, 64), quality)
    poses = np.vstack([on_river(easy_world, 2, 8), [[-6, 4.0, 1.2, -0.5]]])
    kinds = set()
    for pose, where in zip(poses, ([0], [0], [1]), strict=True):
        whole, *parts = (
            drawn_in(renderer, pose[None], where, bands_of(height, threads, 1)) for threads in (1, 2, 3, 16)
        )
        kinds |= set(np.unique(whole.class_id))
        for part in parts:
            np.testing.assert_array_equal(whole.rgb, part.rgb)
            np.testing.assert_array_equal(whole.depth_m, part.depth_m)
            np.testing.assert_array_equal(whole.class_id, part.class_id)
    assert kinds == {SKY, WATER, GROUND, PLANT, BRIDGE}


def drawn_in(renderer: Renderer, poses: np.ndarray, index: list[int], bands: np.ndarray) -> Frame:
    """Layers drawn in these bands of rows."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("thalweg.render.renderer.bands_of", lambda *_: bands)
        return renderer.render_layers(poses, index)


@pytest.mark.parametrize(
    ("height", "threads", "frames"), [(128, 2, 1), (128, 16, 1), (72, 3, 2), (16, 8, 1), (33, 2, 1)]
)
def test_bands_share_all_rows_out_and_begin_where_tiles_do(height, threads, frames):
    bands = bands_of(height, threads, frames)
    rows = np.concatenate([np.arange(first, last) for first, last in bands])
    np.testing.assert_array_equal(np.sort(rows), np.arange(height))
    assert (bands[:, 0] % ROWS_TOGETHER == 0).all()
    assert len(bands) >= min(threads, height // ROWS_TOGETHER)


def test_enough_frames_for_all_threads_are_not_divided():
    np.testing.assert_array_equal(bands_of(128, 2, 2), [[0, 128]])
    np.testing.assert_array_equal(bands_of(128, 2, 1), [[0, 32], [96, 128], [32, 64], [64, 96]])


@pytest.mark.slow
def test_bundles_of_rays_start_no_farther_than_the_nearest_surface(hard_world):
    renderer = Renderer([hard_world], Camera(64, 64))
    scene, world = renderer.scene, hard_world
    inv_cell = np.float32(1 / world.grid.cell_m)
    look = look_rows(look_values(None, 1), renderer.camera)[0]
    starts = []
    for pose in on_river(world, 6, 2):
        camera = posed(pose, look, renderer.camera)
        rays_of_tiles = Rays(*np.empty((3, 8), np.float32))
        origin = Origin(
            (camera.x - np.float32(world.grid.origin_x_m)) * inv_cell,
            (camera.y - np.float32(world.grid.origin_y_m)) * inv_cell,
            camera.z,
        )
        spread = heightfield_march.bundle_spread(camera)
        depth = reference._Valley(world, look).meet_ground(pose[:3], rays(renderer.camera, pose[3]), 0.3)
        nearest = depth.reshape(8, TILE, 8, TILE).min(axis=(1, 3))
        for row in range(8):
            square_rays(camera, row * TILE, TILE, inv_cell, rays_of_tiles, 0, 8)
            start = np.full(8, 0.3, np.float32)
            heightfield_march.advance_bundles(scene, 0, origin, np.float32(spread), rays_of_tiles, start, 8)
            assert (start <= nearest[row] + 1e-3).all()
            starts.append(start)
    assert np.median(starts) > 3.0


@pytest.mark.slow
def test_the_reduced_quality_sees_the_same_river_in_about_the_same_colours(easy_world):
    poses = on_river(easy_world, 6, 5)
    full, fast = (Renderer([easy_world], Camera(), quality).render_layers(poses) for quality in ("full", "fast"))
    assert np.mean(full.mask == fast.mask) > 0.99
    np.testing.assert_allclose(full.rgb.mean(axis=(1, 2)), fast.rgb.mean(axis=(1, 2)), atol=12)
    assert (full.rgb != fast.rgb).any(axis=-1).mean() > 0.3
    assert psnr(full.rgb, fast.rgb) > 17
    for ours, other in zip(full.rgb, fast.rgb, strict=True):
        assert np.corrcoef(ours.ravel(), other.ravel())[0, 1] > 0.75


@pytest.mark.slow
def test_layers_do_not_change_the_picture(easy_world):
    renderer = Renderer([easy_world], Camera(64, 64))
    poses = on_river(easy_world, 3, 9)
    image, layers = renderer.render(poses), renderer.render_layers(poses)
    np.testing.assert_array_equal(image[..., :3], layers.rgb)
    np.testing.assert_array_equal(image[..., 3] == 255, layers.mask)
    assert set(np.unique(image[..., 3])) <= {0, 255}
    np.testing.assert_array_equal(layers.mask, layers.class_id == WATER)
    np.testing.assert_array_equal(layers.depth_m == -1, layers.class_id == SKY)


def test_time_moves_the_ripples_and_nothing_else():
    renderer = Renderer([plane(slope_x=0.1, water_level=0.0)], Camera(64, 64))
    pose = [[-6.0, 0.0, 2.0, 0.0]]
    now, later = renderer.render(pose, time_s=0.0)[0], renderer.render(pose, time_s=3.0)[0]
    wet = now[..., 3] == 255
    assert (now[..., :3] != later[..., :3]).any(axis=-1)[wet].mean() > 0.5
    # The mean of the frame sets the exposure, so that dry ground may shift by a shade.
    assert np.abs(now[..., :3].astype(int) - later[..., :3])[~wet].max() <= 3


@pytest.mark.parametrize(
    ("size", "quality", "least_db"),
    [((40, 72), "full", 24.0), ((72, 40), "full", 24.0), ((33, 57), "full", 24.0), ((33, 57), "fast", 20.0)],
)
@pytest.mark.slow
def test_sizes_need_not_be_multiples_of_anything(size, quality, least_db):
    world = plane(slope_x=0.1, water_level=0.0, bridges=ARCH, plants=plants_at([(9.0, 2.0)], kind=2))
    camera = Camera(*size)
    pose = np.array([-4.0, -3.0, 2.5, 0.3])
    ours = Renderer([world], camera, quality).render(pose[None])[0]
    truth = reference.draw(world, pose, camera, samples=3)
    assert ours.shape == (*size, 4)
    assert psnr(ours[..., :3], truth.rgb) > least_db
    assert np.mean((ours[..., 3] == 255) == truth.mask) > 0.99


def test_bad_requests_name_the_value_and_what_would_be_right():
    renderer = Renderer([plane()], Camera(32, 32))
    with pytest.raises(ValueError, match=r"shape \[3\].*\[N, 4\]"):
        renderer.render([0.0, 0.0, 2.0])
    with pytest.raises(ValueError, match="pose 1 is not finite"):
        renderer.render([[0, 0, 2, 0], [0, np.nan, 2, 0]])
    with pytest.raises(ValueError, match=r"world_index must be in 0\.\.0; got 1\.\.1"):
        renderer.render([[0, 0, 2, 0]], [1])
    with pytest.raises(ValueError, match=r"must be contiguous uint8 \[1, 32, 32, 4\]"):
        renderer.render([[0, 0, 2, 0]], out=np.zeros((1, 32, 32, 3), np.uint8))
    with pytest.raises(ValueError, match="at least one world"):
        Renderer([])
    with pytest.raises(ValueError, match="quality = 'quick': choose one of full, fast"):
        Renderer([plane()], Camera(32, 32), "quick")  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    ("field", "value"), [("height_px", 4), ("width_px", 20.5), ("fov_deg", 180.0), ("pitch_deg", 95.0), ("near_m", 0.0)]
)
def test_a_camera_that_cannot_be_is_refused_by_name(field, value):
    with pytest.raises(ValueError, match=field):
        Camera(**{field: value})
