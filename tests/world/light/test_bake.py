"""Tests of the baked light: known shadows of walls, pits, bridges and trees, and slow reference versions."""

import math

import numpy as np
import pytest

from tests.world.valley import valley
from thalweg.core.compute.threads import get_num_threads, set_num_threads
from thalweg.world.generate.plants import scatter
from thalweg.world.light.bake import BakedLight, bake, sun_ray
from thalweg.world.light.crowns import (
    EXTINCTION,
    LEVELS,
    OUTLINE,
    TILE,
    TILE_CELL_M,
    TRUNK,
    clump_tile,
    outlines,
    plant_table,
)
from thalweg.world.light.sun_shadow import SUN_RADIUS, in_bridge, terrain_sun
from thalweg.world.record import Grid, Plants
from thalweg.world.species import KINDS

CELL = 0.25
SOUTH = -0.5 * math.pi
NO_BRIDGES = np.zeros((0, 11))
BRIDGE = np.array([[0.0, 0.0, 0.0, 16.0, 3.0, 9.0, 0.2, 1.6, 2.4, 0.0, 0.0]])
"""Across the x axis from -8 to 8 m, 3 m wide; its arch is 1.8 m high in the middle and its deck 2.4 m."""


def planted(*rows: tuple[str, float, float, float, float]) -> Plants:
    """Plants from rows of kind's name, x, y, height, width, standing on z = 0."""
    names = [kind.name for kind in KINDS]
    count = len(rows)
    return Plants(
        position_m=np.array([(x, y, 0.0) for _, x, y, _, _ in rows], np.float32).reshape(count, 3),
        height_m=np.array([row[3] for row in rows], np.float32),
        width_m=np.array([row[4] for row in rows], np.float32),
        kind=np.array([names.index(row[0]) for row in rows], np.int16),
        turn=np.zeros(count, np.float32),
        tint=np.ones((count, 3), np.float32),
        light=np.ones((count, 2), np.float32),
    )


def centred(size: int) -> Grid:
    """A grid of size x size nodes with the node (size // 2, size // 2) at the origin."""
    return Grid(-(size // 2) * CELL, -(size // 2) * CELL, CELL)


def lit(
    size: int = 161, *, ground=None, plants: Plants | None = None, bridges=NO_BRIDGES, azimuth=SOUTH, elevation=45.0
) -> BakedLight:
    """The light of a plain at z = 0 (or of `ground`), its water far below, under a sun `elevation` degrees high."""
    ground = np.zeros((size, size), np.float32) if ground is None else ground.astype(np.float32)
    water = np.full_like(ground, -50.0)
    return bake(centred(size), ground, water, plants or planted(), bridges, azimuth, math.radians(elevation))


def across(baked: BakedLight, x_m: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """(y in metres, share of sun) along the line of nodes at x."""
    size = len(baked.sun)
    return (np.arange(size) - size // 2) * CELL, baked.sun[:, size // 2 + round(x_m / CELL)] / 255.0


def test_an_open_plain_has_full_sun_and_sky():
    baked = lit(64, elevation=30.0)
    assert baked.sun.min() == 255
    assert baked.sky.min() == 255
    assert np.array_equal(baked.canopy_m, np.zeros((64, 64), np.float32))


@pytest.mark.parametrize("elevation", [25.0, 45.0, 60.0])
def test_shadow_of_a_wall_is_as_long_as_its_height_over_the_tangent(elevation):
    ground = np.zeros((161, 161))
    ground[60:71] = 4.0
    y, sun = across(lit(ground=ground, elevation=elevation))
    edge = y[70]
    reached = y[71:][sun[71:] >= 0.5][0] - edge
    assert reached == pytest.approx(4.0 / math.tan(math.radians(elevation)), abs=CELL)
    assert np.all(sun[:60] == 1.0)


def test_shadow_falls_away_from_the_sun_at_any_azimuth():
    ground = np.zeros((161, 161))
    ground[79:82, 79:82] = 6.0
    for azimuth in np.linspace(0.3, 6.0, 5):
        baked = lit(ground=ground, azimuth=azimuth)
        row, column = np.nonzero((baked.sun < 128) & (ground == 0.0))
        away = math.atan2(-(row - 80).mean(), -(column - 80).mean())
        assert math.cos(away - azimuth) > 0.995


def test_water_above_the_ground_is_what_receives_the_light():
    ground = np.full((161, 161), -3.0)
    ground[:70] = 4.0
    baked = bake(
        centred(161),
        ground.astype(np.float32),
        np.zeros((161, 161), np.float32),
        planted(),
        NO_BRIDGES,
        SOUTH,
        0.785398,
    )
    y, sun = across(baked)
    assert y[70:][sun[70:] >= 0.5][0] - y[69] == pytest.approx(4.0, abs=CELL)


def test_terrain_march_agrees_with_a_slow_reference():
    rng = np.random.default_rng(4)
    surface = np.cumsum(np.cumsum(rng.standard_normal((48, 48)), 0), 1).astype(np.float32)
    surface = 5.0 * (surface - surface.min()) / np.ptp(surface) + rng.uniform(0.0, 0.6, (48, 48))
    surface = surface.astype(np.float32)
    ray = sun_ray(0.7, math.radians(30.0))
    slow = terrain_sun_slowly(surface.astype(np.float64), CELL, ray.astype(np.float64))
    fast = terrain_sun(surface, np.float32(CELL), ray)
    assert 0.05 < slow.mean() < 0.95
    assert np.abs(fast - slow).max() < 2e-3


def terrain_sun_slowly(surface: np.ndarray, cell: float, ray: np.ndarray) -> np.ndarray:
    """The definition of `terrain_sun`: least clearance of the ray over the linear surface, in half widths of the
    penumbra."""
    rows, columns = surface.shape
    flat = math.hypot(ray[0], ray[1])
    rise = cell * ray[2] / flat
    out = np.ones((rows, columns))
    for i in range(rows):
        for j in range(columns):
            n = 0
            while True:
                n += 1
                x, y, z = j + n * ray[0] / flat, i + n * ray[1] / flat, surface[i, j] + n * rise
                if not (0 <= x <= columns - 1 and 0 <= y <= rows - 1) or z > surface.max() + 2.0 * rise:
                    break
                jj, ii = min(int(x), columns - 2), min(int(y), rows - 2)
                corner = surface[ii : ii + 2, jj : jj + 2]
                below = np.array([ii + 1 - y, y - ii]) @ corner @ np.array([jj + 1 - x, x - jj])
                half = max(n * min(cell * SUN_RADIUS / flat**2, 0.5 * rise), rise * 0.33)
                out[i, j] = min(out[i, j], 0.5 + 0.5 * (z - below) / half)
    return np.clip(out, 0.0, 1.0)


@pytest.mark.parametrize(("radius", "deep"), [(4.0, 5.0), (6.0, 5.0), (9.0, 5.0), (4.0, 12.0)])
def test_sky_in_the_middle_of_a_round_pit_is_the_analytic_share(radius, deep):
    at = (np.arange(161) - 80) * CELL
    inside = np.hypot(at[:, None], at[None, :]) < radius
    sky = lit(ground=np.where(inside, -deep, 0.0)).sky[80, 80] / 255.0
    assert sky == pytest.approx(radius**2 / (radius**2 + deep**2), abs=0.03)


def test_a_bridge_casts_the_shadow_of_its_deck_and_passes_light_through_its_arch():
    y, sun = across(lit(bridges=BRIDGE))
    expected = ((y < 0.3) | (y > 3.9)).astype(float)
    sure = (np.abs(y - 0.3) > 0.2) & (np.abs(y - 3.9) > 0.2)
    assert np.array_equal(sun[sure], expected[sure])


def test_bridge_is_solid_beside_its_arch():
    y, sun = across(lit(bridges=BRIDGE), x_m=6.0)
    shaded = (y > -1.3) & (y < 3.7)
    assert sun[shaded].max() == 0.0
    assert sun[(y < -1.8) | (y > 4.2)].min() == 1.0


@pytest.mark.parametrize(
    ("point", "solid"),
    [
        ((0.0, 0.0, 1.7), False),
        ((0.0, 0.0, 1.9), True),
        ((0.0, 0.0, 2.5), False),
        ((4.4, 0.0, 1.0), True),
        ((8.1, 0.0, 1.0), False),
    ],
)
def test_points_in_and_out_of_a_bridge(point, solid):
    assert in_bridge(BRIDGE[0], *point) == solid


def test_the_shadow_of_one_tree_is_where_geometry_puts_it():
    y, _ = across(baked := lit(plants=planted(("fir-1", 0.0, 0.0, 12.0, 5.0))))
    x = y
    sun = baked.sun / 255.0
    core = sun[(y > 2.0) & (y < 5.0)][:, np.abs(x) < 0.6]
    assert core.mean() < 0.25
    assert sun[(y > 13.0) | (y < -4.0)].min() == 1.0
    assert sun[:, np.abs(x) > 4.0].min() == 1.0
    dark = 1.0 - sun
    assert abs((dark * x[None, :]).sum() / dark.sum()) < 0.4
    assert 3.0 < (dark * y[:, None]).sum() / dark.sum() < 6.0


def test_light_passes_below_a_crown_between_the_trunks():
    plants = planted(*(("pine-2", x, 0.0, 12.0, 4.5) for x in np.arange(-9.0, 9.1, 3.0)))
    y, sun = across(lit(plants=plants), x_m=1.5)
    assert sun[(y > 1.0) & (y < 3.0)].min() > 0.8
    assert sun[(y > 7.0) & (y < 9.0)].mean() < 0.6


def test_a_trunk_casts_a_stripe():
    baked = lit(plants=planted(("oak-1", 0.0, 0.0, 12.0, 2.0)))
    y, sun = across(baked)
    assert sun[(y > 0.2) & (y < 1.0)].max() < 0.3
    assert across(baked, x_m=1.0)[1][(y > 0.2) & (y < 1.0)].min() > 0.9


def test_shadow_has_ragged_edges_and_flecks():
    baked = lit(plants=planted(("oak-1", 0.0, 0.0, 12.0, 9.0)))
    width = (baked.sun < 128).sum(axis=1)[100:115]
    assert len(set(width)) > 6
    assert np.percentile(baked.sun[100:115, 74:87], 95) - np.percentile(baked.sun[100:115, 74:87], 5) > 20


def test_plant_shade_agrees_with_a_slow_reference():
    plants = planted(("oak-1", -4.0, 1.0, 10.0, 7.0), ("pine-1", 2.0, -2.0, 13.0, 5.5), ("rock-1", 5.0, 5.0, 1.0, 1.5))
    ray = sun_ray(1.1, math.radians(50.0))
    ground = np.zeros((161, 161), np.float32)
    ground += np.float32(0.03) * np.arange(161, dtype=np.float32)[:, None]
    baked = bake(centred(161), ground, ground - 9.0, plants, NO_BRIDGES, 1.1, math.radians(50.0))
    slow = np.exp(-plant_depth_slowly(ground, centred(161), plant_table(plants).astype(np.float64), ray))
    wrong = np.abs(baked.sun / 255.0 - slow)
    assert slow.min() < 0.05
    assert np.mean(wrong > 0.01) < 0.003


def plant_depth_slowly(surface: np.ndarray, grid: Grid, table: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """The definition of `plant_depth`: every plant over the whole map, in float64."""
    rows, columns = surface.shape
    x = grid.origin_x_m + grid.cell_m * np.arange(columns)[None, :]
    y = grid.origin_y_m + grid.cell_m * np.arange(rows)[:, None]
    outline, tile = outlines(), clump_tile()
    flat = math.hypot(ray[0], ray[1])
    depth = np.zeros((rows, columns))
    for m, (px, py, pz, height, radius, base, extinction, trunk, kind) in enumerate(table):
        z, dx, dy = surface - pz, x - px, y - py
        thick = (1.0 - base) * height / LEVELS
        for level in range(LEVELS):
            middle = base * height + (level + 0.5) * thick
            rise = np.maximum(middle - z, 0.0) / ray[2]
            u, v = dx + rise * ray[0], dy + rise * ray[1]
            share = np.hypot(u, v) / max(radius * outline[int(kind), int(middle / height * (OUTLINE - 1) + 0.5)], 0.01)
            column = (((u + 60.0) / TILE_CELL_M).astype(int) + 37 * m + 53 * level) % TILE
            row = (((v + 60.0) / TILE_CELL_M).astype(int) + 71 * m + 29 * level) % TILE
            leaf = np.ones_like(u) if extinction > 20.0 else tile[row, column]
            inside = np.where(share < 1.5, np.clip(5.0 * (1.0 - share + 0.3 * (leaf - 0.8)), 0.0, 1.0), 0.0)
            above = np.clip((middle - z) / thick + 0.5, 0.0, 1.0)
            depth += above * inside * leaf * extinction * thick / ray[2]
        along = -(dx * ray[0] + dy * ray[1]) / flat
        aside = np.abs(dx * ray[1] - dy * ray[0]) / flat
        share = (z + along * ray[2] / flat) / height
        thickness, blur = trunk * (1.0 - 0.75 * share), 0.5 * grid.cell_m
        cover = np.minimum(
            np.clip((thickness + blur - aside) / (2.0 * blur), 0.0, None), np.minimum(1.0, thickness / blur)
        )
        depth += np.where((along > -0.1) & (share > 0.0) & (share < 0.85), 4.0 * cover, 0.0)
    assert (EXTINCTION, TRUNK) == (6, 7)
    return depth


def test_canopy_is_crown_shaped():
    baked = lit(plants=planted(("fir-1", 0.0, 0.0, 12.0, 5.0), ("oak-1", 12.0, 0.0, 10.0, 8.0)))
    line = baked.canopy_m[80]
    assert line[80] == pytest.approx(12.0, abs=0.1)
    assert line[128] == pytest.approx(10.0, abs=0.1)
    assert line[85] < 9.0
    assert line[133] > 8.5
    assert line[80 - 11] == 0.0


def test_canopy_has_the_decks_of_bridges():
    baked = lit(bridges=BRIDGE)
    assert baked.canopy_m[80, 80] == pytest.approx(2.4)
    assert baked.canopy_m[80 + 8, 80] == 0.0


def test_forest_floor_sees_little_sky_and_the_bank_less_than_the_plain():
    rows = [("oak-1", x, y, 11.0, 7.0) for x in np.arange(-18.0, 19.0, 3.5) for y in np.arange(0.0, 19.0, 3.5)]
    sky = lit(plants=planted(*rows)).sky / 255.0
    assert sky[125:135, 70:90].mean() < 0.25
    assert 0.45 < sky[62:66, 70:90].mean() < 0.85
    assert sky[2, 80] > sky[62:66, 80].max()


def test_first_row_is_lit_at_its_foot_and_the_row_behind_only_on_top():
    front = [("oak-1", x, 0.0, 9.0, 7.0) for x in np.arange(-14.0, 15.0, 2.5)]
    light = lit(
        plants=planted(*front, ("birch-1", 0.0, 3.0, 12.5, 5.0), ("birch-1", 0.0, -12.0, 12.0, 5.0))
    ).plant_light
    assert light[-1] == pytest.approx([1.0, 1.0])
    assert light[-2, 0] < 0.3
    assert light[-2, 1] > 0.9


def test_result_is_the_same_for_any_number_of_threads():
    grid, ground, water, shore, clear = valley(200)
    plants = scatter(grid, ground, water, shore, clear, 1.0, np.random.default_rng(1))
    results = []
    before = get_num_threads()
    if before == 1:
        pytest.skip("there is one thread only")
    try:
        for threads in (1, before):
            set_num_threads(threads)
            results.append(bake(grid, ground, water, plants, BRIDGE, 2.0, 0.96))
    finally:
        set_num_threads(before)
    for name in ("sun", "sky", "canopy_m", "plant_light"):
        assert np.array_equal(getattr(results[0], name), getattr(results[1], name)), name


def test_a_sun_near_the_horizon_is_an_error():
    with pytest.raises(ValueError, match="5 to 90 degrees"):
        lit(16, elevation=1.0)


def test_a_wall_casts_no_shadow_under_a_sun_overhead():
    ground = np.zeros((64, 64))
    ground[20:30] = 4.0
    assert lit(64, ground=ground, elevation=90.0).sun.min() == 255
