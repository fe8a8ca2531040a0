"""The paint of banks that are not forest: lush grass and flowers, mud and rushes, the wall and the pavement of a quay.

It is laid over the valley's own, whose noise at the finest scales it shares. Reflectances are linear.
"""

from dataclasses import dataclass

import numpy as np

from thalweg.world.banks import QUAY_COPING_M, QUAY_PAVED_M, quay_run_m
from thalweg.world.generate.banks.zones import Zones
from thalweg.world.generate.terrain import Terrain
from thalweg.world.noise import fractal, smooth_step

f4 = np.float32

TURF = np.array((0.128, 0.150, 0.050), np.float32)
TURF_LUSH = np.array((0.085, 0.125, 0.033), np.float32)
TURF_DRY = np.array((0.235, 0.220, 0.098), np.float32)
TURF_SEED = np.array((0.215, 0.175, 0.105), np.float32)
BUTTERCUP = np.array((0.52, 0.43, 0.03), np.float32)
DAISY = np.array((0.50, 0.50, 0.44), np.float32)
CLOVER = np.array((0.27, 0.13, 0.17), np.float32)
SOIL = np.array((0.095, 0.070, 0.042), np.float32)
MUD = np.array((0.070, 0.058, 0.040), np.float32)
SEDGE = np.array((0.120, 0.130, 0.045), np.float32)
STRAW = np.array((0.24, 0.20, 0.11), np.float32)
SILT = np.array((0.085, 0.074, 0.052), np.float32)
WALL = np.array((0.225, 0.21, 0.18), np.float32)
WALL_DARK = np.array((0.12, 0.112, 0.096), np.float32)
WALL_RUST = np.array((0.19, 0.15, 0.105), np.float32)
SLIME = np.array((0.078, 0.075, 0.055), np.float32)
COPING = np.array((0.34, 0.325, 0.295), np.float32)
PAVING = np.array((0.245, 0.235, 0.215), np.float32)
PAVING_WARM = np.array((0.27, 0.24, 0.20), np.float32)
JOINT = np.array((0.11, 0.105, 0.085), np.float32)
CURB = np.array((0.32, 0.31, 0.285), np.float32)
LAWN = np.array((0.108, 0.130, 0.042), np.float32)
"""Linear reflectances of the materials, red, green, blue."""

TURF_M = 30.0
"""Distance from the water to which a meadow reaches; its border is as wavy as the forest's edge."""
PAVED_M = 0.8 + QUAY_PAVED_M
"""Distance from the water to the curb, at which the pavement ends."""
LAWN_M = 13.0
"""Distance to which the lawn behind it reaches."""
BAND_ROWS = 256
"""Rows of the map that are painted at a time."""
SLAB_M = (1.1, 0.75)
"""Length and width of the slabs of the pavement."""


@dataclass(frozen=True)
class Grain:
    """Noise of unit standard deviation [GY, GX] float32 at several scales."""

    broad: np.ndarray
    """Longest wavelength 18 m."""
    patch: np.ndarray
    """Longest wavelength 5 m."""
    clump: np.ndarray
    """Longest wavelength 1.6 m."""
    speck: np.ndarray
    """Wavelength of two nodes and a little more."""

    def rows(self, rows: slice) -> "Grain":
        """Return some rows of all maps, without a copy."""
        return Grain(self.broad[rows], self.patch[rows], self.clump[rows], self.speck[rows])


def grain_of(shape: tuple[int, int], cell_m: float, rng: np.random.Generator) -> Grain:
    """Return the noise that the paint of all banks shares."""
    return Grain(
        broad=fractal(shape, cell_m, 18.0, 3, rng, gain=0.6),
        patch=fractal(shape, cell_m, 5.0, 3, rng, gain=0.65),
        clump=fractal(shape, cell_m, 1.6, 2, rng, gain=0.8),
        speck=fractal(shape, cell_m, max(0.7, 2.0 * cell_m), 1, rng),
    )


def painted(albedo: np.ndarray, terrain: Terrain, zones: Zones, rng: np.random.Generator) -> np.ndarray:
    """Return the reflectance [GY, GX, 3] uint8 of the ground with that of its banks, coded as in `World.albedo`."""
    grain = grain_of(zones.bank_m.shape, terrain.grid.cell_m, rng)
    out = albedo.copy()
    # By bands of rows, because layers of colours take many times the memory of the maps.
    for first in range(0, len(out), BAND_ROWS):
        rows = slice(first, first + BAND_ROWS)
        out[rows] = _painted_rows(albedo[rows], zones.rows(rows), grain.rows(rows), terrain.grid.cell_m)
    return out


def _painted_rows(albedo: np.ndarray, zones: Zones, grain: Grain, cell_m: float) -> np.ndarray:
    """As `painted`, for some rows of the maps."""
    colour = np.square(albedo.astype(np.float32) / f4(255))
    # Islands keep their sand.
    land = np.where(zones.island_m > 0, f4(1), f4(0))
    for kind, share in zones.share.items():
        # The border between two kinds is ragged; where a kind has no share, nothing changes.
        ragged = smooth_step(0.25, 0.75, share + f4(0.12) * np.clip(grain.clump, f4(-2), f4(2)))
        PAINT[kind](colour, (share if kind == "quay" else ragged) * land, zones, grain, cell_m)
    return np.rint(np.sqrt(np.clip(colour, 0.0, 1.0)) * f4(255.0)).astype(np.uint8)


def _paint_meadow(colour: np.ndarray, share: np.ndarray, zones: Zones, grain: Grain, cell_m: float) -> None:
    d = zones.bank_m
    turf = _mix(TURF, TURF_LUSH, smooth_step(-0.6, 1.4, grain.patch - f4(0.4) * grain.broad))
    _blend(turf, f4(0.75) * smooth_step(0.5, 2.2, grain.broad + f4(0.35) * grain.clump), TURF_DRY)
    _blend(turf, f4(0.5) * smooth_step(0.7, 1.7, grain.patch + f4(0.5) * grain.broad), TURF_SEED)
    # Flowers stand in patches; each is smaller than a node, so that they only tint it.
    bloom = smooth_step(0.2, 1.2, grain.broad - f4(0.5) * grain.patch)
    _blend(turf, f4(0.30) * bloom * smooth_step(0.9, 1.9, grain.speck + f4(0.3) * grain.clump), BUTTERCUP)
    white = smooth_step(0.3, 1.3, f4(-0.8) * grain.broad - f4(0.5) * grain.patch)
    _blend(turf, f4(0.30) * white * smooth_step(0.9, 1.9, grain.speck + f4(0.4) * grain.clump), DAISY)
    _blend(turf, f4(0.35) * smooth_step(0.9, 1.9, f4(-1.0) * grain.patch) * smooth_step(0.2, 1.2, grain.clump), CLOVER)
    turf *= np.exp(f4(0.10) * grain.patch + f4(0.15) * grain.clump + f4(0.12) * grain.speck)[..., None]
    # Dark soil shows at the lip, taller and greener plants stand behind it.
    _blend(turf, f4(0.7) * (f4(1) - smooth_step(0.4, 1.6, d + f4(0.3) * grain.clump)), TURF_LUSH)
    soil = f4(1) - smooth_step(0.10, 0.42, d + f4(0.10) * grain.clump + f4(0.05) * grain.speck)
    _blend(turf, f4(0.85) * soil, SOIL)
    inside = f4(1) - smooth_step(-2.5, 2.5, d - f4(TURF_M) + f4(2.0) * grain.broad + f4(0.8) * grain.patch)
    _blend(colour, share * inside * smooth_step(-0.10, 0.02, d), turf)
    _paint_bed(colour, share, zones, SILT)


def _paint_reeds(colour: np.ndarray, share: np.ndarray, zones: Zones, grain: Grain, cell_m: float) -> None:
    d = zones.bank_m
    marsh = _mix(SEDGE, MUD, smooth_step(-0.8, 1.0, grain.clump + f4(0.5) * grain.patch))
    _blend(marsh, f4(0.6) * smooth_step(0.3, 1.5, grain.speck + f4(0.5) * grain.clump), STRAW)
    marsh *= np.exp(f4(0.12) * grain.patch + f4(0.16) * grain.clump + f4(0.12) * grain.speck)[..., None]
    turf = _mix(TURF, TURF_LUSH, smooth_step(-0.8, 1.0, grain.patch))
    turf *= np.exp(f4(0.10) * grain.patch + f4(0.16) * grain.clump)[..., None]
    _blend(marsh, smooth_step(2.0, 4.5, d + f4(0.5) * grain.patch), turf)
    inside = f4(1) - smooth_step(-1.5, 2.0, d - f4(7.0) + f4(1.2) * grain.patch)
    _blend(colour, share * inside * smooth_step(-0.10, 0.02, d), marsh)
    _paint_bed(colour, share, zones, MUD)


def _paint_quay(colour: np.ndarray, share: np.ndarray, zones: Zones, grain: Grain, cell_m: float) -> None:
    d, s = zones.bank_m, zones.arc_m
    run = quay_run_m(cell_m)
    lawn = LAWN * np.exp(f4(0.07) * grain.patch + f4(0.10) * grain.clump + f4(0.08) * grain.speck)[..., None]
    _blend(lawn, f4(0.25) * smooth_step(0.6, 1.8, grain.broad), TURF_DRY)
    inside = f4(1) - smooth_step(-2.0, 2.0, d - f4(LAWN_M) + f4(0.9) * grain.broad)
    _blend(colour, share * inside * _past(d, PAVED_M, cell_m), lawn)

    paving = _slabs(s, d - f4(run + QUAY_COPING_M), grain, cell_m)
    _blend(paving, _past(d, PAVED_M - 0.3, cell_m), CURB)
    stone = (
        COPING * np.exp(f4(0.05) * grain.clump + f4(0.05) * grain.speck + f4(0.10) * _block_tone(s, 1.4, 7))[..., None]
    )
    _blend(stone, f4(0.40) * _joint(s, 1.4, cell_m), JOINT)
    _blend(paving, f4(1) - _past(d, run + QUAY_COPING_M, cell_m), stone)
    _blend(paving, f4(1) - _past(d, run, cell_m), _wall(s, d, run, grain, cell_m))
    on = (f4(1) - _past(d, PAVED_M, cell_m)) * smooth_step(-1.2, -0.7, d)
    _blend(colour, share * on, paving)


def _wall(s: np.ndarray, d: np.ndarray, run: float, grain: Grain, cell_m: float) -> np.ndarray:
    """Return the reflectance [GY, GX, 3] of the wall: blocks seen from above are streaks, darker towards the water."""
    course = np.floor(d / f4(0.5 * run))
    place = s + f4(0.9) * np.mod(course, 2)
    wall = _mix(WALL, WALL_DARK, smooth_step(-0.6, 1.6, _streaks(s, 1.6, 1) + f4(0.5) * grain.clump))
    _blend(wall, f4(0.35) * smooth_step(0.8, 1.8, _streaks(s, 2.3, 2)), WALL_RUST)
    wall *= np.exp(f4(0.13) * _block_tone(place, 1.8, 3))[..., None]
    _blend(wall, f4(0.40) * _joint(place, 1.8, cell_m), f4(0.5) * WALL_DARK)
    toe = SLIME * np.exp(f4(0.15) * grain.clump + f4(0.10) * grain.speck)[..., None]
    _blend(wall, f4(0.95) * (f4(1) - smooth_step(0.15, 0.55, d)), toe)
    return wall


def _slabs(s: np.ndarray, d: np.ndarray, grain: Grain, cell_m: float) -> np.ndarray:
    """Return the reflectance [GY, GX, 3] of slabs in courses along the quay, each of its own tone."""
    length, width = SLAB_M
    course = np.floor(d / f4(width))
    along = s / f4(length) + f4(0.5) * np.mod(course, 2)
    slab = np.floor(along)
    tone = hashed(slab, course)
    colour = _mix(PAVING, PAVING_WARM, hashed(course, slab))
    colour *= np.exp(f4(0.22) * (tone - f4(0.5)) + f4(0.06) * grain.patch + f4(0.05) * grain.clump)[..., None]
    gap = np.minimum(_to_joint(along, length), _to_joint(d / f4(width), width))
    _blend(colour, f4(0.30) * (f4(1) - smooth_step(0.0, 0.6 * cell_m, gap)), JOINT)
    _blend(colour, f4(0.25) * smooth_step(1.0, 2.0, grain.patch), JOINT)
    return colour


def _paint_bed(colour: np.ndarray, share: np.ndarray, zones: Zones, bed: np.ndarray) -> None:
    """Darken the pale bed beside a bank that has no sand."""
    near = (f4(1) - smooth_step(-0.04, 0.06, zones.bank_m)) * smooth_step(-2.5, -0.6, zones.bank_m)
    _blend(colour, f4(0.75) * share * near, bed)


def _past(d: np.ndarray, edge_m: float, cell_m: float) -> np.ndarray:
    """Return the share of each node's cell that lies past a distance from the water."""
    return np.clip((d - f4(edge_m)) / f4(cell_m) + f4(0.5), f4(0), f4(1))


def _streaks(s: np.ndarray, wavelength_m: float, seed: int) -> np.ndarray:
    """Return noise of about unit deviation along the course, the same across it."""
    table = np.random.default_rng(seed).standard_normal(4096).astype(np.float32)
    place = s / f4(0.5 * wavelength_m)
    low = np.floor(place)
    share = place - low
    share = share * share * (f4(3) - f4(2) * share)
    index = low.astype(np.int64)
    return table[index % 4096] * (f4(1) - share) + table[(index + 1) % 4096] * share


def _block_tone(s: np.ndarray, length_m: float, seed: int) -> np.ndarray:
    """Return a random number of unit deviation for each block along the course."""
    table = np.random.default_rng(seed).standard_normal(4096).astype(np.float32)
    return table[np.floor(s / f4(length_m)).astype(np.int64) % 4096]


def hashed(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return a number in 0..1 for each pair of whole numbers."""
    table = np.random.default_rng(11).random(4096).astype(np.float32)
    return table[(one.astype(np.int64) * 1619 + other.astype(np.int64) * 31337) % 4096]


def _to_joint(place: np.ndarray, length_m: float) -> np.ndarray:
    """Return the distance in metres to the nearest whole number of lengths."""
    return np.abs(place - np.rint(place)) * f4(length_m)


def _joint(s: np.ndarray, length_m: float, cell_m: float) -> np.ndarray:
    """Return 1 on the joints of blocks along the course, as wide as a node."""
    return f4(1) - smooth_step(0.25 * cell_m, 0.75 * cell_m, _to_joint(s / f4(length_m), length_m))


def _mix(one: np.ndarray, other: np.ndarray, share: np.ndarray) -> np.ndarray:
    return one + share[..., None] * (other - one)


def _blend(colour: np.ndarray, share: np.ndarray, over: np.ndarray) -> None:
    """Blend a layer, [GY, GX, 3] or one colour [3], over colour [GY, GX, 3] in place; share [GY, GX] is its opacity."""
    colour += share[..., None] * (over - colour)


PAINT = {"meadow": _paint_meadow, "reeds": _paint_reeds, "quay": _paint_quay}
