"""Props: what stands or moves in a world for a task and is drawn per frame, as rows of numbers.

A frame has P rows; `PropKind.NONE` marks a row that draws nothing. Nothing of a prop is baked into a world, so that a
task can move its props at each step.
"""

import math
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike

from thalweg.core.compute.jit import kernel
from thalweg.render.errors import RenderError
from thalweg.render.records import classes

KIND, X, Y, Z, YAW, PHASE = range(6)
"""Columns of a row: a `PropKind`; position in metres, z being the water's level there; the direction in which the prop
points, in radians; and the phase of its motion (arms, bobbing) in radians."""
PROP_COLUMNS = 6
MOST_PROPS = 64
"""Most props of a frame."""


class PropKind(IntEnum):
    """What a row of props draws. A pixel of a kind has the class of the same name."""

    NONE = 0
    """Nothing: the other columns of the row do not matter."""
    SWIMMER = 1
    """A swimmer who crawls towards `YAW`, with an orange tow buoy behind; `PHASE` turns the arms."""
    KAYAK = 2
    """A kayak with a paddler, 4.2 m long, heading towards `YAW`; `PHASE` swings the paddle."""
    BUOY = 3
    """A yellow conical buoy with a cross on top, which marks a reserve; `PHASE` rocks it."""
    STATION = 4
    """A gauge station at a bank: a staff in the water at x, y and a hut on the land 2.6 m behind; `YAW` points from
    the hut to the staff, towards the open water."""


LAST_KIND = int(max(PropKind))
CLASS_OFFSET = classes.SWIMMER - PropKind.SWIMMER
"""The class of a prop is its kind plus this."""
NO_PROPS = np.zeros((1, 0, PROP_COLUMNS), np.float32)
"""The props of any number of frames that have none."""


def checked_props(props: ArrayLike | None, count: int) -> np.ndarray:
    """Return the props of `count` frames as an array [N, P, PROP_COLUMNS] float32; None is `NO_PROPS`.

    Raises `RenderError` for another shape, more than `MOST_PROPS`, an unknown kind, or a number that is not finite.
    """
    if props is None:
        return NO_PROPS
    rows = np.array(props, np.float32, order="C")
    if rows.ndim != 3 or rows.shape[0] != count or rows.shape[2] != PROP_COLUMNS:
        raise RenderError(
            f"props have shape {list(rows.shape)}; they must be [{count}, P, {PROP_COLUMNS}]: one list for each pose,"
            " of kind, x, y, z, yaw, phase"
        )
    if rows.shape[1] > MOST_PROPS:
        raise RenderError(f"{rows.shape[1]} props a frame: at most {MOST_PROPS} can be drawn")
    if not are_drawable(rows):
        _raise_undrawable(rows)
    return rows if rows.shape[1] else NO_PROPS


@kernel(fastmath=False, allocates=False)
def are_drawable(rows):
    """Return whether all numbers of props [N, P, PROP_COLUMNS] are finite and all kinds known."""
    for n in range(rows.shape[0]):
        for p in range(rows.shape[1]):
            for column in range(rows.shape[2]):
                if not math.isfinite(rows[n, p, column]):
                    return False
            kind = rows[n, p, KIND]
            if kind < 0 or kind > LAST_KIND or kind != math.floor(kind):
                return False
    return True


def _raise_undrawable(rows: np.ndarray) -> None:
    """Raise `RenderError` that names the first number of props [N, P, PROP_COLUMNS] that `are_drawable` refuses."""
    if not np.isfinite(rows).all():
        frame, row, column = np.argwhere(~np.isfinite(rows))[0]
        raise RenderError(f"props[{frame}, {row}, {column}] is {rows[frame, row, column]}; it must be finite")
    frame, row = np.argwhere(~np.isin(rows[..., KIND], list(PropKind)))[0]
    kinds = ", ".join(f"{kind.value} {kind.name}" for kind in PropKind)
    raise RenderError(f"props[{frame}, {row}] has kind {rows[frame, row, KIND]:g}; it must be one of {kinds}")
