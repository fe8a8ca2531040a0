"""The zones of a valley: how far each node of the map belongs to a bank of each kind, and where it lies along it."""

from dataclasses import dataclass

import numpy as np
import scipy

from thalweg.world.banks import KINDS, BankReach, Banks
from thalweg.world.generate import shore
from thalweg.world.generate.continuation import continued
from thalweg.world.generate.terrain import Terrain
from thalweg.world.noise import smooth_step
from thalweg.world.record import Grid, River

f4 = np.float32
STEP_M = 0.25
"""Resolution of the kinds along the course."""
BLEND_M = 1.2
"""Standard deviation of the Gaussian that blends two kinds along a bank."""
ACROSS_M = 1.5
"""Standard deviation of the Gaussian that blends the banks of two arms, away from the water."""
LEAST_SHARE = 1e-3
"""Least share of a kind that counts."""
FAR_M = 1000.0
"""Distance from an island where there is none."""
ISLAND_M = 0.05
"""A node in the course whose nearest shore is nearer than its bank by this belongs to an island."""


@dataclass(frozen=True)
class Zones:
    """Maps [GY, GX] float32 of the banks."""

    bank_m: np.ndarray
    """Distance from the nearest bank, negative in the water; an island counts as water."""
    arc_m: np.ndarray
    """Arc length of the nearest point of the course; it goes on beyond the ends of an open one."""
    side: np.ndarray
    """1 on the left of the course, -1 on its right."""
    width_m: np.ndarray
    """Width of the course at that point."""
    island_m: np.ndarray
    """Distance from an island, 0 on it; `FAR_M` where a bank is nearer."""
    share: dict[str, np.ndarray]
    """How far a node belongs to a bank of each kind other than forest that there is, 0 to 1."""

    def rows(self, rows: slice) -> "Zones":
        """Return some rows of all maps, without a copy."""
        share = {kind: share[rows] for kind, share in self.share.items()}
        bank_m, arc_m, side = self.bank_m[rows], self.arc_m[rows], self.side[rows]
        return Zones(bank_m, arc_m, side, self.width_m[rows], self.island_m[rows], share)


def measure(terrain: Terrain, river: River, banks: Banks) -> Zones:
    """Return the zones of a river's banks on its terrain."""
    grid, shape = terrain.grid, terrain.ground_m.shape
    longer = continued(river, grid, shape)
    course, arc_m, side = _places(grid, shape, river, longer)
    # Islands lie in the course, side channels outside it.
    bank_m = np.where(course.edge_m > 0, terrain.shore_m, course.edge_m)
    on_island = (course.edge_m < 0) & (terrain.shore_m > course.edge_m + f4(ISLAND_M))
    island_m = np.where(on_island, np.maximum(-terrain.shore_m, f4(0)), f4(FAR_M))
    samples = np.arange(len(longer.arc_m) + 1)
    width_m = np.interp(course.course_index, samples, np.append(longer.width_m, longer.width_m[0]))
    shares = _shares(river, banks, bank_m, arc_m, side, grid.cell_m)
    return Zones(bank_m, arc_m, side, width_m.astype(np.float32), island_m, shares)


def shares_on(grid: Grid, shape: tuple[int, int], river: River, banks: Banks) -> dict[str, np.ndarray]:
    """Return the map of each kind, as in `Zones.share`, on a map [GY, GX] of which only the course is known: there,
    side channels are land."""
    course, arc_m, side = _places(grid, shape, river, continued(river, grid, shape))
    return _shares(river, banks, course.edge_m, arc_m, side, grid.cell_m)


def _places(
    grid: Grid, shape: tuple[int, int], river: River, longer: River
) -> tuple[shore.Shore, np.ndarray, np.ndarray]:
    """Return where nodes lie by the `longer` course, to the edge of the map: `Zones.arc_m` and `Zones.side` too."""
    course = shore.measure(grid, shape, longer)
    before = int(np.argmin(np.hypot(*(longer.position_m - river.position_m[0]).T)))
    arc = np.append(longer.arc_m, longer.length_m) - longer.arc_m[before]
    arc_m = np.interp(course.course_index, np.arange(len(arc)), arc).astype(np.float32)
    return course, arc_m, np.where(course.across >= 0, f4(1), f4(-1))


def kinds_along(river: River, banks: Banks, side: str) -> np.ndarray:
    """Return [K] int the kind, as an index into `thalweg.world.banks.KINDS`, of each `STEP_M` of a bank."""
    count = max(int(np.ceil(river.length_m / STEP_M)), 1)
    at = (np.arange(count) + 0.5) * river.length_m / count
    found = np.zeros(count, np.int64)
    for reach in banks:
        if reach.side in ("both", side):
            found[_within(reach, at, river.length_m)] = KINDS.index(reach.kind)
    return found


def _within(reach: BankReach, at: np.ndarray, length_m: float) -> np.ndarray:
    """Return [K] bool which arc lengths a reach holds; on a loop it may go over the end."""
    end = length_m if reach.end_m is None else reach.end_m
    if end < reach.start_m:
        return (at >= reach.start_m) | (at < end)
    return (at >= reach.start_m) & (at < end)


def _shares(
    river: River, banks: Banks, bank_m: np.ndarray, arc_m: np.ndarray, side: np.ndarray, cell_m: float
) -> dict[str, np.ndarray]:
    """Return the map of each kind that there is."""
    along = {name: kinds_along(river, banks, name) for name in ("left", "right")}
    step = river.length_m / len(along["left"])
    mode = "wrap" if river.closed else "nearest"
    place = arc_m / f4(step) - f4(0.5)
    place = np.mod(place, len(along["left"])) if river.closed else place
    found = {}
    for number, kind in enumerate(KINDS):
        if number == 0 or not any((each == number).any() for each in along.values()):
            continue
        profiles = {
            name: scipy.ndimage.gaussian_filter1d((each == number).astype(np.float64), BLEND_M / step, mode=mode)
            for name, each in along.items()
        }
        left, right = (_at(profiles[name], place, river.closed) for name in ("left", "right"))
        share = np.where(side > 0, left, right)
        # Between two arms the map jumps from the bank of one to that of the other.
        smooth = scipy.ndimage.gaussian_filter(share, ACROSS_M / cell_m)
        share = share + (smooth - share) * smooth_step(1.0, 3.0, bank_m)
        # The tails of Gaussians have no end: where nothing would show, the valley stays as it is, to the bit.
        found[kind] = np.where(share < LEAST_SHARE, 0.0, share).astype(np.float32)
    return found


def _at(profile: np.ndarray, place: np.ndarray, closed: bool) -> np.ndarray:
    """Return a profile [K] at fractional indices [GY, GX], float32; its ends go on, or meet on a loop."""
    index = np.arange(len(profile) + 1 if closed else len(profile))
    values = np.append(profile, profile[:1]) if closed else profile
    return np.interp(place, index, values).astype(np.float32)
