"""The solids that props are made of: a table of parts for each kind, in the prop's own frame.

A part is a sphere, a cube or a cone of side two, stretched, turned, and hung on a joint that moves with the phase. The
frame has x ahead, y to the left and z up from the water's surface, in metres.
"""

from typing import Any

import numpy as np

from thalweg.render.records.props import PropKind

SPHERE, CUBE, CONE = range(3)
"""Solids: x² + y² + z² <= 1; |x|, |y|, |z| <= 1; |z| <= 1 around the z axis, of radius 1 at the foot and `TAPER` at the
top."""
FIXED, LEFT_ARM, RIGHT_ARM, PADDLE, ON_LAND = range(5)
"""Joints: none; an arm that circles upright; a paddle that dips left and right; none, but standing on the ground."""

# Columns of PARTS: the solid, its joint, where it hangs, its middle from there, half its size, and its turn.
SHAPE, TAPER, JOINT, PIVOT_X, PIVOT_Y, PIVOT_Z, OFFSET_X, OFFSET_Y, OFFSET_Z = range(9)
HALF_X, HALF_Y, HALF_Z, TURN = range(9, 13)
"""`TURN` is the first of nine columns: what the part's turn makes of the unit vectors along x, y and z."""
# Reflectance, and that of stripes across an axis of the solid: how many, where the first begins, and their share. Then
# gloss, and the share of the light that the part stops.
RED, GREEN, BLUE, STRIPE_R, STRIPE_G, STRIPE_B, AXIS, STRIPES, SHIFT, DUTY, GLOSS, OPACITY = range(21, 33)
MODEL_COLUMNS = 33

SKIN, DARK, WHITE = (0.62, 0.38, 0.26), (0.025, 0.027, 0.03), (0.80, 0.80, 0.78)
ORANGE, YELLOW, SCARLET = (0.95, 0.26, 0.02), (0.90, 0.62, 0.02), (0.78, 0.035, 0.03)
BLADE, STEEL, CONCRETE, ROOF = (0.85, 0.72, 0.10), (0.36, 0.37, 0.38), (0.44, 0.43, 0.40), (0.13, 0.12, 0.115)
GREEN_DOOR, FOAM = (0.05, 0.16, 0.10), (0.80, 0.82, 0.83)

Triple = tuple[float, float, float]


def part(
    shape: int,
    at: Triple,
    half: Triple,
    colour: Triple,
    *,
    taper: float = 1.0,
    joint: int = FIXED,
    pivot: Triple = (0.0, 0.0, 0.0),
    turns: Triple = (0.0, 0.0, 0.0),
    stripes: tuple[Triple, int, int, float, float] = (DARK, 0, 0, 0.0, 0.0),
    gloss: float = 0.0,
    opacity: float = 1.0,
) -> list[float]:
    """Return a row of `PARTS`.

    turns: roll about x, then pitch about y (positive: down ahead), then yaw about z, in radians. stripes: their colour,
    axis, number, shift and share.
    """
    colour_2, axis, count, shift, duty = stripes
    looks = [*colour, *colour_2, axis, count, shift, duty, gloss, opacity]
    return [shape, taper, joint, *pivot, *at, *half, *turn_matrix(*turns).T.ravel(), *looks]


def turn_matrix(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Return the matrix [3, 3] of a turn about x, then about y, then about z."""
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (np.cos, np.sin))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def arm(side: int, joint: int) -> list[float]:
    """Return a swimmer's arm, which circles about the shoulder."""
    return part(SPHERE, (0.33, 0.0, 0.0), (0.36, 0.06, 0.06), SKIN, joint=joint, pivot=(0.34, side * 0.2, 0.04))


# The parts that the water mirrors, and that are drawn from afar, come first.
SWIMMER: list[list[float]] = [
    part(SPHERE, (-1.80, 0.25, 0.11), (0.36, 0.19, 0.17), ORANGE, stripes=(DARK, 0, 1, -0.45, 0.10), gloss=0.25),
    part(SPHERE, (0.56, 0.0, 0.09), (0.125, 0.105, 0.125), SCARLET, gloss=0.2),
    part(SPHERE, (0.10, 0.0, -0.02), (0.46, 0.22, 0.11), SKIN, gloss=0.1),
    part(SPHERE, (0.62, 0.0, 0.04), (0.09, 0.085, 0.09), SKIN),
    part(SPHERE, (-0.36, 0.0, -0.02), (0.24, 0.17, 0.10), DARK),
    arm(1, LEFT_ARM),
    arm(-1, RIGHT_ARM),
    part(SPHERE, (-0.78, 0.10, -0.045), (0.36, 0.075, 0.075), SKIN, gloss=0.1),
    part(SPHERE, (-0.78, -0.10, -0.045), (0.36, 0.075, 0.075), SKIN, gloss=0.1),
    part(SPHERE, (-1.22, 0.08, 0.0), (0.26, 0.17, 0.05), FOAM, opacity=0.4),
]
HANDS = (0.25, 0.0, 0.58)
"""Middle of the paddle."""
KAYAK: list[list[float]] = [
    part(SPHERE, (0.0, 0.0, 0.04), (2.1, 0.33, 0.22), SCARLET, stripes=(WHITE, 0, 1, -0.80, 0.06), gloss=0.3),
    part(SPHERE, (-0.22, 0.0, 0.52), (0.17, 0.24, 0.33), YELLOW),
    part(SPHERE, (-0.205, 0.0, 1.05), (0.125, 0.115, 0.10), WHITE, gloss=0.2),
    part(SPHERE, (-0.20, 0.0, 0.99), (0.115, 0.10, 0.14), SKIN),
    part(SPHERE, (-0.10, 0.0, 0.235), (0.50, 0.26, 0.06), DARK),
    part(SPHERE, (0.02, 0.30, 0.60), (0.27, 0.065, 0.065), DARK, turns=(0.0, 0.30, 0.35)),
    part(SPHERE, (0.02, -0.30, 0.60), (0.27, 0.065, 0.065), DARK, turns=(0.0, 0.30, -0.35)),
    part(CONE, (0.0, 0.0, 0.0), (0.018, 0.018, 0.95), DARK, joint=PADDLE, pivot=HANDS, turns=(np.pi / 2, 0.0, 0.0)),
    part(SPHERE, (0.0, 1.05, 0.0), (0.03, 0.24, 0.10), BLADE, joint=PADDLE, pivot=HANDS),
    part(SPHERE, (0.0, -1.05, 0.0), (0.03, 0.24, 0.10), BLADE, joint=PADDLE, pivot=HANDS),
]
BUOY: list[list[float]] = [
    part(CONE, (0.0, 0.0, 0.72), (0.52, 0.52, 0.52), YELLOW, taper=0.15, gloss=0.25),
    part(CONE, (0.0, 0.0, 0.06), (0.50, 0.50, 0.16), YELLOW, taper=1.0, stripes=(DARK, 2, 1, 0.0, 0.50), gloss=0.25),
    part(CUBE, (0.0, 0.0, 1.72), (0.05, 0.34, 0.055), YELLOW, turns=(np.pi / 4, 0.0, 0.0), gloss=0.2),
    part(CUBE, (0.0, 0.0, 1.72), (0.05, 0.34, 0.055), YELLOW, turns=(-np.pi / 4, 0.0, 0.0), gloss=0.2),
    part(CONE, (0.0, 0.0, 1.38), (0.035, 0.035, 0.30), STEEL, gloss=0.2),
]
STATION_KIND = int(PropKind.STATION)
HUT_M = 2.6
"""How far the hut stands behind the staff."""
STATION: list[list[float]] = [
    part(CUBE, (-HUT_M, 0.0, 1.15), (0.85, 0.85, 1.15), CONCRETE, joint=ON_LAND),
    part(CUBE, (-HUT_M, 0.0, 2.34), (1.05, 1.05, 0.10), ROOF, joint=ON_LAND),
    part(CUBE, (0.0, 0.0, 0.75), (0.03, 0.19, 1.15), WHITE, stripes=(DARK, 2, 6, 0.0, 0.5), gloss=0.1),
    part(CUBE, (-HUT_M, 0.0, -0.9), (0.97, 0.97, 1.0), ROOF, joint=ON_LAND),
    part(CUBE, (-HUT_M + 0.84, 0.25, 0.98), (0.04, 0.36, 0.88), GREEN_DOOR, joint=ON_LAND),
    part(CUBE, (-HUT_M + 0.84, -0.48, 1.45), (0.03, 0.20, 0.24), DARK, joint=ON_LAND, gloss=0.5),
    part(CONE, (-0.10, 0.0, 0.6), (0.06, 0.06, 1.35), STEEL),
    part(CONE, (-HUT_M - 0.5, 0.5, 3.1), (0.03, 0.03, 0.8), STEEL, joint=ON_LAND),
]
MODELS: dict[PropKind, list[list[float]]] = {
    PropKind.SWIMMER: SWIMMER,
    PropKind.KAYAK: KAYAK,
    PropKind.BUOY: BUOY,
    PropKind.STATION: STATION,
}

PARTS = np.array([row for model in MODELS.values() for row in model], np.float32)
"""[parts, MODEL_COLUMNS], of all kinds in their order."""
MOST_PARTS = max(map(len, MODELS.values()))
# Columns of KINDS: the first part and the one after the last; how many of them are the main ones; the ball around all,
# by the height of its middle and its radius; amplitudes of bobbing (metres), roll and pitch (radians); half the length
# and half the width of the hull from which waves spread, their slope, and their reach.
FIRST, LAST, MAIN, MIDDLE, RADIUS, BOB, ROCK_ROLL, ROCK_PITCH, HULL_LENGTH, HULL_WIDTH, WAVE, WAVE_REACH = range(12)
KIND_COLUMNS = 12


def kind_table() -> np.ndarray:
    """Return `KINDS`, [kinds, KIND_COLUMNS] float32."""
    motion: dict[PropKind, tuple[float, ...]] = {
        # main, middle, radius, bob, roll, pitch, length, width, wave, reach
        PropKind.SWIMMER: (3, 0.1, 2.2, 0.02, 0.22, 0.0, 0.9, 0.15, 0.16, 1.6),
        PropKind.KAYAK: (3, 0.4, 2.3, 0.02, 0.03, 0.015, 1.7, 0.22, 0.12, 1.6),
        PropKind.BUOY: (4, 0.9, 1.3, 0.04, 0.07, 0.05, 0.0, 0.45, 0.07, 1.0),
        PropKind.STATION: (3, 1.5, 5.5, 0.0, 0.0, 0.0, 0.0, 0.1, 0.05, 0.8),
    }
    table: Any = np.zeros((len(PropKind), KIND_COLUMNS), np.float32)
    first = 0
    for kind, model in MODELS.items():
        table[kind] = [first, first + len(model), *motion[kind]]
        first += len(model)
    return table


KINDS = kind_table()
"""[kinds, KIND_COLUMNS] float32, by `PropKind`."""
