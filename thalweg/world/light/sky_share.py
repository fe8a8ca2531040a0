"""The share of the sky's light at each node, from a scan of the horizon in which crowns are half transparent."""

from functools import partial

import numpy as np
import scipy

from thalweg.core.compute.jit import kernel
from thalweg.core.compute.threads import run_in_threads

f4 = np.float32

AZIMUTHS = 12
"""Number of directions in which the horizon is scanned."""
SKY_STRIDE = 2
"""Spacing, in nodes, at which the sky is computed."""
SKY_REACH_M = 40.0
"""Distance to which the horizon is scanned."""
CROWN_GAPS = 0.32
"""Share of the sky's light that passes through the crowns and trunks in front of it."""
COVER_SHADE = 0.6
"""Share of the sky's light that a closed canopy overhead stops."""


def sky_share(surface: np.ndarray, tall: np.ndarray, cover: np.ndarray, cell_m: float) -> np.ndarray:
    """Return [GY, GX] float32 the share of the sky's light at each node, in 0..1."""
    stride = SKY_STRIDE
    cell = f4(cell_m * stride)
    solid = np.ascontiguousarray(surface[::stride, ::stride])
    leafy = np.ascontiguousarray(tall[::stride, ::stride])
    scanned = np.empty(solid.shape, np.float32)
    scan = _scan_steps(cell_m * stride), _scan_directions()
    run_in_threads(len(solid), partial(horizon_sky, scanned, solid, leafy, cell, *scan))
    # Light comes from the side too, so the cover overhead counts with its surroundings (0.8 m).
    roof = scipy.ndimage.gaussian_filter(cover, 0.8 / cell_m)
    return _upsampled(scanned, surface.shape, stride) * (f4(1.0) - f4(COVER_SHADE) * roof)


def _scan_directions() -> np.ndarray:
    """Return [AZIMUTHS, 2] float32 unit vectors (east, north), evenly spaced.

    They are a table, because a compiler that evaluates a cosine at compile time may round it differently from a call.
    """
    angle = (np.arange(AZIMUTHS) + 0.5) * 2.0 * np.pi / AZIMUTHS
    return np.stack([np.cos(angle), np.sin(angle)], axis=1).astype(np.float32)


def _scan_steps(cell_m: float) -> np.ndarray:
    """Return [D] float32 the distances in nodes at which the horizon is sampled, growing with the distance."""
    steps = [1.0]
    while steps[-1] * cell_m < SKY_REACH_M:
        steps.append(max(steps[-1] + 1.0, steps[-1] * 1.15))
    return np.array(steps, np.float32)


@kernel(fastmath=False)
def horizon_sky(out, solid, leafy, cell, steps, compass, first, last):
    """Fill the rows first to last of out [R, C] float32 with the free share of the sky over each node of solid [R, C].

    The share is weighted by the cosine to the vertical. Under a sky of uniform radiance, a level surface receives the
    mean over azimuth of cos² of the horizon's elevation.
    What leafy [R, C] hides above the solid horizon still transmits `CROWN_GAPS`. Heights and `cell` are in metres.
    """
    rows, columns = solid.shape
    for i in range(first, last):
        for j in range(columns):
            total = f4(0.0)
            for a in range(len(compass)):
                east, north = compass[a, 0], compass[a, 1]
                # Tangents of the highest elevation angles seen so far; the horizon is never below level.
                ground = f4(0.0)
                crown = f4(0.0)
                for k in range(len(steps)):
                    x = int(f4(j) + steps[k] * east + f4(0.5))
                    y = int(f4(i) + steps[k] * north + f4(0.5))
                    # Outside the map the horizon is taken to be no higher than within it.
                    if x < 0 or y < 0 or x >= columns or y >= rows:
                        break
                    ground = max(ground, (solid[y, x] - solid[i, j]) / (steps[k] * cell))
                    crown = max(crown, (leafy[y, x] - solid[i, j]) / (steps[k] * cell))
                # cos² of the elevation angle with tangent t is 1 / (1 + t²).
                open_sky = f4(1.0) / (f4(1.0) + ground * ground)
                over_crowns = f4(1.0) / (f4(1.0) + max(ground, crown) ** 2)
                total += over_crowns + f4(CROWN_GAPS) * (open_sky - over_crowns)
            out[i, j] = total / f4(AZIMUTHS)


def _upsampled(coarse: np.ndarray, shape: tuple[int, int], stride: int) -> np.ndarray:
    """Return [GY, GX] float32 a map given at every stride-th node, with linear interpolation between them."""
    for axis in (0, 1):
        at = np.minimum(np.arange(shape[axis], dtype=np.float32) / f4(stride), f4(coarse.shape[axis] - 1))
        low = np.minimum(at.astype(np.int64), coarse.shape[axis] - 1)
        high = np.minimum(low + 1, coarse.shape[axis] - 1)
        share = (at - low).astype(np.float32).reshape((-1, 1) if axis == 0 else (1, -1))
        coarse = np.take(coarse, low, axis) * (f4(1.0) - share) + np.take(coarse, high, axis) * share
    return coarse
