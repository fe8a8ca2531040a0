"""How much sun and sky reaches each place? The light of the valley, baked once for a sun that stands still.

Sun: `thalweg.world.light.sun_shadow`. Sky: a scan of the horizon, with crowns half transparent. The light that plants
and ground throw at each other is left to the renderer's ambient term.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numba import prange
from scipy.ndimage import gaussian_filter, minimum_filter

from thalweg.core.jit import kernel
from thalweg.world.light.crowns import (
    HEIGHT,
    KIND,
    OUTLINE,
    RADIUS,
    X,
    Y,
    Z,
    clump_tile,
    crown_depth,
    outlines,
    plant_table,
    roofs,
)
from thalweg.world.light.sun_shadow import (
    BAND_ROWS,
    BUCKET_M,
    BULGE,
    plant_depth,
    shade_bridges,
    shade_points,
    terrain_sun,
)
from thalweg.world.record import PARAPET_THICKNESS_M, Grid, Plants, World

f4 = np.float32

AZIMUTHS = 12
"""Directions in which the horizon is scanned."""
SKY_STRIDE = 2
"""Nodes between two places at which the sky is computed."""
SKY_REACH_M = 40.0
"""How far the horizon is scanned."""
CROWN_GAPS = 0.32
"""Share of the sky's light that comes through crowns and trunks that stand before it."""
COVER_SHADE = 0.6
"""Share of the sky's light that a closed roof of leaves overhead takes."""
TALL_M = 4.0
"""Height from which a plant hides the sky from its neighbours; a lower one shades the ground under it in
proportion."""


@dataclass(frozen=True)
class Baked:
    """The light of a valley; see the fields of the same names of `World`, and `Plants.light`."""

    sun: np.ndarray
    """[GY, GX] uint8."""
    sky: np.ndarray
    """[GY, GX] uint8."""
    canopy_m: np.ndarray
    """[GY, GX] float32."""
    plant_light: np.ndarray
    """[M, 2] float32."""


def bake(
    grid: Grid,
    ground_m: np.ndarray,
    water_m: np.ndarray,
    plants: Plants,
    bridges: np.ndarray,
    sun_azimuth: float,
    sun_elevation: float,
) -> Baked:
    """The light on the upper surface (water where it is wet, else ground) and on the plants, and the height of the
    canopy.

    Maps [GY, GX] float32 in metres; bridges [B, 11] as `thalweg.world.record.BRIDGE`; angles in radians. Raises
    ValueError for a sun lower than 5 degrees, whose shadows would cross the whole map.
    """
    if not math.radians(5.0) <= sun_elevation <= 0.5 * math.pi + 1e-9:
        raise ValueError(f"the sun must stand 5 to 90 degrees high, not {math.degrees(sun_elevation):.1f}")
    ray = sun_ray(sun_azimuth, sun_elevation)
    surface = np.maximum(ground_m, water_m).astype(np.float32)
    frame = np.array([grid.origin_x_m, grid.origin_y_m, grid.cell_m], np.float32)
    spans = np.ascontiguousarray(bridges, dtype=np.float64).reshape(-1, 11)
    table, outline, tile = plant_table(plants), outlines(), clump_tile()

    boxes = _shadow_boxes(grid, surface, table, ray)
    depth = plant_depth(surface, frame, table, boxes, *_bands(boxes, len(surface)), ray, outline, tile)
    sun = terrain_sun(surface, frame[2], ray) * np.exp(-depth)
    shade_bridges(sun, surface, frame, spans, ray)

    boxes = _shadow_boxes(grid, surface, table, None)
    canopy, tall, cover = crown_roof(surface, frame, table, boxes, *_bands(boxes, len(surface)), outline, roofs(), tile)
    _raise_bridges(canopy, tall, cover, grid, spans)
    return Baked(
        sun=_as_byte(sun),
        sky=_as_byte(_sky(surface, tall, cover, grid.cell_m)),
        canopy_m=canopy,
        plant_light=_plant_light(surface, frame, table, spans, ray, outline, tile),
    )


def relit(world: World, azimuth: float, elevation: float) -> World:
    """The same valley under another sun at these angles in radians, from 5 degrees high to the zenith.

    Takes about as long as the light of a new world. Raises `ValueError` as `bake` does.
    """
    baked = bake(world.grid, world.ground_m, world.water_m, world.plants, world.bridges, azimuth, elevation)
    return replace(
        world,
        sun=baked.sun,
        sky=baked.sky,
        canopy_m=baked.canopy_m,
        plants=replace(world.plants, light=baked.plant_light),
        sun_azimuth=float(azimuth),
        sun_elevation=float(elevation),
    )


def sun_ray(azimuth: float, elevation: float) -> np.ndarray:
    """[3] float32, unit vector (east, north, up) towards a sun at these angles in radians."""
    flat = max(math.cos(elevation), 1e-4)
    return np.array([flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)], np.float32)


def _as_byte(share: np.ndarray) -> np.ndarray:
    """0..1 -> uint8 0..255."""
    return np.rint(np.clip(share, 0.0, 1.0) * f4(255.0)).astype(np.uint8)


def _shadow_boxes(grid: Grid, surface: np.ndarray, table: np.ndarray, ray: np.ndarray | None) -> np.ndarray:
    """[M, 4] int32: first and last row, first and last column that each plant's shadow may touch; its crown alone
    for no ray."""
    rows, columns = surface.shape
    shift = np.zeros((len(table), 2))
    if ray is not None and len(table):
        drop = np.maximum(table[:, Z] - _low_ground(grid, surface, table, ray), 0.0)
        shift = -(table[:, HEIGHT] + drop)[:, None] * (ray[:2] / ray[2])[None, :]
    width = BULGE * table[:, RADIUS].astype(np.float64)
    box = np.empty((len(table), 4), np.int32)
    for axis, (origin, count) in enumerate(((grid.origin_y_m, rows), (grid.origin_x_m, columns))):
        foot = table[:, Y if axis == 0 else X].astype(np.float64)
        end = foot + shift[:, 1 - axis]
        low = (np.minimum(foot, end) - width - origin) / grid.cell_m
        high = (np.maximum(foot, end) + width - origin) / grid.cell_m
        box[:, 2 * axis] = np.clip(np.floor(low), 0, count - 1)
        box[:, 2 * axis + 1] = np.clip(np.ceil(high), 0, count - 1)
    return box


def _low_ground(grid: Grid, surface: np.ndarray, table: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """[M] float32: a lower bound of the surface as far round each plant as its shadow can fall."""
    block = 16
    rows, columns = surface.shape
    padded = np.pad(surface, ((0, -rows % block), (0, -columns % block)), mode="edge")
    coarse = padded.reshape(padded.shape[0] // block, block, -1, block).min(axis=(1, 3))
    relief = float(surface.max() - surface.min())
    reach = (float(table[:, HEIGHT].max()) + relief) * math.hypot(ray[0], ray[1]) / ray[2]
    span = 2 * math.ceil(reach / (block * grid.cell_m)) + 3
    low = minimum_filter(coarse, size=span, mode="nearest")
    row = np.clip((table[:, Y] - grid.origin_y_m) / grid.cell_m / block, 0, len(coarse) - 1).astype(int)
    column = np.clip((table[:, X] - grid.origin_x_m) / grid.cell_m / block, 0, coarse.shape[1] - 1).astype(int)
    return low[row, column]


def _bands(boxes: np.ndarray, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """(starts, members): the plants whose box [M, 4] meets each band of rows, in their own order."""
    first, last = boxes[:, 0] // BAND_ROWS, boxes[:, 1] // BAND_ROWS
    times = last - first + 1
    members = np.repeat(np.arange(len(boxes)), times)
    band = np.repeat(first, times) + np.arange(len(members)) - np.repeat(np.cumsum(times) - times, times)
    order = np.argsort(band, kind="stable")
    starts = np.searchsorted(band[order], np.arange(-(-rows // BAND_ROWS) + 1))
    return starts.astype(np.int32), members[order].astype(np.int32)


@kernel(parallel=True, fastmath=False)
def crown_roof(surface, frame, table, boxes, starts, members, outline, roof, tile):
    """Three maps [GY, GX] float32: height of all crowns' tops, of the tall plants' tops, and the share of light
    stopped from above."""
    rows, columns = surface.shape
    canopy = surface.copy()
    tall = surface.copy()
    cover = np.zeros((rows, columns), np.float32)
    up = np.array([f4(1e-4), f4(0.0), f4(1.0)])
    for band in prange(len(starts) - 1):
        for member in range(starts[band], starts[band + 1]):
            plant = table[members[member]]
            weight = min(plant[HEIGHT] / f4(TALL_M), f4(1.0))
            last = min(boxes[members[member], 1] + 1, min(rows, (band + 1) * BAND_ROWS))
            for i in range(max(boxes[members[member], 0], band * BAND_ROWS), last):
                dy = frame[1] + f4(i) * frame[2] - plant[Y]
                for j in range(boxes[members[member], 2], boxes[members[member], 3] + 1):
                    dx = frame[0] + f4(j) * frame[2] - plant[X]
                    share = math.sqrt(dx * dx + dy * dy) / plant[RADIUS]
                    if share <= f4(1.0):
                        level = roof[int(plant[KIND]), int(share * f4(OUTLINE - 1) + f4(0.5))]
                        top = plant[Z] + level * plant[HEIGHT]
                        canopy[i, j] = max(canopy[i, j], top)
                        tall[i, j] = max(tall[i, j], top if plant[HEIGHT] >= f4(TALL_M) else tall[i, j])
                        z = surface[i, j] - plant[Z]
                        cover[i, j] += weight * crown_depth(plant, dx, dy, z, up, outline, tile, members[member])
        for i in range(band * BAND_ROWS, min(rows, (band + 1) * BAND_ROWS)):
            for j in range(columns):
                cover[i, j] = f4(1.0) - math.exp(-cover[i, j])
    return canopy, tall, cover


def deck_over(grid: Grid, shape: tuple[int, int], bridge: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whether a node lies under a bridge [11], and the height of deck or parapet over it; both [GY, GX]."""
    x = grid.origin_x_m + grid.cell_m * np.arange(shape[1])[None, :]
    y = grid.origin_y_m + grid.cell_m * np.arange(shape[0])[:, None]
    cos, sin = math.cos(bridge[2]), math.sin(bridge[2])
    u = (x - bridge[0]) * cos + (y - bridge[1]) * sin
    v = (y - bridge[1]) * cos - (x - bridge[0]) * sin
    on = (np.abs(u) <= 0.5 * bridge[3]) & (np.abs(v) <= 0.5 * bridge[4])
    top = bridge[8] - bridge[9] * (2.0 * u / bridge[3]) ** 2
    return on, top + np.where(np.abs(v) > 0.5 * bridge[4] - PARAPET_THICKNESS_M, bridge[10], 0.0)


def _raise_bridges(canopy: np.ndarray, tall: np.ndarray, cover: np.ndarray, grid: Grid, bridges: np.ndarray) -> None:
    """Lift canopy and tall [GY, GX] to the tops of the bridges [B, 11], and close the cover [GY, GX] under them,
    in place."""
    for bridge in bridges:
        on, top = deck_over(grid, canopy.shape, bridge)
        for tops in (canopy, tall):
            tops[on] = np.maximum(tops[on], top[on])
        cover[on] = 1.0


def _sky(surface: np.ndarray, tall: np.ndarray, cover: np.ndarray, cell_m: float) -> np.ndarray:
    """[GY, GX] float32: share of the sky's light at each node, in 0..1."""
    stride = SKY_STRIDE
    cell = f4(cell_m * stride)
    solid = np.ascontiguousarray(surface[::stride, ::stride])
    leafy = np.ascontiguousarray(tall[::stride, ::stride])
    scanned = horizon_sky(solid, leafy, cell, _scan_steps(cell_m * stride), _compass())
    roof = gaussian_filter(cover, 0.8 / cell_m)
    return _refined(scanned, surface.shape, stride) * (f4(1.0) - f4(COVER_SHADE) * roof)


def _compass() -> np.ndarray:
    """[AZIMUTHS, 2] float32: unit vectors (east, north), evenly spaced. A table, since a compiler that works out a
    cosine beforehand may round it otherwise than the one that calls for it."""
    angle = (np.arange(AZIMUTHS) + 0.5) * 2.0 * np.pi / AZIMUTHS
    return np.stack([np.cos(angle), np.sin(angle)], axis=1).astype(np.float32)


def _scan_steps(cell_m: float) -> np.ndarray:
    """[D] float32: distances in nodes at which the horizon is looked at, close together near by and wider far off."""
    steps = [1.0]
    while steps[-1] * cell_m < SKY_REACH_M:
        steps.append(max(steps[-1] + 1.0, steps[-1] * 1.15))
    return np.array(steps, np.float32)


@kernel(parallel=True, fastmath=False)
def horizon_sky(solid, leafy, cell, steps, compass):
    """[R, C] float32: cosine-weighted share of the sky that is free over each node of solid [R, C], in metres.

    A sky of even radiance gives a level surface the mean over azimuth of cos² of the horizon's angle. What leafy
    [R, C] hides above the solid horizon still lets `CROWN_GAPS` through.
    """
    rows, columns = solid.shape
    out = np.empty((rows, columns), np.float32)
    for i in prange(rows):
        for j in range(columns):
            total = f4(0.0)
            for a in range(len(compass)):
                east, north = compass[a, 0], compass[a, 1]
                ground = f4(0.0)
                crown = f4(0.0)
                for k in range(len(steps)):
                    x = int(f4(j) + steps[k] * east + f4(0.5))
                    y = int(f4(i) + steps[k] * north + f4(0.5))
                    if x < 0 or y < 0 or x >= columns or y >= rows:
                        break
                    ground = max(ground, (solid[y, x] - solid[i, j]) / (steps[k] * cell))
                    crown = max(crown, (leafy[y, x] - solid[i, j]) / (steps[k] * cell))
                open_sky = f4(1.0) / (f4(1.0) + ground * ground)
                over_crowns = f4(1.0) / (f4(1.0) + max(ground, crown) ** 2)
                total += over_crowns + f4(CROWN_GAPS) * (open_sky - over_crowns)
            out[i, j] = total / f4(AZIMUTHS)
    return out


def _refined(coarse: np.ndarray, shape: tuple[int, int], stride: int) -> np.ndarray:
    """[GY, GX] float32: a map known at every stride-th node, linear between them."""
    for axis in (0, 1):
        at = np.minimum(np.arange(shape[axis], dtype=np.float32) / f4(stride), f4(coarse.shape[axis] - 1))
        low = np.minimum(at.astype(np.int64), coarse.shape[axis] - 1)
        high = np.minimum(low + 1, coarse.shape[axis] - 1)
        share = (at - low).astype(np.float32).reshape((-1, 1) if axis == 0 else (1, -1))
        coarse = np.take(coarse, low, axis) * (f4(1.0) - share) + np.take(coarse, high, axis) * share
    return coarse


def _plant_light(surface, frame, table, bridges, ray, outline, tile) -> np.ndarray:
    """[M, 2] float32: mean share of sun about a metre above the foot of each plant and at its top; its own shade
    left out."""
    count = len(table)
    if count == 0:
        return np.zeros((0, 2), np.float32)
    columns = int(surface.shape[1] * frame[2] / BUCKET_M) + 1
    rows = int(surface.shape[0] * frame[2] / BUCKET_M) + 1
    bucket = np.clip((table[:, Y] - frame[1]) / BUCKET_M, 0, rows - 1).astype(np.int64) * columns
    bucket += np.clip((table[:, X] - frame[0]) / BUCKET_M, 0, columns - 1).astype(np.int64)
    members = np.argsort(bucket, kind="stable").astype(np.int32)
    starts = np.searchsorted(bucket[members], np.arange(rows * columns + 1)).astype(np.int32)
    own = np.repeat(np.arange(count, dtype=np.int32), len(PROBES))
    shares = []
    for height, spread in ((np.minimum(1.0, 0.5 * table[:, HEIGHT]), 0.6), (0.93 * table[:, HEIGHT], 0.25)):
        points = np.repeat(table[:, X : Z + 1], len(PROBES), axis=0)
        points[:, :2] += np.tile(PROBES, (count, 1)) * np.repeat(spread * table[:, RADIUS], len(PROBES))[:, None]
        points[:, 2] += np.repeat(height, len(PROBES))
        share = shade_points(points, own, surface, frame, table, starts, members, columns, bridges, ray, outline, tile)
        shares.append(share.reshape(count, len(PROBES)).mean(axis=1))
    return np.stack(shares, axis=1)


PROBES = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)], np.float32)
"""Where the light of a plant is probed, in shares of a distance from its axis."""
