"""Checks that a river can be flown without breaking a rule; each error names the position and the limit.

Every world passes all of them, whether it comes from a seed or from a custom line.
"""

import numpy as np
import scipy

from thalweg.world import bridges as bridge_shapes
from thalweg.world import geometry, islands
from thalweg.world.errors import ShapeError, WorldError
from thalweg.world.record import River

MIN_RADIUS_M = 6.5
"""Minimum radius of a bend. A camera that flies 1 m and turns 10 degrees per step follows a circle of 5.73 m."""
MIN_INNER_BANK_M = 0.5
"""Minimum radius of the inner bank of a bend."""
MIN_LAND_M = 0.5
"""Minimum land between the banks of two arms."""
CLEARANCE_M = 1.0
"""Distance of a safe pose from banks and islands."""
BODY_M = 0.25
"""Half the edge of the camera's body."""
BAND_M = (0.5, 15.0)
"""Range of allowed heights above the water."""
ROUNDING_M = 1e-6
"""What squares around samples are larger by than they must be."""
MIN_LENGTH_M = {True: 45.0, False: 15.0}
"""Minimum length of a closed and an open course: a circle of the minimum radius with some width, and a few steps."""
MIN_SAMPLES = {True: 24, False: 8}
"""Minimum number of samples of a closed and an open course."""
MAX_SAMPLES = 8000
"""Maximum number of samples of a course: 10 km. The checks compare all pairs."""
MAX_LEVEL_SLOPE = 0.5
"""Maximum change of the water level per metre: half of what a camera climbs while it flies 1 m."""


def check_river(river: River) -> None:
    """Raise `WorldError` unless the river [S] is a valid line with a usable width of water."""
    check_numbers(river)
    check_length(river)
    check_crossing(river)
    check_bends(river)
    check_arms(river, MIN_LAND_M)
    check_slope(river)


def check_world(river: River, island_rows: np.ndarray, bridge_rows: np.ndarray) -> None:
    """Raise `WorldError` unless the river is valid and has a safe pose at every sample."""
    check_river(river)
    check_safe_poses(river, island_rows, bridge_rows)


def check_numbers(river: River) -> None:
    """Check that all values are finite, every width is at least twice the clearance and every depth is positive."""
    for name in ("position_m", "width_m", "depth_m", "level_m"):
        values = np.asarray(getattr(river, name))
        bad = np.flatnonzero(~np.isfinite(values).reshape(len(values), -1).all(axis=1))
        if len(bad):
            raise WorldError(f"{name} is not a finite number at arc {river.arc_m[bad[0]]:.1f} m (sample {bad[0]})")
    narrow = int(np.argmin(river.width_m))
    if river.width_m[narrow] < 2 * CLEARANCE_M:
        raise WorldError(
            f"the river is {river.width_m[narrow]:.2f} m wide at arc {river.arc_m[narrow]:.1f} m; "
            f"at least {2 * CLEARANCE_M:.2f} m are needed"
        )
    shallow = int(np.argmin(river.depth_m))
    if river.depth_m[shallow] <= 0:
        raise WorldError(f"the depth is {river.depth_m[shallow]:.2f} m at arc {river.arc_m[shallow]:.1f} m; limit > 0")


def check_length(river: River) -> None:
    """Check that the course is long enough to be flown."""
    least, fewest = MIN_LENGTH_M[river.closed], MIN_SAMPLES[river.closed]
    kind = "closed" if river.closed else "open"
    if river.length_m < least or len(river.arc_m) < fewest:
        raise WorldError(
            f"a {kind} course of {river.length_m:.1f} m and {len(river.arc_m)} samples is too short; "
            f"at least {least:.1f} m and {fewest} samples are needed"
        )


def check_crossing(river: River) -> None:
    """Check that the centre line does not cross itself."""
    crossings = geometry.self_crossings(river.position_m, river.closed)
    if len(crossings):
        i, j = crossings[0]
        x, y = river.position_m[i]
        raise ShapeError(
            f"the line crosses itself at ({x:.1f}, {y:.1f}) m: arc {river.arc_m[i]:.1f} m and {river.arc_m[j]:.1f} m"
        )


def smoothed_curvature(river: River) -> np.ndarray:
    """Return [S] the curvature in 1/m, smoothed over about one sample against kinks of single samples."""
    kappa = geometry.curvature(river.position_m, river.closed)
    return scipy.ndimage.gaussian_filter1d(kappa, 0.8, mode="wrap" if river.closed else "nearest")


def check_bends(river: River) -> None:
    """Check that no bend is too tight to be followed, nor so tight for its width that the inner bank folds."""
    kappa = np.abs(smoothed_curvature(river))
    tight = int(np.argmax(kappa))
    if kappa[tight] > 1 / MIN_RADIUS_M:
        raise ShapeError(
            f"the bend at arc {river.arc_m[tight]:.1f} m has a radius of {1 / kappa[tight]:.2f} m; a camera that turns "
            f"10 degrees a metre needs {MIN_RADIUS_M:.2f} m"
        )
    inner = 1 / np.maximum(kappa, 1e-9) - river.width_m / 2
    fold = int(np.argmin(inner))
    if inner[fold] < MIN_INNER_BANK_M:
        raise ShapeError(
            f"the bank folds at arc {river.arc_m[fold]:.1f} m: {river.width_m[fold]:.2f} m is too wide for a bend of "
            f"radius {1 / kappa[fold]:.2f} m; limit {2 * (1 / kappa[fold] - MIN_INNER_BANK_M):.2f} m"
        )


def check_arms(river: River, land_m: float) -> None:
    """Check that the banks of different arms are at least `land_m` apart.

    Two samples belong to different arms if the way along the line is longer than a half circle over the required
    distance.
    """
    position, width, worst = river.position_m, river.width_m, (0.0, 0, 0)
    # Squares that just touch where two samples are as far apart as needed; the rounding of their edges is no matter.
    reach = np.maximum((width + land_m) / 2, 0.0)[:, None] + ROUNDING_M
    for i, j in geometry.overlapping(position - reach, position + reach):
        needed = (width[i] + width[j]) / 2 + land_m
        arc = geometry.arc_apart(river.arc_m[i], river.arc_m[j], river.length_m, river.closed)
        margin = np.hypot(*(position[i] - position[j]).T) - needed
        near = np.flatnonzero((arc > 1.6 * needed) & (margin < 0))
        if len(near):
            near = near[margin[near] == margin[near].min()]  # of equal ones, the first along the line
            worst = min(worst, *zip(margin[near], i[near], j[near], strict=True))
    if worst[0] < 0:
        margin, i, j = worst
        needed = (width[i] + width[j]) / 2 + land_m
        raise WorldError(
            f"the banks of two arms overlap: arc {river.arc_m[i]:.1f} m and {river.arc_m[j]:.1f} m are "
            f"{np.hypot(*(position[i] - position[j])):.2f} m apart; limit {needed:.2f} m"
        )


def check_slope(river: River) -> None:
    """Check that the water's surface rises nowhere faster than a camera climbs."""
    rise = np.roll(river.level_m, -1) - river.level_m
    step = np.roll(river.arc_m, -1) - river.arc_m
    step[-1] += river.length_m
    if not river.closed:
        rise, step = rise[:-1], step[:-1]
    slope = np.abs(rise) / step
    steep = int(np.argmax(slope))
    if slope[steep] > MAX_LEVEL_SLOPE:
        raise WorldError(
            f"the water level changes by {slope[steep]:.2f} m per metre at arc {river.arc_m[steep]:.1f} m; "
            f"limit {MAX_LEVEL_SLOPE:.2f}"
        )


def widest_free_gaps(river: River, island_rows: np.ndarray, clearance_m: float) -> np.ndarray:
    """Return [S, 2] the lateral offsets (from, to) in metres of the widest gap at each sample that keeps the clearance.

    NaN where there is none. Offsets are positive to the left of the course.
    """
    normal = geometry.normals(river.tangent)
    share = np.linspace(-1.0, 1.0, 161)
    reach = np.maximum(river.width_m / 2 - clearance_m, 0.0)
    offset = share[None, :] * reach[:, None]
    x = river.position_m[:, :1] + offset * normal[:, :1]
    y = river.position_m[:, 1:] + offset * normal[:, 1:]
    free = np.broadcast_to((river.width_m >= 2 * clearance_m)[:, None], offset.shape).copy()
    for row in island_rows:
        free &= islands.distance(row, x, y) >= clearance_m
    gaps = np.full((len(offset), 2), np.nan)
    for sample in range(len(offset)):
        # Padding with False makes every free run have a start and an end.
        inside = np.concatenate([[False], free[sample], [False]]).astype(np.int8)
        starts, ends = np.flatnonzero(np.diff(inside) == 1), np.flatnonzero(np.diff(inside) == -1) - 1
        if len(starts):
            best = int(np.argmax(ends - starts))
            gaps[sample] = offset[sample, starts[best]], offset[sample, ends[best]]
    return gaps


def safe_heights(river: River, bridge_rows: np.ndarray) -> np.ndarray:
    """Return [S, 2] the heights (from, to) in metres above the water that are free of bridges over the centre line."""
    low = np.full(len(river.arc_m), BAND_M[0])
    for row in bridge_rows:
        top = bridge_shapes.hull_top(row, river.position_m[:, 0], river.position_m[:, 1], BODY_M)
        low = np.maximum(low, top + BODY_M - river.level_m)
    return np.stack([low, np.full(len(low), BAND_M[1])], axis=1)


def check_safe_poses(river: River, island_rows: np.ndarray, bridge_rows: np.ndarray) -> None:
    """Check that every sample has a position and a height with clearance from banks, islands and bridges."""
    gaps = widest_free_gaps(river, island_rows, CLEARANCE_M)
    blocked = np.flatnonzero(np.isnan(gaps[:, 0]))
    if len(blocked):
        raise WorldError(
            f"no safe pose at arc {river.arc_m[blocked[0]]:.1f} m: nowhere {CLEARANCE_M:.2f} m from banks and islands"
        )
    heights = safe_heights(river, bridge_rows)
    high = int(np.argmax(heights[:, 0]))
    if heights[high, 0] > heights[high, 1] - 1.0:
        raise WorldError(
            f"no safe pose at arc {river.arc_m[high]:.1f} m: a bridge reaches {heights[high, 0]:.2f} m over "
            f"the water; limit {heights[high, 1] - 1.0:.2f} m"
        )
