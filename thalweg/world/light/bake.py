"""The baked light of a valley: the share of sun and sky that reaches each node and plant, for a fixed sun.

Sun: `thalweg.world.light.sun_shadow`. Sky: a scan of the horizon, in which crowns are half transparent. Light that
plants and ground reflect at each other is left to the renderer's ambient term.
"""

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.ndimage import gaussian_filter, minimum_filter

from thalweg.core.jit import kernel
from thalweg.core.threads import run_in_threads
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
    add_plant_depth,
    shade_bridges,
    shade_points,
    terrain_sun,
)
from thalweg.world.record import PARAPET_THICKNESS_M, Grid, Plants, World

f4 = np.float32

AZIMUTHS = 12
"""Number of directions in which the horizon is scanned."""
SKY_STRIDE = 2
"""Spacing, in nodes, at which the sky is computed."""
SKY_REACH_M = 40.0
"""Distance to which the horizon is scanned."""
CROWN_GAPS = 0.32
"""Share of the sky's light that passes through the crowns and trunks in front of it."""
COVER_SHADE = 0.6
"""Share of the sky's light that a closed canopy overhead stops."""
TALL_M = 4.0
"""Height from which a plant hides the sky from its neighbours. A lower one shades only the ground under it, in
proportion to its height."""
PROBES = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)], np.float32)
"""Offsets from a plant's axis at which its light is sampled, as shares of a radius."""


@dataclass(frozen=True)
class BakedLight:
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
) -> BakedLight:
    """Return the light on the upper surface (water or ground) and on the plants, and the height of the canopy.

    Maps [GY, GX] float32 in metres; bridges [B, 11] as `thalweg.world.record.BRIDGE`; angles in radians. Raises
    `ValueError` for a sun lower than 5 degrees, whose shadows would cross the whole map.
    """
    if not math.radians(5.0) <= sun_elevation <= 0.5 * math.pi + 1e-9:
        raise ValueError(f"the sun must stand 5 to 90 degrees high, not {math.degrees(sun_elevation):.1f}")
    ray = sun_ray(sun_azimuth, sun_elevation)
    surface = np.maximum(ground_m, water_m).astype(np.float32)
    frame = np.array([grid.origin_x_m, grid.origin_y_m, grid.cell_m], np.float32)
    spans = np.ascontiguousarray(bridges, dtype=np.float64).reshape(-1, 11)
    table, outline, tile = plant_table(plants), outlines(), clump_tile()

    boxes = _shadow_boxes(grid, surface, table, ray)
    depth = np.zeros(surface.shape, np.float32)
    shadows = table, boxes, *_row_bands(boxes, len(surface))
    run_in_threads(_bands(len(surface)), partial(add_plant_depth, depth, surface, frame, shadows, ray, outline, tile))
    sun = terrain_sun(surface, frame[2], ray) * np.exp(-depth)
    run_in_threads(len(sun), partial(shade_bridges, sun, surface, frame, spans, ray))

    boxes = _shadow_boxes(grid, surface, table, None)
    crowns = table, boxes, *_row_bands(boxes, len(surface))
    canopy, tall, cover = crown_roof(surface, frame, crowns, outline, roofs(), tile)
    _raise_bridges(canopy, tall, cover, grid, spans)
    return BakedLight(
        sun=_as_byte(sun),
        sky=_as_byte(_sky(surface, tall, cover, grid.cell_m)),
        canopy_m=canopy,
        plant_light=_plant_light(surface, frame, table, spans, ray, outline, tile),
    )


def relit(world: World, azimuth: float, elevation: float) -> World:
    """Return the same valley under a sun at these angles in radians, from 5 degrees above the horizon to the zenith.

    This takes about as long as the light of a new world. Raises `ValueError` for a sun outside that range.
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
    """Return [3] float32 the unit vector (east, north, up) towards a sun at these angles in radians."""
    flat = max(math.cos(elevation), 1e-4)
    return np.array([flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)], np.float32)


def _as_byte(share: np.ndarray) -> np.ndarray:
    """Convert 0..1 to uint8 0..255."""
    return np.rint(np.clip(share, 0.0, 1.0) * f4(255.0)).astype(np.uint8)


def _shadow_boxes(grid: Grid, surface: np.ndarray, table: np.ndarray, ray: np.ndarray | None) -> np.ndarray:
    """Return [M, 4] int32 the first and last row and column that each plant's shadow may touch.

    Without a ray the boxes hold the crowns alone.
    """
    rows, columns = surface.shape
    shift = np.zeros((len(table), 2))
    if ray is not None and len(table):
        # A shadow that falls on lower ground is longer by the height difference.
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
    """Return [M] float32 a lower bound of the surface around each plant, as far as its shadow can fall."""
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


def _bands(rows: int) -> int:
    """Return the number of bands of `BAND_ROWS` rows."""
    return -(-rows // BAND_ROWS)


def _row_bands(boxes: np.ndarray, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (starts, members): the plants whose box [M, 4] meets each band of rows, in ascending order."""
    first, last = boxes[:, 0] // BAND_ROWS, boxes[:, 1] // BAND_ROWS
    times = last - first + 1
    members = np.repeat(np.arange(len(boxes)), times)
    band = np.repeat(first, times) + np.arange(len(members)) - np.repeat(np.cumsum(times) - times, times)
    order = np.argsort(band, kind="stable")
    starts = np.searchsorted(band[order], np.arange(_bands(rows) + 1))
    return starts.astype(np.int32), members[order].astype(np.int32)


def crown_roof(surface, frame, crowns, outline, roof, tile) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return three maps [GY, GX] float32: the height of all crowns' tops, that of tall plants' tops, and the cover.

    The cover is the share of light from straight above that the crowns stop. crowns: the table of plants, their boxes,
    and the starts and members of each band of rows, as for `sun_shadow.add_plant_depth`.
    """
    maps = surface.copy(), surface.copy(), np.zeros(surface.shape, np.float32)
    run_in_threads(_bands(len(surface)), partial(_crown_roof_bands, maps, surface, frame, crowns, outline, roof, tile))
    return maps


@kernel(fastmath=False)
def _crown_roof_bands(maps, surface, frame, crowns, outline, roof, tile, first, last):
    canopy, tall, cover = maps
    table, boxes, starts, members = crowns
    rows, columns = surface.shape
    # Straight up, with the tilt that `sun_ray` gives a sun at the zenith.
    up = np.array([f4(1e-4), f4(0.0), f4(1.0)])
    for band in range(first, last):
        # One thread writes each band, with its plants in a fixed order: the sums do not depend on the threads.
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
                        # Low plants hide less: their weight is their height over TALL_M.
                        z = surface[i, j] - plant[Z]
                        cover[i, j] += weight * crown_depth(plant, dx, dy, z, up, outline, tile, members[member])
        # From optical depth to the stopped share (Beer-Lambert).
        for i in range(band * BAND_ROWS, min(rows, (band + 1) * BAND_ROWS)):
            for j in range(columns):
                cover[i, j] = f4(1.0) - math.exp(-cover[i, j])


def deck_heights(grid: Grid, shape: tuple[int, int], bridge: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return whether a node lies under a bridge [11], and the height of deck or parapet over it; both [GY, GX]."""
    x = grid.origin_x_m + grid.cell_m * np.arange(shape[1])[None, :]
    y = grid.origin_y_m + grid.cell_m * np.arange(shape[0])[:, None]
    cos, sin = math.cos(bridge[2]), math.sin(bridge[2])
    u = (x - bridge[0]) * cos + (y - bridge[1]) * sin
    v = (y - bridge[1]) * cos - (x - bridge[0]) * sin
    on = (np.abs(u) <= 0.5 * bridge[3]) & (np.abs(v) <= 0.5 * bridge[4])
    top = bridge[8] - bridge[9] * (2.0 * u / bridge[3]) ** 2
    return on, top + np.where(np.abs(v) > 0.5 * bridge[4] - PARAPET_THICKNESS_M, bridge[10], 0.0)


def _raise_bridges(canopy: np.ndarray, tall: np.ndarray, cover: np.ndarray, grid: Grid, bridges: np.ndarray) -> None:
    """Raise canopy and tall [GY, GX] to the tops of the bridges [B, 11] and set cover [GY, GX] to 1 under them.

    All three are changed in place.
    """
    for bridge in bridges:
        on, top = deck_heights(grid, canopy.shape, bridge)
        for tops in (canopy, tall):
            tops[on] = np.maximum(tops[on], top[on])
        cover[on] = 1.0


def _sky(surface: np.ndarray, tall: np.ndarray, cover: np.ndarray, cell_m: float) -> np.ndarray:
    """Return [GY, GX] float32 the share of the sky's light at each node, in 0..1."""
    stride = SKY_STRIDE
    cell = f4(cell_m * stride)
    solid = np.ascontiguousarray(surface[::stride, ::stride])
    leafy = np.ascontiguousarray(tall[::stride, ::stride])
    scanned = np.empty(solid.shape, np.float32)
    scan = _scan_steps(cell_m * stride), _scan_directions()
    run_in_threads(len(solid), partial(horizon_sky, scanned, solid, leafy, cell, *scan))
    roof = gaussian_filter(cover, 0.8 / cell_m)
    return _upsampled(scanned, surface.shape, stride) * (f4(1.0) - f4(COVER_SHADE) * roof)


def _scan_directions() -> np.ndarray:
    """Return [AZIMUTHS, 2] float32 unit vectors (east, north), evenly spaced.

    They are a table, because a compiler that evaluates a cosine at compile time may round it differently from a call.
    """
    angle = (np.arange(AZIMUTHS) + 0.5) * 2.0 * np.pi / AZIMUTHS
    return np.stack([np.cos(angle), np.sin(angle)], axis=1).astype(np.float32)


def _scan_steps(cell_m: float) -> np.ndarray:
    """Return [D] float32 the distances in nodes at which the horizon is sampled, growing with the distance."""
    steps = [1.0]
    while steps[-1] * cell_m < SKY_REACH_M:
        steps.append(max(steps[-1] + 1.0, steps[-1] * 1.15))
    return np.array(steps, np.float32)


@kernel(fastmath=False)
def horizon_sky(out, solid, leafy, cell, steps, compass, first, last):
    """Fill the rows first to last of out [R, C] float32 with the free share of the sky over each node of solid [R, C].

    The share is weighted by the cosine to the vertical. Under a sky of uniform radiance, a level surface receives the
    mean over azimuth of cos² of the horizon's elevation.
    What leafy [R, C] hides above the solid horizon still transmits `CROWN_GAPS`. Heights and `cell` are in metres.
    """
    rows, columns = solid.shape
    for i in range(first, last):
        for j in range(columns):
            total = f4(0.0)
            for a in range(len(compass)):
                east, north = compass[a, 0], compass[a, 1]
                # Tangents of the highest elevation angles seen so far; the horizon is never below level.
                ground = f4(0.0)
                crown = f4(0.0)
                for k in range(len(steps)):
                    x = int(f4(j) + steps[k] * east + f4(0.5))
                    y = int(f4(i) + steps[k] * north + f4(0.5))
                    if x < 0 or y < 0 or x >= columns or y >= rows:
                        break
                    ground = max(ground, (solid[y, x] - solid[i, j]) / (steps[k] * cell))
                    crown = max(crown, (leafy[y, x] - solid[i, j]) / (steps[k] * cell))
                # cos² of the elevation angle with tangent t is 1 / (1 + t²).
                open_sky = f4(1.0) / (f4(1.0) + ground * ground)
                over_crowns = f4(1.0) / (f4(1.0) + max(ground, crown) ** 2)
                total += over_crowns + f4(CROWN_GAPS) * (open_sky - over_crowns)
            out[i, j] = total / f4(AZIMUTHS)


def _upsampled(coarse: np.ndarray, shape: tuple[int, int], stride: int) -> np.ndarray:
    """Return [GY, GX] float32 a map given at every stride-th node, with linear interpolation between them."""
    for axis in (0, 1):
        at = np.minimum(np.arange(shape[axis], dtype=np.float32) / f4(stride), f4(coarse.shape[axis] - 1))
        low = np.minimum(at.astype(np.int64), coarse.shape[axis] - 1)
        high = np.minimum(low + 1, coarse.shape[axis] - 1)
        share = (at - low).astype(np.float32).reshape((-1, 1) if axis == 0 else (1, -1))
        coarse = np.take(coarse, low, axis) * (f4(1.0) - share) + np.take(coarse, high, axis) * share
    return coarse


def _plant_light(surface, frame, table, bridges, ray, outline, tile) -> np.ndarray:
    """Return [M, 2] float32 the mean share of sun about a metre above the foot of each plant and at its top.

    A plant's own shade is left out.
    """
    count = len(table)
    if count == 0:
        return np.zeros((0, 2), np.float32)
    columns = int(surface.shape[1] * frame[2] / BUCKET_M) + 1
    rows = int(surface.shape[0] * frame[2] / BUCKET_M) + 1
    bucket = np.clip((table[:, Y] - frame[1]) / BUCKET_M, 0, rows - 1).astype(np.int64) * columns
    bucket += np.clip((table[:, X] - frame[0]) / BUCKET_M, 0, columns - 1).astype(np.int64)
    members = np.argsort(bucket, kind="stable").astype(np.int32)
    starts = np.searchsorted(bucket[members], np.arange(rows * columns + 1)).astype(np.int32)
    buckets = table, starts, members, columns
    own_plant = np.repeat(np.arange(count, dtype=np.int32), len(PROBES))
    shares = []
    for height, spread in ((np.minimum(1.0, 0.5 * table[:, HEIGHT]), 0.6), (0.93 * table[:, HEIGHT], 0.25)):
        points = np.repeat(table[:, X : Z + 1], len(PROBES), axis=0)
        points[:, :2] += np.tile(PROBES, (count, 1)) * np.repeat(spread * table[:, RADIUS], len(PROBES))[:, None]
        points[:, 2] += np.repeat(height, len(PROBES))
        share = np.empty(len(points), np.float32)
        shade = partial(shade_points, share, points, own_plant, surface, frame, buckets, bridges, ray, outline, tile)
        run_in_threads(len(points), shade)
        shares.append(share.reshape(count, len(PROBES)).mean(axis=1))
    return np.stack(shares, axis=1)
