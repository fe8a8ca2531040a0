"""The baked light of a valley: the share of sun and sky that reaches each node and plant, for a fixed sun.

Sun: `thalweg.world.light.sun_shadow`. Sky: `thalweg.world.light.sky_share`. Light that plants and ground reflect at
each other is left to the renderer's ambient term.
"""

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy

from thalweg.core.compute.threads import run_in_threads
from thalweg.world.light.canopy import crown_roof, raise_bridges
from thalweg.world.light.crowns import HEIGHT, RADIUS, X, Y, Z, clump_tile, outlines, plant_table, roofs
from thalweg.world.light.sky_share import sky_share
from thalweg.world.light.sun_shadow import (
    BAND_ROWS,
    BUCKET_M,
    BULGE,
    add_plant_depth,
    band_count,
    shade_bridges,
    shade_points,
    terrain_sun,
)
from thalweg.world.record import Grid, Plants, World

f4 = np.float32

PROBES = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)], np.float32)
"""Offsets from a plant's axis at which its light is sampled, as shares of a radius."""


@dataclass(frozen=True)
class BakedLight:
    """The light of a valley; see the fields of the same names of `World`, and `Plants.light`."""

    sun: np.ndarray
    """[GY, GX] uint8."""
    plant_light: np.ndarray
    """[M, 2] float32."""
    sky: np.ndarray
    """[GY, GX] uint8."""
    canopy_m: np.ndarray
    """[GY, GX] float32."""


@dataclass(frozen=True)
class _Valley:
    """What light falls on, as the kernels take it."""

    grid: Grid
    surface: np.ndarray
    """[GY, GX] float32, metres: the upper surface, water or ground."""
    frame: np.ndarray
    """[3] float32, metres: origin x, origin y and cell of the grid."""
    spans: np.ndarray
    """[B, 11] float64, as in the record: the march through a bridge's stone is computed in double precision."""
    table: np.ndarray
    """`plant_table` of the plants."""

    @classmethod
    def of(
        cls, grid: Grid, ground_m: np.ndarray, water_m: np.ndarray, plants: Plants, bridges: np.ndarray
    ) -> "_Valley":
        return cls(
            grid,
            np.maximum(ground_m, water_m).astype(np.float32),
            np.array([grid.origin_x_m, grid.origin_y_m, grid.cell_m], np.float32),
            np.ascontiguousarray(bridges, dtype=np.float64).reshape(-1, 11),
            plant_table(plants),
        )


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
    valley = _Valley.of(grid, ground_m, water_m, plants, bridges)
    return BakedLight(*_sunlight(valley, sun_azimuth, sun_elevation), *_canopy_and_sky(valley))


def relit(world: World, azimuth: float, elevation: float) -> World:
    """Return the same valley under a sun at these angles in radians, from 5 degrees above the horizon to the zenith.

    Its canopy and the light of its sky stay. Raises `ValueError` for a sun outside that range.
    """
    valley = _Valley.of(world.grid, world.ground_m, world.water_m, world.plants, world.bridges)
    sun, plant_light = _sunlight(valley, azimuth, elevation)
    return replace(
        world,
        sun=sun,
        plants=replace(world.plants, light=plant_light),
        sun_azimuth=float(azimuth),
        sun_elevation=float(elevation),
    )


def _sunlight(valley: _Valley, azimuth: float, elevation: float) -> tuple[np.ndarray, np.ndarray]:
    """Return what of `BakedLight` depends on the sun: `sun` and `plant_light`; raises `ValueError` as `bake` does."""
    if not math.radians(5.0) <= elevation <= 0.5 * math.pi + 1e-9:
        raise ValueError(f"the sun must stand 5 to 90 degrees high, not {math.degrees(elevation):.1f}")
    ray = sun_ray(azimuth, elevation)
    grid, surface, frame, spans, table = valley.grid, valley.surface, valley.frame, valley.spans, valley.table
    outline, tile = outlines(), clump_tile()
    boxes = _shadow_boxes(grid, surface, table, ray)
    depth = np.zeros(surface.shape, np.float32)
    shadows = table, boxes, *_row_bands(boxes, len(surface))
    run_in_threads(
        band_count(len(surface)), partial(add_plant_depth, depth, surface, frame, shadows, ray, outline, tile)
    )
    sun = terrain_sun(surface, frame[2], ray) * np.exp(-depth)
    run_in_threads(len(sun), partial(shade_bridges, sun, surface, frame, spans, ray))
    return _as_byte(sun), _plant_light(surface, frame, table, spans, ray, outline, tile)


def _canopy_and_sky(valley: _Valley) -> tuple[np.ndarray, np.ndarray]:
    """Return what of `BakedLight` is the same under any sun: `sky` and `canopy_m`."""
    grid, surface, table = valley.grid, valley.surface, valley.table
    # The boxes of the crowns alone, without their shadows.
    boxes = _shadow_boxes(grid, surface, table, None)
    crowns = table, boxes, *_row_bands(boxes, len(surface))
    canopy, tall, cover = crown_roof(surface, valley.frame, crowns, outlines(), roofs(), clump_tile())
    raise_bridges(canopy, tall, cover, grid, valley.spans)
    return _as_byte(sky_share(surface, tall, cover, grid.cell_m)), canopy


def sun_ray(azimuth: float, elevation: float) -> np.ndarray:
    """Return [3] float32 the unit vector (east, north, up) towards a sun at these angles in radians."""
    # A sun in the zenith keeps a trace of direction, because kernels divide by the horizontal part.
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
    # Clumps of leaves reach beyond the outline of the crown.
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
    # One block more on each side: a plant may stand at the edge of its block.
    span = 2 * math.ceil(reach / (block * grid.cell_m)) + 3
    low = scipy.ndimage.minimum_filter(coarse, size=span, mode="nearest")
    row = np.clip((table[:, Y] - grid.origin_y_m) / grid.cell_m / block, 0, len(coarse) - 1).astype(int)
    column = np.clip((table[:, X] - grid.origin_x_m) / grid.cell_m / block, 0, coarse.shape[1] - 1).astype(int)
    return low[row, column]


def _row_bands(boxes: np.ndarray, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (starts, members): the plants whose box [M, 4] meets each band of rows, in ascending order."""
    first, last = boxes[:, 0] // BAND_ROWS, boxes[:, 1] // BAND_ROWS
    times = last - first + 1
    members = np.repeat(np.arange(len(boxes)), times)
    band = np.repeat(first, times) + np.arange(len(members)) - np.repeat(np.cumsum(times) - times, times)
    # Stable, so that each band keeps its plants in ascending order and sums do not depend on the sort.
    order = np.argsort(band, kind="stable")
    starts = np.searchsorted(band[order], np.arange(band_count(rows) + 1))
    return starts.astype(np.int32), members[order].astype(np.int32)


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
    # Each probe leaves out the plant that it belongs to.
    own_plant = np.repeat(np.arange(count, dtype=np.int32), len(PROBES))
    shares = []
    for height, spread in ((np.minimum(1.0, 0.5 * table[:, HEIGHT]), 0.6), (0.93 * table[:, HEIGHT], 0.25)):
        points = np.repeat(table[:, X : Z + 1], len(PROBES), axis=0)
        points[:, :2] += np.tile(PROBES, (count, 1)) * np.repeat(spread * table[:, RADIUS], len(PROBES))[:, None]
        points[:, 2] += np.repeat(height, len(PROBES))
        # Points a little off the axis stand for the whole crown, so that one fleck of light does not decide.
        share = np.empty(len(points), np.float32)
        shade = partial(shade_points, share, points, own_plant, surface, frame, buckets, bridges, ray, outline, tile)
        run_in_threads(len(points), shade)
        shares.append(share.reshape(count, len(PROBES)).mean(axis=1))
    return np.stack(shares, axis=1)
