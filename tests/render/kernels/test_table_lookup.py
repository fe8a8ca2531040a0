"""Tests of table look-ups: the sky, the ripple tile and slopes."""

import numpy as np
from scipy.ndimage import map_coordinates

from thalweg.core.compute.jit import kernel
from thalweg.render.bake import ripples, scene_tables, sky
from thalweg.render.bake.texels import pack_colour
from thalweg.render.kernels import table_lookup


@kernel
def look_up(table, directions, out):
    for i in range(len(directions)):
        out[i] = table_lookup.sky_at(table, 0, directions[i, 0], directions[i, 1], directions[i, 2])


def test_a_direction_finds_its_own_cell_of_the_sky():
    rng = np.random.default_rng(2)
    radiance = rng.uniform(0.1, 1.5, (sky.ROWS, sky.COLUMNS, 3))
    table = pack_colour(radiance, sky.CODE_RANGE).ravel()
    directions = sky.map_directions()[1:-1].reshape(-1, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, rtol=1e-12)
    found = np.empty((len(directions), 3), np.float32)
    look_up(table, (directions * 3).astype(np.float32), found)
    expected = radiance[1:-1].reshape(-1, 3)
    assert np.quantile(np.abs(found - expected), 0.999) < 0.02


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


@kernel
def read_slopes(heights, xs, ys, found):
    for i in range(len(xs)):
        found[i, 0], found[i, 1], found[i, 2] = table_lookup.sloped(heights, xs[i], ys[i])


@kernel
def read_heights(heights, xs, ys, found):
    for i in range(len(xs)):
        found[i] = table_lookup.bilinear(heights, xs[i], ys[i])


def height_map(values):
    """The `HeightMap` of values [Y, X] in metres."""
    codes, base, step = scene_tables.pack_heights(values)
    size = np.int32(values.shape[1]), np.int32(values.shape[0])
    return table_lookup.HeightMap(codes.ravel(), np.int32(0), *size, np.float32(base), np.float32(step))


def test_heights_are_rounded_to_a_65535th_of_their_span_and_flat_maps_stay_flat():
    values = np.random.default_rng(4).uniform(-3, 13, (7, 9)).astype(np.float32)
    rows, columns = (axis.ravel().astype(np.float32) for axis in np.indices((6, 8)))
    found = np.empty(48, np.float32)
    read_heights(height_map(values), columns, rows, found)
    error = np.abs(found - values[:6, :8].ravel())
    assert error.max() <= 0.51 * np.ptp(values) / 65535 + 2e-6
    assert error.max() > 0
    read_heights(height_map(np.full((7, 9), np.float32(2.5))), columns, rows, found)
    assert (found == 2.5).all()


def test_slopes_of_a_table_are_the_differences_of_its_values_and_zero_outside():
    rng = np.random.default_rng(3)
    table = rng.uniform(-1, 1, (6, 9)).astype(np.float32)
    xs = (rng.integers(0, 8, 200) + rng.uniform(0.1, 0.9, 200)).astype(np.float32)
    ys = (rng.integers(0, 5, 200) + rng.uniform(0.1, 0.9, 200)).astype(np.float32)
    found = np.empty((200, 3), np.float32)
    heights = height_map(table)
    read_slopes(heights, xs, ys, found)
    small = 0.05
    height = lambda x, y: map_coordinates(table.astype(float), [y, x], order=1)  # noqa: E731
    np.testing.assert_allclose(found[:, 0], height(xs, ys), atol=3e-5)
    np.testing.assert_allclose(found[:, 1], (height(xs + small, ys) - height(xs - small, ys)) / (2 * small), atol=1e-3)
    np.testing.assert_allclose(found[:, 2], (height(xs, ys + small) - height(xs, ys - small)) / (2 * small), atol=1e-3)
    beyond = np.array([[-3.0, 2.5], [20.0, 2.5], [4.5, -1.0], [4.5, 9.0]], np.float32)
    read_slopes(heights, *beyond.T.copy(), found[:4])
    assert (found[:2, 1] == 0).all()
    assert (found[:2, 2] != 0).all()
    assert (found[2:4, 2] == 0).all()
    assert (found[2:4, 1] != 0).all()
