"""Ripples under wind: how steep they are, and where they go."""

import math
from typing import Any

from thalweg.render.records.appearance import (
    DRIFT_A_M_PER_S,
    DRIFT_A_X,
    DRIFT_A_Y,
    DRIFT_B_M_PER_S,
    DRIFT_B_X,
    DRIFT_B_Y,
    LIMITS,
    RIPPLE,
    RIPPLE_1,
)

CALM_SLOPE, SLOPE_PER_WIND = 0.003, 0.00512
"""Mean square slope of a water surface without wind, and what a metre a second of wind adds: Cox, Munk, "Measurement of
the Roughness of the Sea Surface from Photographs of the Sun's Glitter", 1954."""
USUAL_SLOPE = 0.005
"""Mean square slope of the ripples of the default look."""
SPREAD = 0.35
"""Radians by which the two layers move to the left and to the right of the wind."""
STEEPEST = RIPPLE_1 * LIMITS["ripple"][1]


def ruffle(rows: Any, east: Any, north: Any) -> None:
    """Change rows [N, LOOK_COLUMNS] of looks, arrays or tensors, to those of water under a wind [N], [N] in m/s.

    Ripples grow with the wind and move with it, as fast as without; no wind changes nothing.
    """
    speed = (east**2 + north**2) ** 0.5
    calm = speed == 0
    growth = ((CALM_SLOPE + SLOPE_PER_WIND * speed) / USUAL_SLOPE) ** 0.5
    rows[:, RIPPLE] = (rows[:, RIPPLE] * (calm + ~calm * growth)).clip(max=STEEPEST)
    x, y = east / (speed + calm), north / (speed + calm)
    cos, sin = math.cos(SPREAD), math.sin(SPREAD)
    # A tile that is read against the wind moves with it.
    a, b = -math.hypot(*DRIFT_A_M_PER_S), -math.hypot(*DRIFT_B_M_PER_S)
    ax, ay = a * (cos * x - sin * y), a * (sin * x + cos * y)
    bx, by = b * (cos * x + sin * y), b * (cos * y - sin * x)
    # The axes of the second layer are turned, see `thalweg.render.kernels.shading.water`.
    blown = {DRIFT_A_X: ax, DRIFT_A_Y: ay, DRIFT_B_X: 0.6 * bx + 0.8 * by, DRIFT_B_Y: 0.6 * by - 0.8 * bx}
    for column, velocity in blown.items():
        rows[:, column] = calm * rows[:, column] + ~calm * velocity
