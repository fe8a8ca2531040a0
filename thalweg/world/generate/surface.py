"""What colour is the ground? Sand, grass, forest floor, earth and river bed, with detail at every scale down to a
node.

Reflectance only: shade, wetness by waves and the colour of the water itself are the renderer's. The bands follow
the signed distance to the water's edge and the same wavy edges as the plants (`thalweg.world.generate.zones`).
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from thalweg.world.generate.zones import forest_edge_m, sand_edge_m
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


@dataclass(frozen=True)
class Fields:
    """Noise at several scales that the bands share, each [GY, GX] float32 of unit deviation; the name tells the
    scale."""

    broad: np.ndarray
    """From 30 m down."""
    patch: np.ndarray
    """From 9 m down."""
    clump: np.ndarray
    """From 3 m down."""
    grain: np.ndarray
    """From 1.2 m down to two nodes."""
    hue: np.ndarray
    """From 14 m down, independent of the others: what leans the colour to one side."""
    spot: np.ndarray
    """From 2.4 m down, independent of the others: stones and tufts."""


def paint(
    grid: Grid, ground_m: np.ndarray, water_m: np.ndarray, shore_m: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """[GY, GX, 3] uint8 reflectance of the ground, square-root coded: linear = (value / 255)².

    ground_m, water_m and shore_m are [GY, GX] float32 in metres; shore_m is the distance to the nearest water's
    edge, positive on land.
    """
    fields = _fields(ground_m.shape, grid.cell_m, rng)
    ragged = shore_m + f4(0.55) * fields.patch + f4(0.40) * fields.clump + f4(0.16) * fields.grain
    into_grass = smooth_step(-1.2, 1.3, ragged - sand_edge_m(grid, shore_m.shape))
    into_forest = smooth_step(0.5, 5.0, ragged - forest_edge_m(grid, shore_m.shape) + f4(0.8) * fields.spot)
    colour = _sand(shore_m, fields)
    _lay(colour, into_grass, _grass(fields))
    _lay(colour, into_forest * into_grass, _litter(fields))
    _lay(colour, _steepness(grid, ground_m, fields), _earth(ground_m, fields))
    edge = shore_m + f4(0.05) * fields.clump
    _lay(colour, smooth_step(-0.10, 0.06, -edge), _bed(water_m - ground_m, fields))
    return np.rint(np.sqrt(np.clip(colour, 0.0, 1.0)) * f4(255.0)).astype(np.uint8)


def _fields(shape: tuple[int, int], cell_m: float, rng: np.random.Generator) -> Fields:
    return Fields(
        broad=fractal(shape, cell_m, 30.0, 3, rng, gain=0.65),
        patch=fractal(shape, cell_m, 9.0, 5, rng, gain=0.7),
        clump=fractal(shape, cell_m, 3.0, 4, rng, gain=0.75),
        grain=fractal(shape, cell_m, 1.2, 2, rng, gain=0.9),
        hue=fractal(shape, cell_m, 14.0, 5, rng, gain=0.65),
        spot=fractal(shape, cell_m, 2.4, 3, rng, gain=0.85),
    )


def _sand(shore_m: np.ndarray, fields: Fields) -> np.ndarray:
    """[GY, GX, 3] float32: dry sand with ripples and patches of pebbles, a pale rim, and a wet edge."""
    colour = _mix(SAND, SAND_PINK, smooth_step(-1.0, 1.6, fields.hue + f4(0.35) * fields.clump))
    ripple = np.sin(shore_m * f4(2.0 * np.pi / 0.85) + f4(2.2) * fields.patch + f4(0.8) * fields.clump)
    shade = f4(0.05) * fields.broad + f4(0.08) * fields.patch + f4(0.10) * fields.clump + f4(0.10) * fields.grain
    colour *= np.exp(shade + f4(0.035) * ripple)[..., None]
    pebbly = smooth_step(0.5, 1.6, fields.patch + f4(0.5) * fields.broad)
    stones = _mix(PEBBLE, f4(0.5) * PEBBLE, smooth_step(-0.6, 1.4, fields.spot))
    _lay(colour, f4(0.75) * pebbly * smooth_step(-0.8, 0.7, fields.grain + f4(0.5) * fields.spot), stones)
    tufts = smooth_step(1.5, 2.2, fields.spot + f4(0.35) * fields.hue) * smooth_step(2.0, 4.0, shore_m)
    _lay(colour, f4(0.7) * tufts, GRASS)
    width = np.maximum(f4(0.12) + f4(0.10) * fields.clump + f4(0.06) * fields.patch, f4(0.02))
    beyond = shore_m - width
    rim = smooth_step(-0.02, 0.10, beyond) * smooth_step(0.0, 0.8, f4(1.0) + f4(0.4) * fields.clump - beyond)
    broken = smooth_step(-1.2, 1.0, fields.patch + f4(0.7) * fields.grain)
    _lay(colour, rim * broken, RIM)
    wet = smooth_step(-0.06, 0.10, width - shore_m)
    _lay(colour, wet, _mix(SAND_WET, f4(1.2) * SAND_WET, smooth_step(-1.5, 1.5, fields.clump)))
    return colour


def _grass(fields: Fields) -> np.ndarray:
    """[GY, GX, 3] float32: olive grass, dry and lush by patches, tufted, thin enough here and there to show sand."""
    colour = _mix(GRASS, GRASS_DRY, smooth_step(-0.5, 1.8, fields.hue + f4(0.5) * fields.clump))
    _lay(
        colour,
        smooth_step(0.2, 1.9, fields.patch - f4(0.4) * fields.hue),
        GRASS_LUSH,
    )
    bare = smooth_step(1.0, 1.9, fields.clump + f4(0.45) * fields.broad)
    _lay(colour, f4(0.7) * bare, SAND_PINK)
    shade = f4(0.09) * fields.broad + f4(0.09) * fields.clump + f4(0.13) * fields.grain + f4(0.08) * fields.spot
    colour *= np.exp(shade)[..., None]
    return colour


def _litter(fields: Fields) -> np.ndarray:
    """[GY, GX, 3] float32: brown litter under the trees with patches of needles, moss and herbs."""
    colour = _mix(LITTER, NEEDLES, smooth_step(-0.6, 1.5, fields.patch))
    _lay(colour, smooth_step(0.0, 1.4, fields.hue + f4(0.6) * fields.clump), MOSS)
    _lay(colour, smooth_step(1.1, 1.9, fields.spot), GRASS_LUSH)
    colour *= np.exp(f4(0.14) * fields.clump + f4(0.16) * fields.grain)[..., None]
    return colour


def _earth(ground_m: np.ndarray, fields: Fields) -> np.ndarray:
    """[GY, GX, 3] float32: bare earth and rock of steep slopes, in wavy layers of height."""
    layers = np.sin(ground_m * f4(2.0 * np.pi / 0.7) + f4(1.5) * fields.clump)
    colour = _mix(EARTH, ROCK, smooth_step(-0.6, 0.9, layers + f4(0.7) * fields.spot))
    colour *= np.exp(f4(0.12) * fields.clump + f4(0.14) * fields.grain)[..., None]
    return colour


def _steepness(grid: Grid, ground_m: np.ndarray, fields: Fields) -> np.ndarray:
    """[GY, GX] float32 in 0..1: how much of the surface is too steep for sand and grass to hold, from 32 to 45
    degrees."""
    down, right = np.gradient(gaussian_filter(ground_m, 1.0), f4(grid.cell_m))
    slope = np.hypot(down, right) + f4(0.06) * fields.clump
    return smooth_step(0.62, 1.0, slope.astype(np.float32))


def _bed(depth_m: np.ndarray, fields: Fields) -> np.ndarray:
    """[GY, GX, 3] float32: sand near the edge, silt with depth, stones, and dark patches of algae."""
    deep = smooth_step(-0.05, 0.50, depth_m + f4(0.10) * fields.patch + f4(0.10) * fields.clump)
    colour = _mix(BED_SAND, BED_SILT, deep)
    stones = _mix(BED_STONE, f4(0.5) * BED_STONE, smooth_step(-0.8, 1.0, fields.grain + fields.hue))
    _lay(colour, f4(0.8) * smooth_step(0.5, 1.3, fields.spot + f4(0.4) * fields.patch), stones)
    algae = smooth_step(0.15, 1.3, fields.patch + f4(0.55) * fields.clump - f4(0.3) * fields.hue)
    _lay(colour, f4(0.8) * algae * smooth_step(0.02, 0.20, depth_m), ALGAE)
    shade = f4(0.10) * fields.broad + f4(0.16) * fields.clump + f4(0.17) * fields.grain
    colour *= np.exp(shade - f4(0.22) * np.clip(depth_m, 0.0, 3.0))[..., None]
    return colour


def _mix(one: np.ndarray, other: np.ndarray, share: np.ndarray) -> np.ndarray:
    """[GY, GX, 3] float32: colour `one` [3] where share [GY, GX] is 0, `other` [3] where it is 1."""
    return one + share[..., None] * (other - one)


def _lay(colour: np.ndarray, share: np.ndarray, over: np.ndarray) -> None:
    """Lay a layer over, [GY, GX, 3] or one colour [3], on colour [GY, GX, 3], in place, with its share [GY, GX]."""
    colour += share[..., None] * (over - colour)
