"""Tests of the mask of quays, on a straight river of 60 m along the x axis that is 8 m wide."""

import numpy as np
import pytest

from thalweg.render.bake.quay_mask import quay_mask, quay_share
from thalweg.render.bake.scene_tables import build_scene
from thalweg.render.records import layout
from thalweg.world import World


def straight(banks: str) -> World:
    x = np.linspace(0.0, 60.0, 16)
    line = np.stack([x, 0 * x, 0 * x, 0 * x + 8.0], axis=1)
    return World.from_centerline(line, False, plants=False, banks=banks)


def red_at(mask: np.ndarray, world: World, x: float, y: float) -> int:
    """The mask at the texel around a place."""
    side = world.grid.cell_m * 2**layout.QUAY_LEVEL
    return int(mask[int((y - world.grid.origin_y_m) / side), int((x - world.grid.origin_x_m) / side)])


@pytest.mark.parametrize(("x", "y", "red"), [(30, 6, 255), (25, 12, 255), (30, -6, 0), (10, 6, 0), (50, 6, 0)])
def test_the_mask_is_that_of_the_bank_and_of_the_reach(x: float, y: float, red: int):
    world = straight("meadow+quay_20-40_left")
    rows, columns = (-(-size // 128) * 128 >> layout.QUAY_LEVEL for size in world.ground_m.shape)
    mask = quay_mask(world, (rows, columns))
    assert mask.shape == (rows, columns) and red_at(mask, world, x, y) == red


def test_it_stands_behind_the_paint_of_its_world():
    quay, meadow = straight("quay_20-40"), straight("meadow")
    scene = build_scene([meadow, quay, quay])
    extent, begin = scene.extents[1], scene.extents[1:, layout.QUAY_AT]
    shape = extent[layout.PAINT_Y] >> layout.QUAY_LEVEL, extent[layout.PAINT_X] >> layout.QUAY_LEVEL
    assert begin[0] == scene.extents[1, layout.PAINT_AT + layout.PAINT_LEVELS - 1] + (extent[layout.PAINT_Y] >> 7) * (
        extent[layout.PAINT_X] >> 7
    )
    for first in begin:
        found = scene.paint[first : first + shape[0] * shape[1]].reshape(shape)
        np.testing.assert_array_equal(found, quay_mask(quay, shape))
    assert scene.extents[2, layout.PAINT_AT] == begin[0] + shape[0] * shape[1]


def test_a_quay_that_later_reaches_cover_is_nowhere():
    assert not quay_share(straight("quay_20-40+meadow_10-50")).any()
