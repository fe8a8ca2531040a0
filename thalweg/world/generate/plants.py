"""Scattering of plants and rocks over the terrain: position, kind, size and tint of trees, shrubs, reeds and rocks.

Each group is a Poisson disk sample (dart throwing) whose spacing varies over the map. The light is filled with ones
here and baked later, by `thalweg.world.light.bake`.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from thalweg.core.compute.jit import kernel
from thalweg.world.generate.surface import forest_edge_m
from thalweg.world.noise import fractal, smooth_step
from thalweg.world.record import Grid, Plants
from thalweg.world.species import KINDS, kinds_of

f4 = np.float32

DENSE_FRONT_M = 18.0
"""Width of the dense front of the forest, from its edge inwards."""
SPACING_M = {"front": 2.5, "deep": 3.6, "shrub": 1.3, "reed": 0.42, "rock": 0.9}
"""Minimum distance of two plants of a group at level_density = 1; the mean spacing is about 1.2 times as large."""
REED_DEPTH_M = 0.3
"""Maximum depth of water in which reeds stand."""
REED_REACH_M = 0.45
"""Maximum distance of a reed in the water from the edge."""
RIM_POINTS = 16
"""Number of points around a crown's rim that must not be over water."""
YOUNG_SHARE = 0.4
"""Share of young trees in the first row; they have about two thirds of the height of their kind."""


@dataclass(frozen=True)
class Site:
    """The maps that plants are scattered over, all [GY, GX]."""

    grid: Grid
    ground_m: np.ndarray
    water_m: np.ndarray
    shore_m: np.ndarray
    inside_m: np.ndarray
    """Distance behind the forest's edge, positive in the forest."""
    open: np.ndarray
    """bool: a plant may stand here."""

    def at(self, field: np.ndarray, xy: np.ndarray) -> np.ndarray:
        """Return the value of a map [GY, GX] at the nearest node of each position [K, 2] in metres."""
        row, column = self.nodes(xy)
        return field[row, column]

    def ground_at(self, xy: np.ndarray) -> np.ndarray:
        """Return the height of the ground [K] at positions [K, 2], linear between the nodes, all in metres."""
        column = (xy[:, 0] - self.grid.origin_x_m) / self.grid.cell_m
        row = (xy[:, 1] - self.grid.origin_y_m) / self.grid.cell_m
        return scipy.ndimage.map_coordinates(self.ground_m, [row, column], order=1, mode="nearest")

    def nodes(self, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return row and column [K] of the node nearest to each position [K, 2] in metres."""
        rows, columns = self.shore_m.shape
        column = np.rint((xy[:, 0] - self.grid.origin_x_m) / self.grid.cell_m).astype(np.int64)
        row = np.rint((xy[:, 1] - self.grid.origin_y_m) / self.grid.cell_m).astype(np.int64)
        return np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)


def scatter(
    grid: Grid,
    ground_m: np.ndarray,
    water_m: np.ndarray,
    shore_m: np.ndarray,
    keep_clear: np.ndarray,
    level_density: float,
    rng: np.random.Generator,
) -> Plants:
    """Return the plants of a valley with their light set to ones.

    Maps are [GY, GX], in metres; `shore_m` is positive on land. `level_density` multiplies the number of plants on an
    area; 0 gives none. No plant stands where `keep_clear` [GY, GX] is true, and no crown of a tree or shrub reaches
    over the water. Raises `ValueError` for a negative density.
    """
    if level_density < 0.0:
        raise ValueError(f"level_density must not be negative, but is {level_density}")
    if level_density == 0.0:
        return concatenate([])
    edge = forest_edge_m(grid, shore_m.shape)
    site = Site(grid, ground_m, water_m, shore_m, shore_m - edge, ~keep_clear)
    close = 1.0 / np.sqrt(level_density)
    return concatenate(
        [_trees(site, close, rng), _shrubs(site, close, rng), _reeds(site, close, rng), _rocks(site, close, rng)]
    )


def _trees(site: Site, close: float, rng: np.random.Generator) -> Plants:
    """Return dense rows behind the edge and wider spaced trees inside, in stands of pines and of broad-leaved trees."""
    depth = smooth_step(0.75 * DENSE_FRONT_M, 1.25 * DENSE_FRONT_M, site.inside_m)
    spacing = close * (SPACING_M["front"] + (SPACING_M["deep"] - SPACING_M["front"]) * depth)
    xy = poisson_disk(site, np.where(site.open & (site.inside_m > 0.0), spacing, 0.0), rng)
    stand, within = _noise(site, 30.0, 2, rng), _noise(site, 12.0, 2, rng)
    conifer = site.at(stand, xy) + 0.6 * rng.standard_normal(len(xy)) > 0.15
    other = site.at(within, xy) + 0.8 * rng.standard_normal(len(xy)) > 0.45
    species = np.where(conifer, np.where(other, "fir", "pine"), np.where(other, "birch", "oak"))
    first_row = site.at(site.inside_m, xy) < 2.8
    young = np.where(first_row & (rng.random(len(xy)) < YOUNG_SHARE), 0.62 + 0.12 * rng.random(len(xy)), 1.0)
    return make_plants(site, xy, _random_kinds("tree", species, rng), young, rng)


def _shrubs(site: Site, close: float, rng: np.random.Generator) -> Plants:
    """Return thickets along the forest's edge, undergrowth in its first rows, and single bushes on the grass."""
    thicket = smooth_step(-0.8, 0.6, _noise(site, 9.0, 3, rng))
    near = smooth_step(-2.6, -0.4, site.inside_m) * smooth_step(-7.0, -2.5, -site.inside_m)
    share = thicket * near + 0.08 * smooth_step(-4.0, -2.0, site.inside_m) * smooth_step(-22.0, -12.0, -site.inside_m)
    xy = poisson_disk(site, np.where(site.open & (site.shore_m > 1.2), close * SPACING_M["shrub"], 0.0), rng)
    xy = xy[rng.random(len(xy)) < site.at(share, xy)]
    return make_plants(site, xy, _random_kinds("shrub", None, rng, len(xy)), np.ones(len(xy)), rng)


def _reeds(site: Site, close: float, rng: np.random.Generator) -> Plants:
    """Return clumps of reed in shallow water and on wet sand, and tufts of grass on the dry bank."""
    clump = smooth_step(0.85, 1.5, _noise(site, 7.0, 3, rng))
    wet = (site.shore_m > -REED_REACH_M) & (site.shore_m < 0.8) & (site.water_m - site.ground_m < REED_DEPTH_M)
    bank = (site.shore_m > 1.5) & (site.inside_m < 2.0)
    tuft = smooth_step(0.3, 1.8, _noise(site, 4.0, 3, rng)) * smooth_step(2.0, 5.5, site.shore_m)
    xy = poisson_disk(site, np.where(site.open & (wet | bank), close * SPACING_M["reed"], 0.0), rng)
    share = np.where(wet, 0.6 * clump, np.where(bank, 0.40 * tuft, 0.0))
    xy = xy[rng.random(len(xy)) < site.at(share, xy)]
    species = np.where(site.at(wet, xy) & (rng.random(len(xy)) < 0.9), "reed", "grass")
    return make_plants(site, xy, _random_kinds("reed", species, rng), np.ones(len(xy)), rng)


def _rocks(site: Site, close: float, rng: np.random.Generator) -> Plants:
    """Return groups of rocks on the bank and at the edge of the bed, small ones more often than large ones."""
    group = smooth_step(0.9, 2.0, _noise(site, 8.0, 4, rng))
    near = smooth_step(-0.6, 0.1, site.shore_m) * smooth_step(-9.0, -2.0, -site.shore_m)
    where = site.open & (site.shore_m > -0.5) & (site.shore_m < 9.0)
    xy = poisson_disk(site, np.where(where, close * SPACING_M["rock"], 0.0), rng)
    xy = xy[rng.random(len(xy)) < site.at(0.010 + 0.33 * group, xy) * site.at(near, xy)]
    return make_plants(site, xy, _random_kinds("rock", None, rng, len(xy)), np.ones(len(xy)), rng, skew=2.5)


def _noise(site: Site, wavelength_m: float, octaves: int, rng: np.random.Generator) -> np.ndarray:
    """Return [GY, GX] float32 noise of unit standard deviation on the site's grid."""
    return fractal(site.shore_m.shape, site.grid.cell_m, wavelength_m, octaves, rng, gain=0.6)


def _random_kinds(group: str, species, rng: np.random.Generator, count: int = 0) -> np.ndarray:
    """Return [K] int16 kinds: a random variant of each species [K], or of the whole group if `species` is None."""
    members = np.array(kinds_of(group))
    if species is None:
        return rng.choice(members, count).astype(np.int16)
    names = np.array([KINDS[index].species for index in members])
    kind = np.empty(len(species), np.int16)
    for name in np.unique(species):
        chosen = species == name
        kind[chosen] = rng.choice(members[names == name], np.count_nonzero(chosen))
    return kind


def make_plants(
    site: Site, xy: np.ndarray, kind: np.ndarray, scale: np.ndarray, rng: np.random.Generator, skew: float = 1.0
) -> Plants:
    """Return plants at positions [K, 2] with random heights, widths, rotations and tints.

    Trees and shrubs whose crown has too little room beside the water are left out.
    """
    count = len(xy)
    low, high = np.array([KINDS[k].height_m for k in kind], dtype=np.float64).reshape(-1, 2).T
    soil = 0.12 * site.at(_noise(site, 20.0, 2, rng), xy)
    share = np.clip(rng.random(count) ** skew + soil, 0.0, 1.0)
    height = scale * (low + (high - low) * share)
    width = (
        height * np.array([KINDS[k].aspect for k in kind]) * np.clip(1.0 + 0.08 * rng.standard_normal(count), 0.8, 1.2)
    )
    groups = np.array([KINDS[k].group for k in kind], dtype="U8")
    bound = np.isin(groups, ("tree", "shrub"))
    free_width = np.where(bound, 2.0 * site.at(site.shore_m, xy), np.inf)
    keep = free_width > 0.62 * width
    foot = np.column_stack([xy, site.ground_at(xy)])
    plants = Plants(
        position_m=foot.astype(np.float32),
        height_m=height.astype(np.float32),
        width_m=np.minimum(width, free_width).astype(np.float32),
        kind=kind,
        turn=rng.uniform(0.0, 2.0 * np.pi, count).astype(np.float32),
        tint=_tints(site, xy, rng),
        light=np.ones((count, 2), np.float32),
    )
    return select(plants, keep & ~(bound & _over_water(site, xy, 0.5 * plants.width_m)))


def _over_water(site: Site, xy: np.ndarray, radius_m: np.ndarray) -> np.ndarray:
    """Return [K] bool whether a crown with this radius [K] reaches over water, sampled around its rim.

    The distance to the shore alone is not enough: near an island it may be an estimate.
    """
    wet = site.water_m > site.ground_m
    over = np.zeros(len(xy), bool)
    for angle in np.arange(RIM_POINTS) * 2.0 * np.pi / RIM_POINTS:
        reach = np.maximum(radius_m - 0.5 * site.grid.cell_m, 0.0)[:, None]
        over |= site.at(wet, xy + reach * np.array([np.cos(angle), np.sin(angle)]))
    return over


def _tints(site: Site, xy: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return [K, 3] float32 factors: brightness and hue vary by about 12 percent, by position and by plant."""
    bright = 0.08 * site.at(_noise(site, 16.0, 2, rng), xy) + 0.09 * rng.standard_normal(len(xy))
    hue = 0.05 * site.at(_noise(site, 22.0, 2, rng), xy) + 0.06 * rng.standard_normal(len(xy))
    bright, hue = np.clip(bright, -0.3, 0.3), np.clip(hue, -0.2, 0.2)
    return np.exp(np.column_stack([bright + hue, bright, bright - hue])).astype(np.float32)


def poisson_disk(site: Site, spacing_m: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return [K, 2] random positions; each keeps the spacing [GY, GX] at it from all earlier ones.

    There are none where the spacing is 0.
    """
    rows, columns = spacing_m.shape
    cell = site.grid.cell_m
    inside = np.flatnonzero(spacing_m.ravel() > 0.0)
    if len(inside) == 0:
        return np.zeros((0, 2))
    least = float(spacing_m.ravel()[inside].min())
    # With 12 tries per disk, nearly no room for another plant is left.
    tries = int(np.ceil(12.0 * len(inside) * cell**2 / least**2))
    node = inside[rng.integers(0, len(inside), tries)]
    point = np.column_stack([node % columns, node // columns]) * cell + rng.uniform(-0.5, 0.5, (tries, 2)) * cell
    point = np.clip(point, 0.0, (np.array([columns, rows]) - 1) * cell)
    size = np.array([rows, columns]) * cell
    accepted = throw_darts(point, spacing_m.ravel()[node].astype(np.float64), least, size[0], size[1])
    return point[accepted] + np.array([site.grid.origin_x_m, site.grid.origin_y_m])


@kernel(fastmath=False)
def throw_darts(point, spacing, least, height, width):
    """Return [tries] bool which positions [tries, 2] are accepted, in order.

    A position is accepted if no earlier accepted one is nearer than its spacing [tries]. A bucket of side least /
    sqrt(2) holds at most one position, because `least` is the smallest spacing.
    """
    side = least / np.sqrt(2.0)
    rows = int(height / side) + 1
    columns = int(width / side) + 1
    # The index of the accepted position in each bucket, -1 for none.
    holder = np.full((rows, columns), -1, np.int32)
    accepted = np.zeros(len(point), np.bool_)
    for n in range(len(point)):
        x, y = point[n, 0], point[n, 1]
        reach = int(np.ceil(spacing[n] / side))
        row, column = int(y / side), int(x / side)
        free = True
        # Only buckets within the spacing can hold a position that is too near.
        for i in range(max(row - reach, 0), min(row + reach + 1, rows)):
            for j in range(max(column - reach, 0), min(column + reach + 1, columns)):
                other = holder[i, j]
                if other >= 0 and (point[other, 0] - x) ** 2 + (point[other, 1] - y) ** 2 < spacing[n] ** 2:
                    free = False
        if free:
            holder[row, column] = n
            accepted[n] = True
    return accepted


def select(plants: Plants, keep: np.ndarray) -> Plants:
    """Return the plants where keep [M] bool is true."""
    return Plants(**{name: getattr(plants, name)[keep] for name in Plants.__dataclass_fields__})


def concatenate(groups: list[Plants]) -> Plants:
    """Return all plants of several groups in one record; of no groups that is empty."""
    empty = Plants(
        position_m=np.zeros((0, 3), np.float32),
        height_m=np.zeros(0, np.float32),
        width_m=np.zeros(0, np.float32),
        kind=np.zeros(0, np.int16),
        turn=np.zeros(0, np.float32),
        tint=np.zeros((0, 3), np.float32),
        light=np.zeros((0, 2), np.float32),
    )
    groups = [empty, *groups]
    return Plants(**{name: np.concatenate([getattr(p, name) for p in groups]) for name in Plants.__dataclass_fields__})
