"""What do the rules know of the worlds? All courses of a batch in flat arrays, so that one kernel serves several
worlds.

Dimension letters: W worlds, S samples of all worlds, I islands, B bridges, P planes of all bridges. Absent on
purpose: everything that is only drawn.
"""

import hashlib
import itertools
import math
from collections.abc import Sequence
from dataclasses import asdict
from numbers import Real
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, HalfspaceIntersection

from thalweg.env.config import EnvConfig
from thalweg.world.record import World

LEVEL_MAX_STEPS = 500
"""Step limit of the levels (paper)."""
STEPS_PER_METRE = 1.35
"""Step limit of any other world, per metre of its course: what 500 steps are for a loop of about 370 m."""
LEVEL_LENGTH_SHARE = 0.02
"""A course that differs by more of its length from the level whose name it bears is no river of that level."""


class Courses(NamedTuple):
    """Flat arrays over the worlds of a batch; `first_x[w]:first_x[w + 1]` are world w's rows."""

    first_sample: np.ndarray
    """[W + 1] int64."""
    closed: np.ndarray
    """[W] int64, 1 for a loop."""
    segments: np.ndarray
    """[W] int64."""
    max_steps: np.ndarray
    """[W] int64."""
    position: np.ndarray
    """[S, 2] float64, metres."""
    tangent: np.ndarray
    """[S, 2] float64, unit vectors."""
    width: np.ndarray
    """[S] float64, metres, bank to bank."""
    level: np.ndarray
    """[S] float64, metres."""
    arc: np.ndarray
    """[S] float64, metres from the first sample of the same world."""
    length: np.ndarray
    """[W] float64, metres."""
    first_island: np.ndarray
    """[W + 1] int64."""
    island: np.ndarray
    """[I, 6] float64: centre x, y; then the two axes, each divided by its half length: inside where u^2 + v^2 <= 1."""
    first_bridge: np.ndarray
    """[W + 1] int64."""
    bridge_box: np.ndarray
    """[B, 6] float64, lowest and highest corner of each bridge's solid, grown by the body."""
    first_plane: np.ndarray
    """[B + 1] int64."""
    plane: np.ndarray
    """[P, 4] float64, unit normal n and offset d of each bridge's convex hull grown by the body: solid where n.p <=
    d."""


def pack(worlds: Sequence[World], config: EnvConfig) -> Courses:
    """The courses of some worlds under a config."""
    if not worlds:
        raise ValueError("at least one world is needed")
    rivers = [world.river for world in worlds]
    solids = [grown_hull(row, config.body_m) for world in worlds for row in world.bridges]
    return Courses(
        first_sample=_offsets([len(river.arc_m) for river in rivers]),
        closed=np.array([int(river.closed) for river in rivers], dtype=np.int64),
        segments=np.array([river.segments for river in rivers], dtype=np.int64),
        max_steps=np.array([step_limit(world, config) for world in worlds], dtype=np.int64),
        position=_joined([river.position_m for river in rivers], 2),
        tangent=_joined([river.tangent for river in rivers], 2),
        width=_joined([river.width_m for river in rivers]),
        level=_joined([river.level_m for river in rivers]),
        arc=_joined([river.arc_m for river in rivers]),
        length=np.array([river.length_m for river in rivers], dtype=np.float64),
        first_island=_offsets([len(world.islands) for world in worlds]),
        island=_joined([_island_axes(world.islands) for world in worlds], 6),
        first_bridge=_offsets([len(world.bridges) for world in worlds]),
        bridge_box=_joined([np.concatenate([v.min(axis=0), v.max(axis=0)])[None] for _, v in solids], 6),
        first_plane=_offsets([len(planes) for planes, _ in solids]),
        plane=_joined([planes for planes, _ in solids], 4),
    )


def step_limit(world: World, config: EnvConfig) -> int:
    """The longest episode in a world, in steps."""
    if config.max_steps is not None:
        return int(config.max_steps)
    from thalweg.world.levels import LEVELS

    for level in LEVELS.values():
        near = abs(world.river.length_m - level.length_m) <= LEVEL_LENGTH_SHARE * level.length_m
        if world.name.lower() == level.name.lower() and near:
            return LEVEL_MAX_STEPS
    return math.ceil(STEPS_PER_METRE * world.river.length_m)


def grown_hull(row: np.ndarray, body_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Planes [P, 4] and vertices [V, 3] of a bridge's convex hull grown by the body: where the centre of a cube that
    touches it may be.

    The Minkowski sum of hull and cube is the convex hull of all sums of their corners; pushing each plane out by the
    cube's support alone would leave the grown solid too large at its edges.
    """
    from thalweg.world.bridges import hull_planes

    planes = np.asarray(hull_planes(row), dtype=np.float64)
    vertices = HalfspaceIntersection(
        np.column_stack([planes[:, :3], -planes[:, 3]]), _inner_point(planes)
    ).intersections
    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3))) * body_m
    grown = (vertices[:, None, :] + corners[None, :, :]).reshape(-1, 3)
    hull = ConvexHull(grown)
    equations = hull.equations
    _, first = np.unique(np.round(equations, 7), axis=0, return_index=True)
    equations = equations[np.sort(first)]
    return np.column_stack([equations[:, :3], -equations[:, 3]]), grown[hull.vertices]


def fingerprint(world: World) -> int:
    """A number that differs between worlds whose rules or looks differ, to refuse a state of another world.

    Light and the rest of the maps follow from what is hashed.
    """
    digest = hashlib.sha256(repr((world.name, int(world.seed), bool(world.river.closed))).encode())
    river = world.river
    rules = (river.position_m, river.width_m, river.level_m, world.islands, world.bridges)
    looks = (world.ground_m, world.albedo, world.plants.position_m, [world.sun_azimuth, world.sun_elevation])
    for array in (*rules, *looks):
        whole = np.ascontiguousarray(array, dtype=np.float64)
        digest.update(repr(whole.shape).encode())
        digest.update(whole.tobytes())
    return _number(digest)


def config_fingerprint(config: EnvConfig) -> int:
    """A number that differs between configs with unlike values, however equal ones are written (15 and 15.0)."""
    values = {**asdict(config), "camera": asdict(config.camera)}
    plain = {name: float(value) if isinstance(value, Real) else value for name, value in values.items()}
    plain["camera"] = {name: float(value) for name, value in values["camera"].items()}
    return _number(hashlib.sha256(repr(plain).encode()))


def _number(digest: "hashlib._Hash") -> int:
    """The first 64 bits of a digest."""
    return int.from_bytes(digest.digest()[:8], "little")


def _inner_point(planes: np.ndarray) -> np.ndarray:
    """The point [3] of a convex solid that lies deepest inside (Chebyshev centre by linear programming)."""
    from scipy.optimize import linprog

    norm = np.linalg.norm(planes[:, :3], axis=1)
    found = linprog(
        [0.0, 0.0, 0.0, -1.0],
        A_ub=np.column_stack([planes[:, :3], norm]),
        b_ub=planes[:, 3],
        bounds=[(None, None)] * 3 + [(0.0, None)],
    )
    if not found.success or found.x[3] <= 0:
        raise ValueError("the planes of a bridge's hull enclose no solid")
    return found.x[:3]


def _island_axes(islands: np.ndarray) -> np.ndarray:
    """[I, 5] ellipses -> [I, 6] rows as `Courses.island` holds them."""
    x, y, along, across, angle = np.asarray(islands, dtype=np.float64).reshape(-1, 5).T
    cos, sin = np.cos(angle), np.sin(angle)
    return np.column_stack([x, y, cos / along, sin / along, -sin / across, cos / across])


def _offsets(counts: Sequence[int]) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _joined(parts: Sequence[np.ndarray], columns: int | None = None) -> np.ndarray:
    """Rows of all parts below one another as contiguous float64; well shaped when there is none."""
    shape = (-1,) if columns is None else (-1, columns)
    arrays = [np.asarray(part, dtype=np.float64).reshape(shape) for part in parts]
    return np.ascontiguousarray(np.concatenate(arrays)) if arrays else np.zeros((0, columns or 1))
