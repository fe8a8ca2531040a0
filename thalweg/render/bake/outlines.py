"""Outlines of the pictures of an atlas: how far each reaches to either side, by bands of its height.

They let a frame leave out the parts of a billboard that show nothing. An outline is in the coordinates of billboards: u
from -1 to 1 across, where column 0 is at u = 1, and v from 0 at the foot to 1 at the top.
"""

from functools import cache

import numpy as np

from thalweg.render.bake.impostors import LEVELS, VIEWS, Atlas, cols, remembered, rows, sun_steps
from thalweg.world.species import KINDS

BANDS = 16
"""Bands of a picture's height, each with its own reach."""


def of_sun(sun_elevation: float) -> np.ndarray:
    """Return `of_atlas` for a height of the sun in radians [kinds * VIEWS * LEVELS, 2 * BANDS] float32; read-only."""
    return _of_steps(sun_steps(sun_elevation))


@cache
def _of_steps(steps: int) -> np.ndarray:
    found = of_atlas(remembered(steps))
    found.setflags(write=False)
    return found


def of_atlas(atlas: Atlas) -> np.ndarray:
    """Return the outlines [kinds * VIEWS * LEVELS, 2 * BANDS] float32: least and greatest u of each band in turn.

    What is interpolated between texels is empty outside. An empty band has least 2 and greatest -2.
    """
    result = np.empty((len(KINDS) * VIEWS, LEVELS, BANDS, 2), np.float32)
    for level in range(LEVELS):
        size = rows(level) * cols(level)
        begin = int(atlas.offset[level])
        texels = atlas.texels[begin : begin + len(result) * size, 3]
        result[:, level] = outlines(texels.reshape(len(result), rows(level), cols(level)) > 0)
    return result.reshape(-1, 2 * BANDS)


def outlines(filled: np.ndarray) -> np.ndarray:
    """Return the least and greatest u [P, BANDS, 2] of pictures [P, rows, columns], true where a texel is not empty."""
    _, high, wide = filled.shape
    row, column = np.arange(high), np.arange(wide)
    # A texel is seen up to the middles of its neighbours; the last but one to the edge, where it keeps a thousandth.
    low = (row - 0.5) / high
    top = np.where(row >= high - 2, 1.0, (row + 1.5) / high)
    right = np.where(column >= wide - 2, -1.0, 1 - (column + 1.5) * 2 / wide)
    left = 1 - (column - 0.5) * 2 / wide
    least = np.where(filled, right, 2.0).min(-1)
    greatest = np.where(filled, left, -2.0).max(-1)
    result = np.empty((len(filled), BANDS, 2))
    for band in range(BANDS):
        touching = (low < (band + 1) / BANDS) & (top > band / BANDS)
        result[:, band, 0] = least[:, touching].min(1)
        result[:, band, 1] = greatest[:, touching].max(1)
    # A billboard ends at its edges; empty bands keep their order, by which they are known.
    empty = result[..., :1] > result[..., 1:]
    return np.where(empty, result, np.clip(result, -1, 1))
