"""Course arrays: what the rules need of a batch of worlds, in flat arrays, so that one kernel serves several worlds.

Dimension letters: W worlds, S samples of all worlds, I islands, B bridges, P planes of all bridges. Everything that
affects only the frames is absent.
"""

import hashlib
import itertools
import math
from collections.abc import Sequence
from numbers import Real
from typing import Any, NamedTuple

import numpy as np
import scipy

from thalweg.env.config import EnvConfig
from thalweg.env.errors import ConfigError
from thalweg.env.task.deadlines import check_deadline, deadline
from thalweg.env.task.priced.packing import buoys_of, haunts_of, reserves_of, swimmers_of
from thalweg.env.vehicle.lanes import lanes_through
from thalweg.env.vehicle.soundings import no_soundings, take_soundings
from thalweg.world.discharge import relative_speed
from thalweg.world.record import River, World

LEVEL_MAX_STEPS = 500
"""Step limit of the levels (paper)."""
STEPS_PER_METRE = 1.35
"""Step limit of any other world, per metre of its course: as 500 steps for a loop of about 370 m."""
LEVEL_LENGTH_SHARE = 0.02
"""A course whose length differs from that of the level of its name by more than this share is not of that level."""


class CourseArrays(NamedTuple):
    """Flat arrays over the worlds of a batch; `first_x[w]:first_x[w + 1]` are the rows of world w."""

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
    """[B, 6] float64, lowest and highest corner of the convex hull of each bridge, grown by the body."""
    first_plane: np.ndarray
    """[B + 1] int64."""
    plane: np.ndarray
    """[P, 4] float64, unit normal n and offset d of each plane of the grown hulls: a point p is inside where n.p <= d
    for all planes of a bridge."""
    island_arc: np.ndarray
    """[I] float64, metres along the course of the point that is nearest to the centre of each island."""
    bridge_arc: np.ndarray
    """[B] float64, the same of the middle of each bridge."""
    flow: np.ndarray
    """[S] float64, speed of the water in mid-channel over its mean along the course, positive towards growing arc."""
    swimmers: np.ndarray
    """[W] int64, number of swimmers and kayaks; 0 in tasks without them."""
    first_haunt: np.ndarray
    """[W + 1] int64."""
    haunt: np.ndarray
    """[H] float64, metres along the course of the places about which a swimmer or kayak may move."""
    first_reserve: np.ndarray
    """[W + 1] int64."""
    reserve: np.ndarray
    """[R, 2] float64, metres along the course where each reserve begins and ends; none contains the first sample."""
    first_buoy: np.ndarray
    """[W + 1] int64."""
    buoy: np.ndarray
    """[Q, 6] float64, buoys at the edges of reserves, as in `thalweg.render.records.props`."""
    first_depth: np.ndarray
    """[W + 1] int64; this and what follows are for boats, and have no rows for vehicles that fly."""
    depth_layout: np.ndarray
    """[W, 5] float64: x and y of the first node of each world's map of depths and the distance of the nodes, in metres;
    rows and columns."""
    depth: np.ndarray
    """[D] float32, metres of water at each node, negative on land; row after row."""
    first_rock: np.ndarray
    """[W + 1] int64."""
    rock: np.ndarray
    """[R, 3] float64: x, y and radius of each rock that a hull can touch, in metres."""
    arch: np.ndarray
    """[B, 8] float64, of each bridge: x, y; cos, sin of the direction across the river; half of its length and width,
    and half of the opening of its arch at the top of the hull and at that of the mast."""
    through: np.ndarray
    """[S, 2, P] uint8, 1 for points across each sample from which the boat can go on, up and down the course; see
    `thalweg.env.vehicle.lanes`."""


def pack_courses(worlds: Sequence[World], config: EnvConfig) -> CourseArrays:
    """Return the course arrays of a batch of worlds under a config.

    Raises `thalweg.env.vehicle.boat.FitError` for a boat and a river that it does not fit, and `ConfigError` for no
    worlds and for a deadline that nobody can meet.
    """
    if not worlds:
        raise ConfigError("worlds must hold at least one river, got none")
    for world in worlds:
        check_deadline(world, config)
    rivers = [world.river for world in worlds]
    hulls = [grown_hull(row, config.body_m) for world in worlds for row in world.bridges]
    island_arcs = [nearest_arcs(world.river, np.asarray(world.islands)[:, :2]) for world in worlds]
    task, floats = config.task_record, config.vehicle == "asv"
    haunts = [haunts_of(*pair, task) for pair in zip(worlds, island_arcs, strict=True)]
    reserves = [reserves_of(world, task) for world in worlds]
    buoys = [buoys_of(world.river, rows) for world, rows in zip(worlds, reserves, strict=True)]
    courses = CourseArrays(
        first_sample=_offsets([len(river.arc_m) for river in rivers]),
        closed=np.array([int(river.closed) for river in rivers], dtype=np.int64),
        segments=np.array([river.segments for river in rivers], dtype=np.int64),
        max_steps=np.array([step_limit(world, config) for world in worlds], dtype=np.int64),
        position=_concatenate([river.position_m for river in rivers], 2),
        tangent=_concatenate([river.tangent for river in rivers], 2),
        width=_concatenate([river.width_m for river in rivers]),
        level=_concatenate([river.level_m for river in rivers]),
        arc=_concatenate([river.arc_m for river in rivers]),
        length=np.array([river.length_m for river in rivers], dtype=np.float64),
        first_island=_offsets([len(world.islands) for world in worlds]),
        island=_concatenate([_island_axes(world.islands) for world in worlds], 6),
        first_bridge=_offsets([len(world.bridges) for world in worlds]),
        bridge_box=_concatenate([np.concatenate([v.min(axis=0), v.max(axis=0)])[None] for _, v in hulls], 6),
        first_plane=_offsets([len(planes) for planes, _ in hulls]),
        plane=_concatenate([planes for planes, _ in hulls], 4),
        island_arc=_concatenate(island_arcs),
        bridge_arc=_concatenate([nearest_arcs(world.river, np.asarray(world.bridges)[:, :2]) for world in worlds]),
        flow=_concatenate([relative_speed(river) for river in rivers]),
        swimmers=np.array([swimmers_of(*pair, task) for pair in zip(worlds, haunts, strict=True)], dtype=np.int64),
        first_haunt=_offsets([len(rows) for rows in haunts]),
        haunt=_concatenate(haunts),
        first_reserve=_offsets([len(rows) for rows in reserves]),
        reserve=_concatenate(reserves, 2),
        first_buoy=_offsets([len(rows) for rows in buoys]),
        buoy=_concatenate(buoys, 6),
        **(take_soundings(worlds, config.boat) if floats else no_soundings()),
    )
    if not floats:
        return courses
    return courses._replace(through=lanes_through(courses, config.limits, config.boat, worlds))


def nearest_arcs(river: River, points_m: np.ndarray) -> np.ndarray:
    """Return the arc length [K] in metres of the point of a river's line that is nearest to each point [K, 2]."""
    begin = river.position_m
    end = np.roll(begin, -1, axis=0)
    following = np.append(river.arc_m[1:], river.length_m)
    if not river.closed:
        begin, end, following = begin[:-1], end[:-1], river.arc_m[1:]
    along = end - begin
    offset = points_m[:, None] - begin
    fraction = np.clip((offset * along).sum(-1) / (along * along).sum(-1), 0.0, 1.0)
    nearest = np.linalg.norm(offset - fraction[..., None] * along, axis=-1).argmin(axis=1)
    first = river.arc_m[: len(begin)][nearest]
    return first + fraction[np.arange(len(points_m)), nearest] * (following[nearest] - first)


def step_limit(world: World, config: EnvConfig) -> int:
    """Return the maximum length of an episode in a world, in steps."""
    if config.max_steps is not None:
        return int(config.max_steps)
    if config.task_record.deadline_steps_per_m > 0:
        return deadline(config.task_record, world.river)
    from thalweg.world.levels import ALL_LEVELS

    for level in ALL_LEVELS.values():
        similar = abs(world.river.length_m - level.length_m) <= LEVEL_LENGTH_SHARE * level.length_m
        # Behind a plus sign, a name says which banks the river has.
        if world.name.partition("+")[0].lower() == level.name.lower() and similar:
            return LEVEL_MAX_STEPS
    return math.ceil(STEPS_PER_METRE * world.river.length_m)


def grown_hull(row: np.ndarray, body_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the planes [P, 4] and vertices [V, 3] of a bridge's convex hull grown by the body: the set of centres at
    which the body, a cube, touches the bridge.

    It is the Minkowski sum of hull and cube, the convex hull of all sums of their corners. Moving each plane outwards
    by the support of the cube would leave it too large at its edges.
    """
    from thalweg.world.bridges import hull_planes

    planes = np.asarray(hull_planes(row), dtype=np.float64)
    vertices = scipy.spatial.HalfspaceIntersection(
        np.column_stack([planes[:, :3], -planes[:, 3]]), _inner_point(planes)
    ).intersections
    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3))) * body_m
    grown = (vertices[:, None, :] + corners[None, :, :]).reshape(-1, 3)
    hull = scipy.spatial.ConvexHull(grown)
    equations = hull.equations
    # Qhull returns a plane for each triangle; faces of more corners appear more than once.
    _, first = np.unique(np.round(equations, 7), axis=0, return_index=True)
    equations = equations[np.sort(first)]
    return np.column_stack([equations[:, :3], -equations[:, 3]]), grown[hull.vertices]


def fingerprint(world: World) -> int:
    """Return a hash of a world's name, seed, course and appearance, by which the state of another world is refused.

    The light and the other maps follow from the hashed arrays.
    """
    digest = hashlib.sha256(repr((world.name, int(world.seed), bool(world.river.closed))).encode())
    river = world.river
    for_rules = (river.position_m, river.width_m, river.level_m, world.islands, world.bridges)
    for_frames = (world.ground_m, world.albedo, world.plants.position_m, [world.sun_azimuth, world.sun_elevation])
    for array in (*for_rules, *for_frames):
        values = np.ascontiguousarray(array, dtype=np.float64)
        digest.update(repr(values.shape).encode())
        digest.update(values.tobytes())
    return _first_64_bits(digest)


def config_fingerprint(config: EnvConfig) -> int:
    """Return a hash of a config's task; equal values give the same hash, whether written as 15 or 15.0."""
    plain = _with_floats(config.as_data())
    for name in ("camera", "boat"):
        if name in plain:
            plain[name] = _with_floats(plain[name])
    return _first_64_bits(hashlib.sha256(repr(plain).encode()))


def _with_floats(data: dict[str, Any]) -> dict[str, Any]:
    """Return data with all its numbers, though not those within a list or another mapping, as floats."""
    return {name: float(value) if isinstance(value, Real) else value for name, value in data.items()}


def _first_64_bits(digest: "hashlib._Hash") -> int:
    """Return the first 64 bits of a digest as an integer."""
    return int.from_bytes(digest.digest()[:8], "little")


def _inner_point(planes: np.ndarray) -> np.ndarray:
    """Return the Chebyshev centre [3] of a convex solid, by linear programming."""
    from scipy.optimize import linprog

    norm = np.linalg.norm(planes[:, :3], axis=1)
    found = linprog(
        [0.0, 0.0, 0.0, -1.0],
        A_ub=np.column_stack([planes[:, :3], norm]),
        b_ub=planes[:, 3],
        bounds=[(None, None)] * 3 + [(0.0, None)],
    )
    if not found.success or found.x[3] <= 0:
        raise ValueError("the planes of a bridge's hull do not enclose a solid")
    return found.x[:3]


def _island_axes(islands: np.ndarray) -> np.ndarray:
    """Return rows [I, 6] as in `CourseArrays.island` of ellipses [I, 5]."""
    x, y, along, across, angle = np.asarray(islands, dtype=np.float64).reshape(-1, 5).T
    cos, sin = np.cos(angle), np.sin(angle)
    return np.column_stack([x, y, cos / along, sin / along, -sin / across, cos / across])


def _offsets(counts: Sequence[int]) -> np.ndarray:
    """Return the first row [W + 1] of each group of rows, and the end of the last."""
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _concatenate(blocks: Sequence[np.ndarray], columns: int | None = None) -> np.ndarray:
    """Return the rows of all blocks as one contiguous float64 array, of zero rows if there is no block."""
    shape = (-1,) if columns is None else (-1, columns)
    arrays = [np.asarray(block, dtype=np.float64).reshape(shape) for block in blocks]
    return np.ascontiguousarray(np.concatenate(arrays)) if arrays else np.zeros((0, columns or 1))
