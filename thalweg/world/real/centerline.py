"""Worlds from a custom line: the points are checked, resampled, and built like a generated river, with less in it."""

from typing import Any

import numpy as np

from thalweg.world import geometry
from thalweg.world import validation as checks
from thalweg.world.banks import Banks, check_banks, read_banks
from thalweg.world.errors import WorldError
from thalweg.world.generate.banks.lay import Valley, lay
from thalweg.world.generate.build import finish_world, resolve_level
from thalweg.world.generate.hydrology import MAX_DEPTH_TO_WIDTH, make_river
from thalweg.world.generate.memory import check_memory
from thalweg.world.generate.plants import concatenate
from thalweg.world.generate.terrain import Relief, Terrain, build_terrain
from thalweg.world.record import River, World

SPACING_M = 1.3
"""Distance between river samples."""
FINE_SAMPLES = 8
"""Points of the spline per sample for measuring its arc length."""
DEPTH_M = (0.5, 1.8)
"""Minimum and maximum depth of the river, which the points do not give."""
SAND, GRASS = (150, 138, 112), (88, 98, 62)
"""Reflectances of a bare world, coded as in `World.albedo`."""
MAX_GAP_RATIO = 3.0
"""Maximum distance between the ends of a closed line, relative to the largest other step."""
MAX_WIDTH_M = 100.0
"""Maximum width; the banks of a wider river would come near the edge of its map."""
MAX_COORDINATE_M = 2e4
"""Largest coordinate: plants, light and pictures are float32, which resolves 2 mm there."""


def read_points(points: np.ndarray, closed: bool) -> np.ndarray:
    """Return [K, 4] float64 without a repeated last point; raises `WorldError` for invalid points."""
    try:
        values = np.array(points, dtype=np.float64)
    except (TypeError, ValueError) as reason:
        raise WorldError(f"points are not numbers: {reason}") from None
    if values.ndim != 2 or values.shape[1] != 4:
        raise WorldError(f"points have the shape {values.shape}; expected [K, 4]: x, y, water level, width")
    bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if len(bad):
        raise WorldError(f"point {bad[0]} is not finite: {values[bad[0]].tolist()}")
    far = np.argwhere(np.abs(values[:, :3]) > MAX_COORDINATE_M)
    if len(far):
        point, column = far[0]
        raise WorldError(
            f"point {point} lies at {('x', 'y', 'water level')[column]} = {values[point, column]:.1f} m; limit "
            f"{MAX_COORDINATE_M:.0f} m, since the maps lose precision far from the origin: subtract an offset first"
        )
    if closed and len(values) > 1 and np.array_equal(values[0, :2], values[-1, :2]):
        values = values[:-1]
    if len(values) < 4:
        raise WorldError(f"{len(values)} points are too few; at least 4 are needed")
    if len(values) > checks.MAX_SAMPLES:
        raise WorldError(f"{len(values)} points are too many; limit {checks.MAX_SAMPLES}")
    steps = np.hypot(*geometry.edges(values[:, :2], closed).T)
    same = np.flatnonzero(steps < 1e-6)
    if len(same):
        x, y = values[same[0], :2]
        more = f"; {len(same)} such pairs in all" if len(same) > 1 else ""
        raise WorldError(
            f"points {same[0]} and {(same[0] + 1) % len(values)} are the same place, ({x:g}, {y:g}) m: leave out one of"
            f" the two{more}"
        )
    for bad, limit in ((values[:, 3] <= 0, "> 0"), (values[:, 3] > MAX_WIDTH_M, f"{MAX_WIDTH_M:.0f} m")):
        if bad.any():
            point = int(np.argmax(bad))
            arc = geometry.arc_length(values[:, :2], closed)[0][point]
            raise WorldError(f"the width is {values[point, 3]:.2f} m at arc {arc:.1f} m (point {point}); limit {limit}")
    if closed and steps[-1] > MAX_GAP_RATIO * steps[:-1].max():
        raise WorldError(
            f"the line is open: its ends lie {steps[-1]:.1f} m apart, and no other two points more than "
            f"{steps[:-1].max():.1f} m; close it or pass closed=False"
        )
    return values


def check_size(values: np.ndarray, closed: bool, plant_density: float) -> None:
    """Raise `WorldError` for points [K, 4] of a river that is too large to be built, before memory is allocated."""
    check_memory(values[:, :2], plant_density)
    length = geometry.arc_length(values[:, :2], closed)[1]
    if length / SPACING_M > checks.MAX_SAMPLES:
        raise WorldError(
            f"the line is {length:.0f} m long, {length / SPACING_M:.0f} samples; limit {checks.MAX_SAMPLES} samples"
        )


def resample(values: np.ndarray, closed: bool) -> np.ndarray:
    """Return [S, 4] points spaced by about `SPACING_M` along a smooth curve through the points [K, 4].

    Positions follow a cubic spline over the chord length; level and width follow monotone cubics, which never
    overshoot.
    """
    from scipy.interpolate import CubicSpline, PchipInterpolator  # slow to import, and only custom lines need it

    chord, length = geometry.arc_length(values[:, :2], closed)
    if closed:
        # Some points are repeated on either side, so that the monotone cubics are periodic too.
        knots, table = np.append(chord, length), np.concatenate([values, values[:1]])
        position = CubicSpline(knots, table[:, :2], bc_type="periodic")
        pad = min(3, len(values) - 1)
        around = np.concatenate([values[-pad:], values, values[: pad + 1]])
        around_at = np.concatenate([chord[-pad:] - length, chord, chord[: pad + 1] + length])
        profile = PchipInterpolator(around_at, around[:, 2:])
    else:
        position = CubicSpline(chord, values[:, :2])
        profile = PchipInterpolator(chord, values[:, 2:])
    fine_at = np.linspace(0, length, max(int(length / SPACING_M), 8) * FINE_SAMPLES + 1)
    fine = position(fine_at)
    arc = geometry.arc_length(fine, closed=False)[0]
    count = max(round(arc[-1] / SPACING_M), 4)
    even = np.linspace(0, arc[-1], count + 1)
    at = np.interp(even[:-1] if closed else even, arc, fine_at)
    return np.concatenate([position(at), profile(at)], axis=1)


def read_river(points: np.ndarray, closed: bool, plant_density: float) -> River:
    """Return the validated river through points [K, 4] of x, y, water level and width; raises `WorldError`."""
    values = read_points(points, closed)
    check_size(values, closed, plant_density)
    polygon = geometry.self_crossings(values[:, :2], closed)
    if len(polygon):
        i, j = polygon[0]
        arc = geometry.arc_length(values[:, :2], closed)[0]
        x, y = values[i, :2]
        raise WorldError(f"the line crosses itself near ({x:.1f}, {y:.1f}) m: arc {arc[i]:.1f} m and {arc[j]:.1f} m")
    even = resample(values, closed)
    width = even[:, 3]
    depth = np.minimum(np.clip(0.3 + 0.09 * width, *DEPTH_M), MAX_DEPTH_TO_WIDTH * width)
    river = make_river(even[:, :2], closed, width, depth, even[:, 2])
    checks.check_river(river)
    checks.check_safe_poses(river, np.zeros((0, 5)), np.zeros((0, 11)))
    return river


def from_centerline(
    points: np.ndarray, closed: bool = True, *, seed: int = 0, plants: bool = True, banks: Any = ()
) -> World:
    """Return the world around a line of x, y, water level and width in metres, without bridges and islands.

    Args:
        points: [K, 4] x, y, water level and width of the river, in metres.
        closed: Whether the last point is joined to the first. On an open line, the far end is the goal.
        seed: Seed of the land and the plants.
        plants: False leaves out plants and baked light, which is faster; for tests.
        banks: Kinds of the banks, as `thalweg.world.banks.read_banks` takes them, such as "meadow".

    Raises `WorldError` for a line from which no safe river can be made, with the position and the limit, and for a
    `closed` that is no boolean.
    """
    if not isinstance(closed, bool | np.bool_):
        raise WorldError(f"closed is {closed!r:.40}; expected True or False")
    reaches = read_banks(banks)
    river = read_river(points, bool(closed), float(plants))
    return world_around(river, np.zeros((0, 5)), np.zeros((0, 11)), seed, plants=plants, banks=reaches)


def world_around(
    river: River, islands: np.ndarray, bridges: np.ndarray, seed: int, *, plants: bool, banks: Banks = ()
) -> World:
    """Return the world around a valid river [S] with islands [I, 5] and bridges [B, 11].

    Raises `WorldError` for an invalid seed, and for a reach of banks that is not on the course.
    """
    if seed is None:  # for which a level would give its default
        raise WorldError("a seed is a whole number, not None")
    seed = resolve_level("Easy", seed)[1]
    check_banks(banks, river.length_m, river.closed)
    streams = [np.random.Generator(np.random.PCG64(s)) for s in np.random.SeedSequence(seed).spawn(5)]
    terrain = build_terrain(river, islands, bridges, (), Relief(), streams[0])
    if not plants:
        return bare_world(river, islands, bridges, terrain, seed, banks, streams[4])
    return finish_world(
        name="custom",
        seed=seed,
        river=river,
        islands=islands,
        bridges=bridges,
        terrain=terrain,
        plant_density=1.0,
        streams=streams[1:],
        banks=banks,
    )


def bare_world(
    river: River,
    islands: np.ndarray,
    bridges: np.ndarray,
    terrain: Terrain,
    seed: int,
    banks: Banks,
    banks_rng: np.random.Generator,
) -> World:
    """Return a world of sand and grass, and of its other banks, in uniform light, without plants."""
    shape = terrain.ground_m.shape
    sandy = terrain.shore_m < 3.0
    albedo = np.where(sandy[..., None], np.array(SAND, np.uint8), np.array(GRASS, np.uint8))
    empty = concatenate([])
    if banks:
        terrain, albedo, _ = lay(Valley(terrain, albedo, empty), river, bridges, banks, 0.0, banks_rng)
    return World(
        name="custom",
        seed=seed,
        river=river,
        islands=islands,
        bridges=bridges,
        grid=terrain.grid,
        ground_m=terrain.ground_m,
        water_m=terrain.water_m,
        albedo=albedo,
        sun=np.full(shape, 255, np.uint8),
        sky=np.full(shape, 255, np.uint8),
        canopy_m=np.maximum(terrain.ground_m, terrain.water_m),
        plants=empty,
        sun_azimuth=0.8,
        sun_elevation=float(np.radians(55.0)),
        banks=banks,
    )
