"""The line of a real river's reach: cut from a track on the Earth, projected to metres and made fit to be flown.

The course runs in the order of the track's positions, which is downstream in most data. With elevations, the water
falls monotonically from the higher end to the lower one; a line drawn upstream is flown upstream. Small rises, which
elevation models have along every river, are removed by isotonic regression: the nearest monotone profile in least
squares. Without elevations the water is level.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from thalweg.world import geometry
from thalweg.world import validation as checks
from thalweg.world.errors import ShapeError, WorldError, WorldFileError
from thalweg.world.generate.terrain import check_area
from thalweg.world.real import geodesy
from thalweg.world.real.centerline import SPACING_M

MAX_LENGTH_M = checks.MAX_SAMPLES * SPACING_M
"""Maximum length of a reach."""
MAX_ELEVATION_ERROR_M = 5.0
"""Maximum distance of an elevation from the monotone profile; beyond it, it cannot be that of the water."""
MAX_SMOOTH_M = 200.0
"""Maximum standard deviation of the smoothing."""
TRY_SMOOTH_M = 8.0
"""Least smoothing in metres that errors suggest; twice that of the line if it is more, up to `MAX_SMOOTH_M`."""


class ElevationError(WorldError):
    """Elevations that cannot be those of the water."""


@dataclass(frozen=True)
class Track:
    """A line on the Earth, in the order of its positions."""

    name: str
    degrees: np.ndarray
    """[K, 2] float64, longitude and latitude on WGS84."""
    width_m: np.ndarray
    """[K] float64."""
    elevation_m: np.ndarray | None
    """[K] float64, or None where there are none."""


@dataclass(frozen=True)
class Centerline:
    """A real river's line as `World.from_centerline` takes it, and its position on the Earth."""

    name: str
    points: np.ndarray
    """[K, 4] float64: x east and y north of the origin, water level above the datum, width; all in metres."""
    closed: bool
    """Whether the line ends where it begins."""
    origin_deg: tuple[float, float]
    """Longitude and latitude of x = y = 0, the middle of the reach's bounding box."""
    datum_m: float
    """Elevation of z = 0: the lowest water of the reach, 0 where the file gives none."""


@contextmanager
def errors_naming(path: str | Path, smooth_m: float) -> Iterator[None]:
    """Raise errors about a line as `WorldFileError` with the file's name, and a hint for those that smoothing mends."""
    try:
        yield
    except ShapeError as reason:
        try_m = min(max(TRY_SMOOTH_M, 2 * smooth_m), MAX_SMOOTH_M)
        hint = f"; smoothing the line may help, for example smooth_m={try_m:g}" if try_m > smooth_m else ""
        raise WorldFileError(f"{path}: {reason}{hint}") from None
    except WorldError as reason:
        raise WorldFileError(f"{path}: {reason}") from None


def check_options(width_m: float | None, start_m: float, length_m: float | None, smooth_m: float) -> None:
    """Raise `WorldError` for an argument out of its range, before the file is opened."""
    for name, value, low, high in (
        ("width_m", width_m, 2 * checks.CLEARANCE_M, np.inf),
        ("start_m", start_m, 0.0, np.inf),
        ("length_m", length_m, checks.MIN_LENGTH_M[False], MAX_LENGTH_M),
        ("smooth_m", smooth_m, 0.0, MAX_SMOOTH_M),
    ):
        if value is None:
            continue
        if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not np.isfinite(value):
            raise WorldError(f"{name} is {value!r}; expected a number of metres")
        if not low <= value <= high:
            limit = f"at least {low:g}" if high == np.inf else f"{low:g} to {high:g}"
            raise WorldError(f"{name} is {value:g} m; expected {limit} m")


def cut_reach(track: Track, start_m: float, length_m: float | None) -> Track:
    """Return the reach that begins `start_m` along a line and is `length_m` long (None: to the end).

    Lengths are measured along the straight segments between the positions. Longitudes of the reach are continuous, also
    where it crosses 180 degrees.
    """
    arc = np.concatenate([[0.0], np.cumsum(geodesy.chord_lengths(track.degrees))])
    end_m = arc[-1] if length_m is None else start_m + length_m
    if start_m >= arc[-1] or end_m > arc[-1]:
        raise WorldError(
            f"the reach from {start_m:.0f} to {end_m:.0f} m is not on the line, which is {arc[-1]:.0f} m long"
        )
    if end_m - start_m > MAX_LENGTH_M:
        raise WorldError(
            f"the line is {end_m - start_m:.0f} m long; limit {MAX_LENGTH_M:.0f} m: choose a reach by start_m and "
            "length_m"
        )
    inner = arc[(arc > start_m) & (arc < end_m)]
    at = np.concatenate([[start_m], inner, [end_m]])
    longitude = np.unwrap(track.degrees[:, 0], period=360.0)
    degrees = np.stack([np.interp(at, arc, longitude), np.interp(at, arc, track.degrees[:, 1])], axis=1)
    elevation = None if track.elevation_m is None else np.interp(at, arc, track.elevation_m)
    return Track(track.name, degrees, np.interp(at, arc, track.width_m), elevation)


def project(reach: Track, closed: bool, smooth_m: float) -> Centerline:
    """Return a reach in metres about its middle."""
    origin = (reach.degrees.min(axis=0) + reach.degrees.max(axis=0)) / 2
    position = geodesy.local_metres(reach.degrees, origin)
    try:
        check_area(position)
    except WorldError as reason:
        raise WorldError(f"{reason}: choose a shorter reach by start_m and length_m") from None
    level = np.zeros(len(position)) if reach.elevation_m is None else monotone_levels(reach.elevation_m, closed)
    datum = float(level.min())
    points = np.column_stack([position, level - datum, reach.width_m])
    indices = thin_indices(position, closed)
    if len(indices) < 2:
        raise WorldError(f"the line lies within {SPACING_M:g} m of one place: choose a longer reach")
    _check_crossing(position[indices], reach.degrees[indices], closed)
    points = points[indices] if smooth_m == 0 else smooth_line(points[indices], closed, smooth_m)
    longitude = (origin[0] + 180.0) % 360.0 - 180.0
    return Centerline(reach.name, points, closed, (float(longitude), float(origin[1])), datum)


def monotone_levels(elevation_m: np.ndarray, closed: bool) -> np.ndarray:
    """Return [K] the nearest levels to elevations [K] that only fall or only rise.

    A closed line keeps its elevations, because water that flows round has no lower end. Raises `WorldError` for
    elevations further than `MAX_ELEVATION_ERROR_M` from such levels.
    """
    if closed:
        return elevation_m
    from scipy.optimize import isotonic_regression  # slow to import, and only real rivers need it

    level = isotonic_regression(elevation_m, increasing=bool(elevation_m[-1] > elevation_m[0])).x
    error = np.abs(level - elevation_m)
    worst = int(np.argmax(error))
    if error[worst] > MAX_ELEVATION_ERROR_M:
        raise ElevationError(
            f"an elevation of {elevation_m[worst]:g} m lies {error[worst]:.1f} m from a profile that falls all the "
            f"way; limit {MAX_ELEVATION_ERROR_M:g} m: is it that of the water?"
        )
    return level


def thin_indices(position_m: np.ndarray, closed: bool) -> np.ndarray:
    """Return the indices of positions [K, 2] to keep, so that none is nearer to the one before than `SPACING_M`.

    The ends are kept; the repeated last position of a closed line is dropped.
    """
    indices = [0]
    for index in range(1, len(position_m)):
        if np.hypot(*(position_m[index] - position_m[indices[-1]])) >= SPACING_M:
            indices.append(index)
    last = len(position_m) - 1
    if closed:
        while len(indices) > 1 and np.hypot(*(position_m[indices[-1]] - position_m[0])) < SPACING_M:
            indices.pop()
    elif indices[-1] != last:
        indices = [*(indices[:-1] or indices), last]
    return np.array(indices)


def smooth_line(points: np.ndarray, closed: bool, smooth_m: float) -> np.ndarray:
    """Return points [K, 4] after a Gaussian of standard deviation `smooth_m` along the straight segments between them.

    The ends of an open line stay in place, because it is continued beyond them by its mirror image. A corner of angle θ
    becomes a bend of radius smooth_m √(2π) cos²(θ/2) / (2 sin(θ/2)).
    """
    arc, length = geometry.arc_length(points[:, :2], closed)
    if closed:
        arc, points = np.append(arc, length), np.concatenate([points, points[:1]])
    count = max(round(length / SPACING_M), 8)
    even = np.linspace(0.0, length, count + 1)[: count if closed else None]
    fine = np.stack([np.interp(even, arc, column) for column in points.T], axis=1)
    sigma = smooth_m * count / length
    pad = int(4 * sigma) + 1
    if closed:
        rounded = scipy.ndimage.gaussian_filter1d(fine, sigma, axis=0, mode="wrap")
    else:
        padded = np.pad(fine, ((pad, pad), (0, 0)), mode="reflect", reflect_type="odd")
        rounded = scipy.ndimage.gaussian_filter1d(padded, sigma, axis=0)[pad:-pad]
    keep = np.arange(0, len(rounded), max(int(min(sigma / 2, count / 8)), 1))
    if not closed:
        keep = np.unique(np.append(keep, len(rounded) - 1))
    return rounded[keep]


def _check_crossing(position_m: np.ndarray, degrees: np.ndarray, closed: bool) -> None:
    """Raise `WorldError` where a line [K, 2] crosses itself, with the position in degrees."""
    crossings = geometry.self_crossings(position_m, closed)
    if len(crossings):
        one, other = degrees[crossings[0]]
        raise WorldError(
            f"the line crosses itself between its piece at longitude {one[0]:.5f}, latitude {one[1]:.5f} and that at "
            f"{other[0]:.5f}, {other[1]:.5f}"
        )
