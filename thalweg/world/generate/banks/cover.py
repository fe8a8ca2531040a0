"""The plants of banks that are not forest: what is taken from the valley's own, and what is added.

Meadows have tall grass along the water, tufts, and few trees; reeds stand in a belt in the shallows and on the wet
bank; a quay has a row of trees behind its pavement.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from thalweg.world.generate import plants as scattered
from thalweg.world.generate.banks.surface import LAWN_M, PAVED_M, TURF_M
from thalweg.world.generate.banks.zones import Zones
from thalweg.world.generate.plants import Site
from thalweg.world.generate.terrain import Terrain
from thalweg.world.noise import fractal, smooth_step
from thalweg.world.record import Plants
from thalweg.world.species import KINDS

f4 = np.float32

SPECIES = np.array([kind.species for kind in KINDS])
GROUP = np.array([kind.group for kind in KINDS])

BELT_M = (0.75, 2.3)
"""Distances from the water's edge to which the belt of reeds reaches, into the water and onto the land."""
BELT_SHARE = 0.12
"""Greatest share of the river's width that the belt takes from either side."""
BELT_DEPTH_M = 0.55
"""Maximum depth of water in which reeds stand."""
REED_SPACING_M, TUFT_SPACING_M = 0.42, 0.40
"""Minimum distance of two reeds of the belt, and of two tufts of grass along the water, at a density of 1."""
REED_WIDTH = 0.62
"""Width of a reed of the belt over that of a single one, which has room."""
REED_GREEN, REED_DRY = np.array([0.74, 0.86, 0.95]), np.array([1.00, 0.92, 1.15])
"""Factors on the colour of reeds, of fresh ones and of last year's."""
GRASS_LUSH, GRASS_TUFT = np.array([0.80, 1.0, 0.72]), np.array([1.05, 1.0, 0.70])
"""Factors on the colour of grass along the water and on the meadow."""
ROW_M = 8.0
"""Distance between the trees of the row behind a quay."""
ROW_AT_M = PAVED_M + 1.6
"""Its distance from the water."""
CLEARED_WATER_M = 3.0
"""Distance into the water from which the valley's reeds and rocks stay."""


@dataclass(frozen=True)
class Planting:
    """What the makers of a kind of bank need."""

    site: Site
    zones: Zones
    share: np.ndarray
    """[GY, GX] float32, how far a node belongs to a bank of the kind."""
    close: float
    """Factor on all distances, by the level's density."""
    rng: np.random.Generator

    def noise(self, wavelength_m: float, octaves: int) -> np.ndarray:
        """Return [GY, GX] float32 noise of unit deviation."""
        return fractal(self.share.shape, self.site.grid.cell_m, wavelength_m, octaves, self.rng, gain=0.6)

    def places(self, where: np.ndarray, spacing_m: float, chance: np.ndarray | float) -> np.ndarray:
        """Return [K, 2] positions where a map is true, at a spacing; each is kept by a chance [GY, GX] or one for all,
        times the share of the kind."""
        spacing = np.where(where & self.site.open, f4(self.close * spacing_m), f4(0))
        xy = scattered.poisson_disk(self.site, spacing, self.rng)
        return xy[self.rng.random(len(xy)) < self.site.at(self.share * chance, xy)]

    def plants(
        self, xy: np.ndarray, names: str | np.ndarray, scale: np.ndarray, tint: np.ndarray | float = 1.0
    ) -> Plants:
        """Return plants of a species, or of one for each position [K, 2].

        scale [K]: factors on the kinds' heights; tint: factors on the colours, [3], or of grass and reeds, of which
        none is left out for want of room, [K, 3].
        """
        species = np.broadcast_to(np.asarray(names), len(xy))
        kind = np.empty(len(xy), np.int16)
        for name in np.unique(species):
            chosen = species == name
            kind[chosen] = self.rng.choice(np.flatnonzero(name == SPECIES), np.count_nonzero(chosen))
        made = scattered.make_plants(self.site, xy, kind, scale, self.rng)
        return replace(made, tint=(made.tint * tint).astype(np.float32))

    def between(self, low: float, high: float, count: int) -> np.ndarray:
        """Return [count] random numbers between two."""
        return low + (high - low) * self.rng.random(count)


def covered(plants: Plants, terrain: Terrain, zones: Zones, density: float, rng: np.random.Generator) -> Plants:
    """Return the plants of a valley with those of its banks; `density` is that of the level."""
    if density == 0.0:
        return plants
    grid, ground, water = terrain.grid, terrain.ground_m, terrain.water_m
    site = Site(grid, ground, water, terrain.shore_m, zones.bank_m, ~terrain.keep_clear & (zones.island_m > 0.5))
    close = 1.0 / np.sqrt(density)
    kept = _on_ground(_kept(plants, site, zones, rng), site, zones)
    added = [MAKERS[kind](Planting(site, zones, share, close, rng)) for kind, share in zones.share.items()]
    return scattered.concatenate([kept, *added])


def _on_ground(plants: Plants, site: Site, zones: Zones) -> Plants:
    """Return the plants with the feet of those on the banks on the new ground; the others stay to the bit."""
    xy = plants.position_m[:, :2].astype(np.float64)
    moved = np.zeros(len(xy), bool)
    for share in zones.share.values():
        moved |= site.at(share, xy) > 0
    foot = plants.position_m.copy()
    foot[moved, 2] = site.ground_at(xy[moved])
    return replace(plants, position_m=foot)


def _kept(plants: Plants, site: Site, zones: Zones, rng: np.random.Generator) -> Plants:
    """Return the plants of the valley without those that have no place on the new banks."""
    xy = plants.position_m[:, :2].astype(np.float64)
    wave = np.clip(site.at(fractal(zones.bank_m.shape, site.grid.cell_m, 26.0, 3, rng, gain=0.6), xy), -1.5, 1.5)
    chance, d, group = rng.random(len(xy)), site.at(zones.bank_m, xy), GROUP[plants.kind]
    # Between two kinds of banks each plant belongs to one of them by chance.
    low, gone = np.zeros(len(xy)), np.zeros(len(xy), bool)
    for kind, share in zones.share.items():
        high = low + site.at(share, xy)
        here = (chance >= low) & (chance < high) & (d > -CLEARED_WATER_M)
        if kind == "meadow":
            gone |= here & (d < TURF_M - 2.0 + 4.0 * wave)
        elif kind == "reeds":
            gone |= here & (d < np.where(np.isin(group, ("reed", "rock")), 6.0, 4.2))
        else:
            gone |= here & (d < LAWN_M + 1.0 * wave)
        low = high
    return scattered.select(plants, ~gone | (site.at(zones.island_m, xy) <= 0.5))


def _meadow(p: Planting) -> Plants:
    d = p.zones.bank_m
    clump = smooth_step(-1.0, 0.9, p.noise(4.0, 3))
    # Along the water tall grass hangs over the lip.
    xy = p.places((d > 0.02) & (d < 1.3), TUFT_SPACING_M, f4(0.25) + f4(0.75) * clump)
    fringe = p.plants(xy, "grass", p.between(0.45, 0.95, len(xy)), GRASS_LUSH)
    thin = (f4(0.05) + f4(0.28) * clump**2) * (f4(1) - f4(0.75) * smooth_step(6.0, 16.0, d))
    xy = p.places((d > 1.2) & (d < TURF_M - 3.0), 0.55, thin)
    tufts = p.plants(xy, "grass", p.between(0.35, 0.70, len(xy)), GRASS_TUFT)
    shallow = (d < 0.0) & (d > -0.4) & (p.site.water_m - p.site.ground_m < 0.35)
    xy = p.places(shallow, 0.45, f4(0.6) * smooth_step(0.9, 1.5, p.noise(9.0, 2)))
    reeds = p.plants(xy, "reed", p.between(0.6, 0.9, len(xy)))
    return scattered.concatenate([fringe, tufts, reeds, _meadow_trees(p, clump)])


def _meadow_trees(p: Planting, clump: np.ndarray) -> Plants:
    """Return single bushes and trees, and the bushes before the forest."""
    d = p.zones.bank_m
    xy = p.places((d > 1.6) & (d < TURF_M - 4.0), 5.0, 0.10)
    bushes = p.plants(xy, "bush", np.ones(len(xy)))
    xy = p.places((d > 7.5) & (d < TURF_M - 5.0), 9.0, 0.28)
    trees = p.plants(xy, np.where(p.rng.random(len(xy)) < 0.6, "oak", "birch"), p.between(0.8, 1.05, len(xy)))
    hem = smooth_step(TURF_M - 6.0, TURF_M - 2.0, d) * (f4(1) - smooth_step(TURF_M + 2.0, TURF_M + 5.0, d))
    xy = p.places(hem > 0, 1.5, f4(0.5) * hem * clump)
    return scattered.concatenate([bushes, trees, p.plants(xy, "bush", np.ones(len(xy)))])


def _reeds(p: Planting) -> Plants:
    d, ragged = p.zones.bank_m, p.noise(7.0, 3)
    out = np.minimum(f4(BELT_M[0]) + f4(0.15) * ragged, f4(BELT_SHARE) * p.zones.width_m)
    belt = (d > -out) & (d < BELT_M[1] + 0.7 * ragged) & (p.site.water_m - p.site.ground_m < BELT_DEPTH_M)
    xy = p.places(belt, REED_SPACING_M, smooth_step(-1.9, -1.0, ragged))
    here = np.clip(p.site.at(ragged, xy), -1.0, 1.0)
    tall = p.between(1.05, 1.40, len(xy)) + 0.12 * here
    tall *= np.where(p.site.at(d, xy) < -0.4, 0.85, 1.0)
    dry = np.clip(0.5 + 0.35 * here + 0.25 * p.rng.standard_normal(len(xy)), 0.0, 1.0)[:, None]
    stand = p.plants(xy, "reed", tall, (1 - dry) * REED_GREEN + dry * REED_DRY)
    stand = replace(stand, width_m=(REED_WIDTH * stand.width_m).astype(np.float32))
    # Behind the belt sedges and tall herbs, then bushes.
    clump = smooth_step(-0.8, 1.0, p.noise(3.5, 2))
    xy = p.places((d > BELT_M[1] - 0.6) & (d < 6.0), 0.45, f4(0.55) * clump)
    herbs = p.plants(xy, "grass", p.between(0.6, 1.1, len(xy)))
    xy = p.places((d > 3.2) & (d < 7.5), 1.6, f4(0.40) * clump)
    return scattered.concatenate([stand, herbs, p.plants(xy, "bush", np.ones(len(xy)))])


def _quay(p: Planting) -> Plants:
    d = p.zones.bank_m
    xy = _row_places(p)
    trees = p.plants(xy, "oak", p.between(0.72, 0.82, len(xy)), np.array([0.95, 1.0, 0.9]))
    xy = p.places((d > LAWN_M - 1.0) & (d < LAWN_M + 1.5), 1.1, 0.7)
    hedge = p.plants(xy, "bush", np.ones(len(xy)))
    xy = p.places((d > PAVED_M + 0.2) & (d < LAWN_M), 0.6, 0.05)
    return scattered.concatenate([trees, hedge, p.plants(xy, "grass", p.between(0.25, 0.45, len(xy)))])


def _row_places(p: Planting) -> np.ndarray:
    """Return [K, 2] places `ROW_M` apart along the course on either side, each at the node nearest to it."""
    zones, grid = p.zones, p.site.grid
    near = (np.abs(zones.bank_m - f4(ROW_AT_M)) < grid.cell_m) & (p.share > 0.7) & p.site.open
    rows, columns = np.nonzero(near)
    if len(rows) == 0:
        return np.zeros((0, 2))
    number = np.rint(zones.arc_m[near] / f4(ROW_M)).astype(np.int64)
    away = np.hypot(zones.arc_m[near] - number * f4(ROW_M), zones.bank_m[near] - f4(ROW_AT_M))
    place = 2 * number + (zones.side[near] > 0)
    order = np.lexsort((away, place))
    first = order[np.unique(place[order], return_index=True)[1]]
    first = first[away[first] < 2.0 * grid.cell_m]
    corner = np.array([grid.origin_x_m, grid.origin_y_m])
    return np.column_stack([columns[first], rows[first]]) * grid.cell_m + corner


MAKERS: dict[str, Callable[[Planting], Plants]] = {"meadow": _meadow, "reeds": _reeds, "quay": _quay}
"""What is planted on a bank of each kind."""
