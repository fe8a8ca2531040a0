"""The colour of the ground: sand, grass, forest floor, earth and river bed, with detail at every scale down to a node.

Only reflectance: shade, wetness by waves and the colour of the water itself are the renderer's. The bands follow the
signed distance to the water's edge and the two wavy edges that plants share, so that litter lies under the trees and
nowhere else.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from thalweg.world.noise import fractal, smooth_step
from thalweg.world.record import Grid

f4 = np.float32

SAND = np.array((0.55, 0.45, 0.32), np.float32)
SAND_PINK = np.array((0.47, 0.35, 0.245), np.float32)
SAND_WET = np.array((0.28, 0.22, 0.15), np.float32)
RIM = np.array((0.80, 0.73, 0.61), np.float32)
PEBBLE = np.array((0.36, 0.33, 0.29), np.float32)
GRASS = np.array((0.225, 0.215, 0.080), np.float32)
GRASS_DRY = np.array((0.38, 0.315, 0.15), np.float32)
GRASS_LUSH = np.array((0.130, 0.155, 0.050), np.float32)
LITTER = np.array((0.105, 0.080, 0.045), np.float32)
NEEDLES = np.array((0.175, 0.115, 0.062), np.float32)
MOSS = np.array((0.062, 0.082, 0.028), np.float32)
EARTH = np.array((0.25, 0.185, 0.12), np.float32)
ROCK = np.array((0.27, 0.25, 0.22), np.float32)
BED_SAND = np.array((0.27, 0.215, 0.15), np.float32)
BED_SILT = np.array((0.125, 0.102, 0.075), np.float32)
BED_STONE = np.array((0.23, 0.21, 0.18), np.float32)
ALGAE = np.array((0.070, 0.075, 0.034), np.float32)
"""Linear reflectances of the materials, red, green, blue."""


SAND_M = (2.4, 5.8)
"""Minimum and maximum width of the band of sand along the water."""
FOREST_M = (4.8, 10.0)
"""Minimum and maximum distance of the forest's edge from the water, except where it comes down to the shore."""
SHORE_FOREST_M = 2.6
"""Distance of the forest's edge where it comes down to the shore."""
EDGE_SEED = 7919
"""Seed of the wavy edges: the same in all worlds, so that paint and plants agree without sharing state."""


def sand_edge_m(grid: Grid, shape: tuple[int, int]) -> np.ndarray:
    """Return [GY, GX] float32 the distance from the water, in metres, at which sand gives way to grass."""
    rng = np.random.default_rng(EDGE_SEED)
    wave = fractal(shape, grid.cell_m, 34.0, 3, rng, gain=0.6)
    low, high = SAND_M
    return (low + (high - low) * smooth_step(-1.6, 1.6, wave)).astype(np.float32)


def forest_edge_m(grid: Grid, shape: tuple[int, int]) -> np.ndarray:
    """Return [GY, GX] float32 the distance from the water, in metres, at which the forest begins."""
    rng = np.random.default_rng(EDGE_SEED + 1)
    wave = fractal(shape, grid.cell_m, 28.0, 3, rng, gain=0.65)
    close = smooth_step(1.05, 1.45, fractal(shape, grid.cell_m, 40.0, 2, rng, gain=0.5))
    low, high = FOREST_M
    edge = low + (high - low) * smooth_step(-1.7, 1.7, wave)
    return (edge + (SHORE_FOREST_M - edge) * close).astype(np.float32)


@dataclass(frozen=True)
class NoiseFields:
    """Noise at several scales that the bands share, each [GY, GX] float32 of unit standard deviation."""

    broad: np.ndarray
    """Longest wavelength 30 m."""
    patch: np.ndarray
    """Longest wavelength 9 m."""
    clump: np.ndarray
    """Longest wavelength 3 m."""
    grain: np.ndarray
    """Longest wavelength 1.2 m, shortest two nodes."""
    hue: np.ndarray
    """Longest wavelength 14 m: shifts the hue."""
    spot: np.ndarray
    """Longest wavelength 2.4 m: places stones and tufts."""


def paint(
    grid: Grid, ground_m: np.ndarray, water_m: np.ndarray, shore_m: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Return [GY, GX, 3] uint8 the reflectance of the ground, square-root coded: linear = (value / 255)².

    ground_m, water_m and shore_m are [GY, GX] float32 in metres; shore_m is the distance to the nearest water's edge,
    positive on land.
    """
    fields = _fields(ground_m.shape, grid.cell_m, rng)
    # Noise on the distance makes the borders of the bands ragged.
    ragged = shore_m + f4(0.55) * fields.patch + f4(0.40) * fields.clump + f4(0.16) * fields.grain
    into_grass = smooth_step(-1.2, 1.3, ragged - sand_edge_m(grid, shore_m.shape))
    into_forest = smooth_step(0.5, 5.0, ragged - forest_edge_m(grid, shore_m.shape) + f4(0.8) * fields.spot)
    colour = _sand(shore_m, fields)
    _blend_over(colour, into_grass, _grass(fields))
    _blend_over(colour, into_forest * into_grass, _litter(fields))
    _blend_over(colour, _steepness(grid, ground_m, fields), _earth(ground_m, fields))
    edge = shore_m + f4(0.05) * fields.clump
    _blend_over(colour, smooth_step(-0.10, 0.06, -edge), _bed(water_m - ground_m, fields))
    return np.rint(np.sqrt(np.clip(colour, 0.0, 1.0)) * f4(255.0)).astype(np.uint8)


def _fields(shape: tuple[int, int], cell_m: float, rng: np.random.Generator) -> NoiseFields:
    return NoiseFields(
        broad=fractal(shape, cell_m, 30.0, 3, rng, gain=0.65),
        patch=fractal(shape, cell_m, 9.0, 5, rng, gain=0.7),
        clump=fractal(shape, cell_m, 3.0, 4, rng, gain=0.75),
        grain=fractal(shape, cell_m, 1.2, 2, rng, gain=0.9),
        hue=fractal(shape, cell_m, 14.0, 5, rng, gain=0.65),
        spot=fractal(shape, cell_m, 2.4, 3, rng, gain=0.85),
    )


def _sand(shore_m: np.ndarray, fields: NoiseFields) -> np.ndarray:
    """Return [GY, GX, 3] float32: dry sand with ripples and patches of pebbles, a pale rim, and a wet edge."""
    colour = _mix(SAND, SAND_PINK, smooth_step(-1.0, 1.6, fields.hue + f4(0.35) * fields.clump))
    ripple = np.sin(shore_m * f4(2.0 * np.pi / 0.85) + f4(2.2) * fields.patch + f4(0.8) * fields.clump)
    shade = f4(0.05) * fields.broad + f4(0.08) * fields.patch + f4(0.10) * fields.clump + f4(0.10) * fields.grain
    colour *= np.exp(shade + f4(0.035) * ripple)[..., None]
    pebbly = smooth_step(0.5, 1.6, fields.patch + f4(0.5) * fields.broad)
    stones = _mix(PEBBLE, f4(0.5) * PEBBLE, smooth_step(-0.6, 1.4, fields.spot))
    _blend_over(colour, f4(0.75) * pebbly * smooth_step(-0.8, 0.7, fields.grain + f4(0.5) * fields.spot), stones)
    tufts = smooth_step(1.5, 2.2, fields.spot + f4(0.35) * fields.hue) * smooth_step(2.0, 4.0, shore_m)
    _blend_over(colour, f4(0.7) * tufts, GRASS)
    width = np.maximum(f4(0.12) + f4(0.10) * fields.clump + f4(0.06) * fields.patch, f4(0.02))
    past_wet = shore_m - width
    rim = smooth_step(-0.02, 0.10, past_wet) * smooth_step(0.0, 0.8, f4(1.0) + f4(0.4) * fields.clump - past_wet)
    broken = smooth_step(-1.2, 1.0, fields.patch + f4(0.7) * fields.grain)
    _blend_over(colour, rim * broken, RIM)
    wet = smooth_step(-0.06, 0.10, width - shore_m)
    _blend_over(colour, wet, _mix(SAND_WET, f4(1.2) * SAND_WET, smooth_step(-1.5, 1.5, fields.clump)))
    return colour


def _grass(fields: NoiseFields) -> np.ndarray:
    """Return [GY, GX, 3] float32: olive grass, dry and lush in patches, tufted, with thin spots that show sand."""
    colour = _mix(GRASS, GRASS_DRY, smooth_step(-0.5, 1.8, fields.hue + f4(0.5) * fields.clump))
    _blend_over(
        colour,
        smooth_step(0.2, 1.9, fields.patch - f4(0.4) * fields.hue),
        GRASS_LUSH,
    )
    bare = smooth_step(1.0, 1.9, fields.clump + f4(0.45) * fields.broad)
    _blend_over(colour, f4(0.7) * bare, SAND_PINK)
    shade = f4(0.09) * fields.broad + f4(0.09) * fields.clump + f4(0.13) * fields.grain + f4(0.08) * fields.spot
    colour *= np.exp(shade)[..., None]
    return colour


def _litter(fields: NoiseFields) -> np.ndarray:
    """Return [GY, GX, 3] float32: brown litter under the trees with patches of needles, moss and herbs."""
    colour = _mix(LITTER, NEEDLES, smooth_step(-0.6, 1.5, fields.patch))
    _blend_over(colour, smooth_step(0.0, 1.4, fields.hue + f4(0.6) * fields.clump), MOSS)
    _blend_over(colour, smooth_step(1.1, 1.9, fields.spot), GRASS_LUSH)
    colour *= np.exp(f4(0.14) * fields.clump + f4(0.16) * fields.grain)[..., None]
    return colour


def _earth(ground_m: np.ndarray, fields: NoiseFields) -> np.ndarray:
    """Return [GY, GX, 3] float32: bare earth and rock of steep slopes, in wavy layers of height."""
    layers = np.sin(ground_m * f4(2.0 * np.pi / 0.7) + f4(1.5) * fields.clump)
    colour = _mix(EARTH, ROCK, smooth_step(-0.6, 0.9, layers + f4(0.7) * fields.spot))
    colour *= np.exp(f4(0.12) * fields.clump + f4(0.14) * fields.grain)[..., None]
    return colour


def _steepness(grid: Grid, ground_m: np.ndarray, fields: NoiseFields) -> np.ndarray:
    """Return [GY, GX] float32 in 0..1, the share of the surface that is too steep for sand and grass.

    It rises from 32 to 45 degrees.
    """
    down, right = np.gradient(scipy.ndimage.gaussian_filter(ground_m, 1.0), f4(grid.cell_m))
    slope = np.hypot(down, right) + f4(0.06) * fields.clump
    return smooth_step(0.62, 1.0, slope.astype(np.float32))


def _bed(depth_m: np.ndarray, fields: NoiseFields) -> np.ndarray:
    """Return [GY, GX, 3] float32: sand near the edge, silt with depth, stones, and dark patches of algae."""
    deep = smooth_step(-0.05, 0.50, depth_m + f4(0.10) * fields.patch + f4(0.10) * fields.clump)
    colour = _mix(BED_SAND, BED_SILT, deep)
    stones = _mix(BED_STONE, f4(0.5) * BED_STONE, smooth_step(-0.8, 1.0, fields.grain + fields.hue))
    _blend_over(colour, f4(0.8) * smooth_step(0.5, 1.3, fields.spot + f4(0.4) * fields.patch), stones)
    algae = smooth_step(0.15, 1.3, fields.patch + f4(0.55) * fields.clump - f4(0.3) * fields.hue)
    _blend_over(colour, f4(0.8) * algae * smooth_step(0.02, 0.20, depth_m), ALGAE)
    shade = f4(0.10) * fields.broad + f4(0.16) * fields.clump + f4(0.17) * fields.grain
    colour *= np.exp(shade - f4(0.22) * np.clip(depth_m, 0.0, 3.0))[..., None]
    return colour


def _mix(one: np.ndarray, other: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return [GY, GX, 3] float32: colour `one` [3] where share [GY, GX] is 0, `other` [3] where it is 1."""
    return one + share[..., None] * (other - one)


def _blend_over(colour: np.ndarray, share: np.ndarray, over: np.ndarray) -> None:
    """Blend a layer, [GY, GX, 3] or one colour [3], over colour [GY, GX, 3] in place; share [GY, GX] is its opacity."""
    colour += share[..., None] * (over - colour)
