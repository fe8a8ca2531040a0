"""`Scene`: the flat, prefiltered tables of several worlds that kernels read.

Colours are square-root coded, eight bits a channel, and packed into one uint32 (red lowest), so that one gather fetches
all of them. `thalweg.render.bake.scene_tables` makes the tables.
"""

from typing import NamedTuple

import numpy as np

f32 = np.float32


class Scene(NamedTuple):
    """Tables of W worlds. Each is flat, with one world's part after another's."""

    extents: np.ndarray
    """[W, EXTENT_COLUMNS] int32, where each world's tables begin, and their sizes."""
    constants: np.ndarray
    """[W, CONSTANT_COLUMNS] float32: grid, sun and haze of each world."""
    top: np.ndarray
    """[nodes] uint32, height of the upper surface, water or ground: the code of a node in the lower 16 bits and that of
    the next one in y in the upper. So two neighbouring numbers hold the four nodes around a point."""
    depth: np.ndarray
    """[nodes] uint32, water's surface minus ground, in the same way; positive where wet."""
    cone: np.ndarray
    """[2 * cells] float32, height and slope in turn, since both are read together. No surface within a cell or its
    eight neighbours is higher than the height, and none at a horizontal distance d is higher than
    height + slope * d."""
    paint: np.ndarray
    """[texels] uint32, radiance of the lit ground and, in the top byte, the share of sun; all levels. In a world with
    quays their mask follows, see `thalweg.render.bake.quay_mask`."""
    canopy: np.ndarray
    """[cells] uint32, heights of plants, bridges and ground above the water: of a cell and the next ones in x, in y and
    in both; see `thalweg.render.bake.canopy`."""
    canopy_paint: np.ndarray
    """[cells] uint32, radiance of what a reflection meets there, and the height of the plant there in the top byte."""
    plants: np.ndarray
    """[M, PLANT_COLUMNS] float32."""
    bridges: np.ndarray
    """[B, BRIDGE_COLUMNS] float32."""
    sky: np.ndarray
    """[W * sky.ROWS * sky.COLUMNS] uint32, square-root coded over sky.CODE_RANGE."""
    clouds: np.ndarray
    """[W * clouds.SIDE²] uint32, see `thalweg.render.bake.clouds`."""
    ripples: np.ndarray
    """[texels] uint32, see `thalweg.render.bake.ripples`."""
    atlas: np.ndarray
    """[texels] uint32, impostors for each distinct height of the sun."""
    atlas_level: np.ndarray
    """[levels] int64, where each level of an atlas begins."""
    shade: np.ndarray
    """[kinds * views, 3] float32, see `thalweg.render.bake.impostors.Atlas.shade`."""
    outlines: np.ndarray
    """[kinds * views * levels, 2 * BANDS] float32, see `thalweg.render.bake.outlines`."""
    chunks: np.ndarray
    """[C, 4] float32, spheres around `layout.CHUNK` plants each: middle and radius in metres."""
    autumn: np.ndarray
    """[kinds, 3] float32, factors on a plant's colour in full autumn."""


def blank_scene() -> Scene:
    """Return a scene of empty tables with the types of any scene, so that kernels can compile before a world exists."""
    types = {"extents": (np.int32, 2), "atlas_level": (np.int64, 1)}
    types |= dict.fromkeys(("constants", "plants", "bridges", "shade", "outlines", "chunks", "autumn"), (f32, 2))
    packed = "top", "depth", "paint", "canopy", "canopy_paint", "sky", "clouds", "ripples", "atlas"
    types |= dict.fromkeys(packed, (np.uint32, 1))
    blank = {name: np.zeros((1,) * rank, kind) for name, (kind, rank) in types.items()}
    return Scene(**{name: blank.get(name, np.zeros(1, f32)) for name in Scene._fields})
