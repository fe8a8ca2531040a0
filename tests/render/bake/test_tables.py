"""The tables behind a frame: cones, paint, sky, ripples, tone, approximations, each against an independent way."""

import math

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from tests.render.plain import plane
from thalweg.core.jit import kernel
from thalweg.render import Camera
from thalweg.render.bake import ripples, scene_tables, sky
from thalweg.render.bake.cone_map import cone_map
from thalweg.render.kernels import fast_math, table_lookup
from thalweg.render.kernels.camera_rays import Radiance
from thalweg.render.kernels.shading import tone
from thalweg.render.records import layout
from thalweg.render.records.appearance import look_rows, look_values


@kernel
def tabulate(xs, exps, logs):
    for i in range(len(xs)):
        exps[i] = fast_math.exp(np.float32(math.log(xs[i])))
        logs[i] = fast_math.log2(xs[i])


def test_exp_and_log_are_within_their_stated_errors():
    xs = np.geomspace(1e-20, 1e20, 20001).astype(np.float32)
    exps, logs = np.empty_like(xs), np.empty_like(xs)
    tabulate(xs, exps, logs)
    assert np.abs(logs - np.log2(xs.astype(float))).max() < 0.009
    exact = np.exp(np.log(xs.astype(np.float64)).astype(np.float32).astype(np.float64))
    # The argument itself is rounded to float32, which near 46 is worth 2e-6 of the result.
    assert np.abs(exps / exact - 1).max() < 2e-4


@kernel
def round_down(xs, floors):
    for i in range(len(xs)):
        floors[i] = fast_math.floor(xs[i])


def test_floor_is_exact_below_zero_and_on_whole_numbers_too():
    xs = np.concatenate([np.arange(-5, 6), np.linspace(-1e6, 1e6, 4001), [-1e-7, 1e-7, -2.0000002]]).astype(np.float32)
    floors = np.empty_like(xs)
    round_down(xs, floors)
    np.testing.assert_array_equal(floors, np.floor(xs))


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


@kernel
def look_up(table, directions, out):
    for i in range(len(directions)):
        out[i] = table_lookup.sky_at(table, 0, directions[i, 0], directions[i, 1], directions[i, 2])


def test_a_direction_finds_its_own_cell_of_the_sky():
    rng = np.random.default_rng(2)
    radiance = rng.uniform(0.1, 1.5, (sky.ROWS, sky.COLUMNS, 3))
    table = scene_tables.pack_colour(radiance, sky.CODE_RANGE).ravel()
    directions = sky.map_directions()[1:-1].reshape(-1, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, rtol=1e-12)
    found = np.empty((len(directions), 3), np.float32)
    look_up(table, (directions * 3).astype(np.float32), found)
    expected = radiance[1:-1].reshape(-1, 3)
    assert np.quantile(np.abs(found - expected), 0.999) < 0.02


def test_what_filtering_takes_from_the_slopes_becomes_roughness():
    levels = ripples.tile()
    whole = (levels[0][..., :2] ** 2).sum(-1).mean()
    for level in levels:
        assert level[..., :2].mean() == pytest.approx(0, abs=1e-9)
        assert (level[..., :2] ** 2).sum(-1).mean() + level[..., 2].mean() == pytest.approx(whole, rel=1e-9)
        assert level[..., 3].mean() == pytest.approx(levels[0][..., 3].mean())
    assert levels[-1][..., 2].mean() > 0.9 * whole


@kernel
def read_tile(tile, x, y, level, out):
    for i in range(len(x)):
        out[i] = table_lookup.tile_level(tile, x[i], y[i], level)


def test_the_tile_repeats_and_each_level_is_found():
    levels = ripples.tile()
    flat = ripples.packed(levels)
    for k in (0, 3, 7):
        size = ripples.SIZE >> k
        at = (np.arange(size, dtype=np.float32) + 0.5) * 2**k - 0.5
        row = min(5, size - 1)
        for shift in (0, ripples.SIZE, -3 * ripples.SIZE):
            out = np.empty((size, 4), np.float32)
            read_tile(flat, at + np.float32(shift), np.full(size, at[row]), np.int32(k), out)
            np.testing.assert_allclose(out[:, 3], levels[k][row, :, 3] * 255, atol=0.6)
            slope = (out[:, 0] - 127.5) / 127.5 * ripples.SLOPE_RANGE
            np.testing.assert_allclose(slope, np.clip(levels[k][row, :, 0], -0.5, 0.5), atol=0.0025)


def test_srgb_and_the_curve_at_known_points():
    np.testing.assert_allclose(tone.encode(np.array([0.0, 0.0031308, 0.214041, 1.0])), [0, 0.04045, 0.5, 1], atol=2e-5)
    # Narkowicz at 1: (2.51 + 0.03) / (2.43 + 0.59 + 0.14).
    assert tone.curve(np.array(1.0)) == pytest.approx(2.54 / 3.16)
    codes = tone.code_table().astype(int)
    assert codes[0] == 0
    assert (np.diff(codes) >= 0).all()


@kernel
def expose(red, green, blue, look, image):
    tone.write_image(Radiance(red, green, blue), np.zeros(red.shape, np.uint8), look, np.uint32(0), image)


def test_exposure_takes_away_most_of_a_change_of_light():
    rng = np.random.default_rng(3)
    planes = [rng.uniform(0.02, 0.4, (16, 16)).astype(np.float32) for _ in range(3)]
    pictures = []
    for light in (1.0, 2.0):
        image = np.zeros((16, 16, 4), np.uint8)
        (row,) = look_rows(look_values(None, 1), Camera())
        expose(*(p * np.float32(light) for p in planes), row, image.view(np.uint32)[..., 0])
        pictures.append(image[..., :3].astype(float))
    radiance = np.stack(planes, -1).astype(float)
    luma = radiance @ np.array(tone.LUMA)
    vivid = np.maximum(luma[..., None] + (radiance - luma[..., None]) * tone.SATURATION, 0)
    by_hand = tone.encode(tone.curve(vivid * (tone.KEY / luma.mean()) ** tone.ADAPTATION)) * 255
    assert np.abs(pictures[0] - by_hand).max() < 2.0
    assert 0 < pictures[1].mean() - pictures[0].mean() < 20


@kernel
def read_slopes(table, columns, rows, xs, ys, found):
    for i in range(len(xs)):
        found[i, 0], found[i, 1], found[i, 2] = table_lookup.sloped(table, 0, columns, rows, xs[i], ys[i])


def test_slopes_of_a_table_are_the_differences_of_its_values_and_none_beyond_its_edges():
    rng = np.random.default_rng(3)
    table = rng.uniform(-1, 1, (6, 9)).astype(np.float32)
    xs = (rng.integers(0, 8, 200) + rng.uniform(0.1, 0.9, 200)).astype(np.float32)
    ys = (rng.integers(0, 5, 200) + rng.uniform(0.1, 0.9, 200)).astype(np.float32)
    found = np.empty((200, 3), np.float32)
    read_slopes(table.ravel(), 9, 6, xs, ys, found)
    small = 0.05
    height = lambda x, y: map_coordinates(table.astype(float), [y, x], order=1)  # noqa: E731
    np.testing.assert_allclose(found[:, 0], height(xs, ys), atol=1e-5)
    np.testing.assert_allclose(found[:, 1], (height(xs + small, ys) - height(xs - small, ys)) / (2 * small), atol=1e-4)
    np.testing.assert_allclose(found[:, 2], (height(xs, ys + small) - height(xs, ys - small)) / (2 * small), atol=1e-4)
    beyond = np.array([[-3.0, 2.5], [20.0, 2.5], [4.5, -1.0], [4.5, 9.0]], np.float32)
    read_slopes(table.ravel(), 9, 6, *beyond.T.copy(), found[:4])
    assert (found[:2, 1] == 0).all()
    assert (found[:2, 2] != 0).all()
    assert (found[2:4, 2] == 0).all()
    assert (found[2:4, 1] != 0).all()
