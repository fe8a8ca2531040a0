"""The height maps of the valley: ground and water surface on its grid.

From the bank outwards: sand that slopes up from the water's edge, a grassy plain, hills. From the bank inwards: a
carved bed, deeper on the outside of bends. All roughness fades to zero at the water's edge, so that the map and the
rules agree on where the water ends.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from thalweg.core.compute.jit import kernel
from thalweg.world import bridges, islands
from thalweg.world.errors import WorldError
from thalweg.world.generate import shore
from thalweg.world.generate.continuation import continued
from thalweg.world.generate.shore import Shore
from thalweg.world.generate.side_channels import Branch
from thalweg.world.noise import fractal, smooth_step
from thalweg.world.record import Grid, River
from thalweg.world.validation import smoothed_curvature

f4 = np.float32
CELL_M = 0.25
"""Spacing of the nodes."""
MARGIN_M = 55.0
"""Land between the course and the map's edge."""
MAX_NODES = 16_000_000
"""Maximum number of nodes; a long course gets a coarser grid."""
MAX_AREA_M2 = 6e6
"""Maximum area of a map: beyond it, nodes would be more than 0.6 m apart."""
MIN_SAND_SLOPE, MAX_SAND_SLOPE = 0.15, 0.35
"""Range of the slope of the sand at the water's edge."""
LEVEL_BLEND_M = 2.5
"""Distance from the bank over which the water level blends from that of the nearest point to the valley's."""


@dataclass(frozen=True)
class Relief:
    """The shape of the land around a river."""

    hills_m: float = 6.0
    """Height of the hills above the plain."""
    cut_banks: float = 0.0
    """0..1, steepness of the outer banks of bends."""


@dataclass(frozen=True)
class Terrain:
    """The maps that paint, plants and light build on."""

    grid: Grid
    ground_m: np.ndarray
    """[GY, GX] float32."""
    water_m: np.ndarray
    """[GY, GX] float32."""
    shore_m: np.ndarray
    """[GY, GX] float32, distance from the nearest water's edge of any water, negative in it."""
    keep_clear: np.ndarray
    """[GY, GX] bool, bridges and the ways to them, free of plants."""


def check_area(position_m: np.ndarray) -> None:
    """Raise `WorldError` unless a line [S, 2] and the land around it fit on a map."""
    size = np.ptp(position_m, axis=0) + 2 * MARGIN_M
    if np.prod(size) > MAX_AREA_M2:
        raise WorldError(
            f"the map covers {size[0]:.0f} x {size[1]:.0f} m, {np.prod(size) / 1e6:.1f} km²; "
            f"limit {MAX_AREA_M2 / 1e6:.1f} km²"
        )


def make_grid(position_m: np.ndarray) -> tuple[Grid, tuple[int, int]]:
    """Return the grid around a line [S, 2] and its shape (GY, GX); raises `WorldError` for a line that is too long."""
    check_area(position_m)
    low = position_m.min(axis=0) - MARGIN_M
    size = np.ptp(position_m, axis=0) + 2 * MARGIN_M
    cell = max(CELL_M, float(np.sqrt(np.prod(size) / MAX_NODES)))
    origin = np.floor(low / cell) * cell
    shape = (int(np.ceil(size[1] / cell)) + 2, int(np.ceil(size[0] / cell)) + 2)
    return Grid(float(origin[0]), float(origin[1]), cell), shape


def axes(grid: Grid, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return x [GX] and y [GY] of the nodes in metres."""
    rows, columns = shape
    return grid.origin_x_m + np.arange(columns) * grid.cell_m, grid.origin_y_m + np.arange(rows) * grid.cell_m


@kernel(fastmath=False)
def _interpolate(values, position):
    """Return values [S] interpolated at a fractional index along the course, around the end of a closed one."""
    index = int(position)
    share = position - index
    count = len(values)
    return values[index % count] * (1 - share) + values[(index + 1) % count] * share


@kernel(fastmath=False)
def _interpolate_map(values, course_index, out):
    """Fill `out` [GY, GX] with values [S] interpolated at the fractional index of each node."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = _interpolate(values, course_index[i, j])


def water_surface(grid: Grid, course_shore: Shore, river: River) -> np.ndarray:
    """Return [GY, GX] float32: the river's level at the nearest point, and further out that of the valley."""
    shape = course_shore.edge_m.shape
    if np.ptp(river.level_m) == 0.0:
        return np.full(shape, river.level_m[0], np.float32)
    local = np.empty(shape, np.float32)
    _interpolate_map(river.level_m, course_shore.course_index, local)
    x, y = axes(grid, shape)
    # The valley's level is smooth, so it is computed on a coarse grid and interpolated.
    coarse = max(2.0, grid.cell_m * np.sqrt(shape[0] * shape[1] / 20_000))
    coarse_x = np.arange(x[0], x[-1] + 2 * coarse, coarse)
    coarse_y = np.arange(y[0], y[-1] + 2 * coarse, coarse)
    valley = shore.valley_levels(coarse_x, coarse_y, river)
    rows = np.broadcast_to(((y - y[0]) / coarse)[:, None], shape)
    columns = np.broadcast_to(((x - x[0]) / coarse)[None, :], shape)
    smooth = scipy.ndimage.map_coordinates(valley, [rows, columns], order=2, output=np.float32)
    return local + (smooth - local) * smooth_step(0.0, LEVEL_BLEND_M, course_shore.edge_m)


@kernel(fastmath=False)
def _channel_depth(edge, across, course_index, depth, bend, rough, out):
    """Fill `out` [GY, GX] with the depth of the bed below the water; land nodes are left as they are.

    Across the river it is D (1 - u²)^1.4 (1 - k u): D on the centre line, 0 at the bank, with the deepest point on the
    outside of a bend (u < 0 is right; k has the sign of the curvature). A gentle slope is added at the bank.
    """
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            if edge[i, j] >= 0:
                continue
            u = across[i, j]
            # 1 on the centre line, 0 at the bank; the maximum guards against rounding beyond the bank.
            open_share = max(1.0 - u * u, 0.0)
            middle = _interpolate(depth, course_index[i, j])
            skew = 1.0 - _interpolate(bend, course_index[i, j]) * u
            bed = middle * open_share**1.4 * skew * (1.0 + 0.12 * rough[i, j] * open_share * min(abs(u) * 3.0, 1.0))
            out[i, j] = max(bed, 0.0) + 0.12 * min(-edge[i, j], 1.5) * u * u


@kernel(fastmath=False)
def _land_height(x, slope, plain, cut, rough, hill, fine, out):
    """Fill `out` [GY, GX] with the height of the land above the water at distance x [GY, GX] from its edge.

    Sand rises with `slope` and levels off at the height `plain`: P (1 - exp(-m x / P)). Cut banks, hills and roughness
    are added further from the edge. Water nodes are left as they are.
    """
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            d = x[i, j]
            if d <= 0:
                continue
            p = plain[i, j]
            height = p * (1.0 - np.exp(-slope[i, j] * d / p))
            # Each term fades in by a smoothstep 3t² - 2t³ (or t²) of its own distance from the edge.
            t = min(d / 1.3, 1.0)
            height += cut[i, j] * t * t * (3.0 - 2.0 * t)
            t = min(max((d - 7.0) / 45.0, 0.0), 1.0)
            height += hill[i, j] * t * t * (3.0 - 2.0 * t)
            t = min(max(d / 10.0, 0.0), 1.0)
            height += rough[i, j] * t * t
            t = min(d / 2.5, 1.0)
            height += fine[i, j] * t * t * (3.0 - 2.0 * t)
            # A minimum slope keeps the land above the water, so that no puddles form.
            out[i, j] = max(height, 0.13 * min(d, 2.0))


def _cut_banks(course_shore: Shore, river: River, bend: np.ndarray, strength: float, patches: np.ndarray) -> np.ndarray:
    """Return [GY, GX] float32 the extra height of outer banks, in patches; it fades where two arms meet."""
    outer = np.empty(course_shore.edge_m.shape, np.float32)
    _interpolate_map(bend, course_shore.course_index, outer)
    outer *= -np.sign(course_shore.across)
    fade = 1 - smooth_step(2.5, 7.0, course_shore.edge_m)
    return f4(1.3 * strength) * smooth_step(0.12, 0.4, outer) * smooth_step(-0.4, 0.6, patches) * fade


def raise_land(
    grid: Grid, course_shore: Shore, river: River, edge: np.ndarray, relief: Relief, rng: np.random.Generator
) -> np.ndarray:
    """Return [GY, GX] float32 the height of the land above the water's surface, 0 in the water."""
    shape, cell = edge.shape, grid.cell_m
    middle, half = (MAX_SAND_SLOPE + MIN_SAND_SLOPE) / 2, (MAX_SAND_SLOPE - MIN_SAND_SLOPE) / 2
    slope = f4(middle) + f4(half) * np.tanh(fractal(shape, cell, 22.0, 2, rng))
    plain = f4(1.7) + f4(0.7) * np.tanh(fractal(shape, cell, 40.0, 2, rng))
    hill = fractal(shape, cell, 95.0, 4, rng, gain=0.45)
    hill = f4(relief.hills_m) * np.clip(f4(0.45) + f4(0.3) * hill, 0, 1)
    rough = f4(0.18) * fractal(shape, cell, 15.0, 4, rng, gain=0.5)
    fine = f4(0.025) * fractal(shape, cell, 2.5, 3, rng, gain=0.6)
    cut = np.zeros(shape, np.float32)
    if relief.cut_banks > 0:
        cut = _cut_banks(course_shore, river, bend_skew(river), relief.cut_banks, fractal(shape, cell, 30.0, 2, rng))
    height = np.zeros(shape, np.float32)
    _land_height(edge, slope, plain, cut, rough, hill, fine, height)
    return height


def bend_skew(river: River) -> np.ndarray:
    """Return [S] -0.5..0.5, the shift of the deepest water to the outside of a bend; positive in left turns."""
    return np.clip(5.0 * smoothed_curvature(river), -0.5, 0.5)


def build_terrain(
    river: River,
    island_rows: np.ndarray,
    bridge_rows: np.ndarray,
    branches: tuple[Branch, ...],
    relief: Relief,
    rng: np.random.Generator,
) -> Terrain:
    """Return the maps of a river [S] with islands [I, 5], bridges [B, 11] and side channels.

    The channel of an open river goes on to the edges of the map.

    Raises `WorldError` for a course whose map would be too large.
    """
    grid, shape = make_grid(river.position_m)
    river = continued(river, grid, shape)
    course_shore = shore.measure(grid, shape, river)
    water = water_surface(grid, course_shore, river)
    rough_bed = fractal(shape, grid.cell_m, 7.0, 3, rng)
    depth = np.zeros(shape, np.float32)
    _channel_depth(
        course_shore.edge_m,
        course_shore.across,
        course_shore.course_index,
        river.depth_m,
        bend_skew(river),
        rough_bed,
        depth,
    )

    edge = course_shore.edge_m
    for branch in branches:
        side, half = shore.measure_discs(grid, shape, branch.position_m, branch.width_m)
        out_of_course = smooth_step(0.0, 3.0, course_shore.edge_m) * (1 - smooth_step(1.0, 6.0, side))
        water += (f4(branch.level_m) - water) * out_of_course
        share = np.clip(1 + side / half, 0, 1)
        depth = np.maximum(depth, f4(branch.depth_m) * np.where(side < 0, 1 - share**2, 0))
        edge = np.minimum(edge, side)

    height = raise_land(grid, course_shore, river, edge, relief, rng)
    ground = water + height - depth
    x, y = (values.astype(np.float32) for values in axes(grid, shape))
    for row in island_rows:
        _raise_island(ground, water, depth, edge, grid, row)
    keep_clear = np.zeros(shape, bool)
    for row in bridge_rows:
        raise_causeway(ground, water, course_shore.edge_m, keep_clear, x, y, row)
    return Terrain(grid, ground, water, edge, keep_clear)


def _window(values: np.ndarray, start: float, cell: float, centre: float, reach: float) -> slice:
    """Return the slice of nodes within `reach` of `centre` along one axis."""
    low = int((centre - reach - start) / cell)
    high = int((centre + reach - start) / cell) + 2
    return slice(max(low, 0), min(high, len(values)))


def _raise_island(
    ground: np.ndarray, water: np.ndarray, depth: np.ndarray, edge: np.ndarray, grid: Grid, row: np.ndarray
) -> None:
    """Add a sandy hump with shoals around it to the ground, in place; `edge` gets the distance from its shore."""
    x, y = axes(grid, ground.shape)
    columns = _window(x, grid.origin_x_m, grid.cell_m, row[0], row[2] + 12.0)
    rows = _window(y, grid.origin_y_m, grid.cell_m, row[1], row[2] + 12.0)
    at = np.ix_(np.arange(rows.start, rows.stop), np.arange(columns.start, columns.stop))
    node_x, node_y = np.meshgrid(x[columns], y[rows])
    gap = islands.distance(row, node_x, node_y).astype(np.float32)
    inside = np.clip(1 - islands.squared_radius(row, node_x, node_y), 0, 1).astype(np.float32)
    hump = f4(np.clip(0.3 + 0.28 * (row[3] - 0.8), 0.3, 0.8))
    wet = edge[at] < 0
    shoal = np.minimum(depth[at], f4(0.35) * np.maximum(gap, 0) + f4(0.04) * np.maximum(gap, 0) ** 2)
    level = np.where(gap <= 0, hump * inside, -shoal)
    ground[at] = np.where(wet, water[at] + level, ground[at])
    edge[at] = np.maximum(edge[at], np.where(wet, -gap, edge[at]))


def raise_causeway(
    ground: np.ndarray,
    water: np.ndarray,
    edge: np.ndarray,
    keep_clear: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    row: np.ndarray,
) -> None:
    """Raise the banks to a bridge's ends, in place, never steeper than 1 : 1 from the water's edge."""
    cell = float(x[1] - x[0])
    reach = row[3] / 2 + 25.0
    columns = _window(x, float(x[0]), cell, row[0], reach)
    rows = _window(y, float(y[0]), cell, row[1], reach)
    node_x, node_y = np.meshgrid(x[columns], y[rows])
    window = (rows, columns)
    way = np.minimum(bridges.causeway(row, node_x, node_y), water[window] + edge[window]).astype(np.float32)
    ground[window] = np.where(edge[window] > 0, np.maximum(ground[window], way), ground[window])
    keep_clear[window] |= bridges.on_approach(row, node_x, node_y)
