"""Columns of the tables of a `Scene`, and the units in which light is stored there.

`extents`, `constants`, `plants` and `bridges` are plain arrays, since kernels read them by row and column.
"""

import numpy as np

PAINT_LEVELS = 8
"""Mip levels of the ground's paint."""
QUAY_LEVEL = 2
"""Level of the paint that has the texels of the mask of quays."""
CONE_CELL = 4
"""Nodes a side of a cell of the cone map."""
CANOPY_CELL = 2
"""Nodes a side of a cell of the canopy map that reflections see."""
CANOPY_RANGE_M = 40.0
"""Greatest height above the water that the canopy map holds."""

SUN_RADIANCE = np.array([1.0, 0.945, 0.845])
"""Radiance of a white surface that faces the sun: warm white, which sets the unit of all radiances."""
SKY_RADIANCE = np.array([0.054, 0.066, 0.090])
"""Radiance of a white surface under the whole sky; low, because the original's shadows are deep (strength 0.95)."""
SUN_R, SUN_G, SUN_B = (float(c) for c in SUN_RADIANCE)
SKY_R, SKY_G, SKY_B = (float(c) for c in SKY_RADIANCE)
PAINT_RANGE = 1.25
"""Greatest radiance that the paint holds; brighter ground is clipped."""

# Columns of Scene.extents: where each world's tables begin, and their sizes.
GX, GY, MAP_AT, CONE_X, CONE_AT, PAINT_X, PAINT_Y, CANOPY_X, CANOPY_Y, CANOPY_AT = range(10)
PLANT_FROM, PLANT_TO, BRIDGE_FROM, BRIDGE_TO, SKY_AT, ATLAS_AT, SHADE_AT, CLOUD_AT, CHUNK_AT = range(10, 19)
PAINT_AT = 19
QUAY_AT = PAINT_AT + PAINT_LEVELS
EXTENT_COLUMNS = QUAY_AT + 1
# Columns of Scene.constants. Of top and depth: the metres that code 0 stands for, and those from one code to the next.
# The slope of the walls of quays is 0 in a world without any.
ORIGIN_X, ORIGIN_Y, INV_CELL, TOP_MAX, SUN_X, SUN_Y, SUN_Z, FOG_R, FOG_G, FOG_B, SUN_EAST, SUN_NORTH = range(12)
TOP_BASE, TOP_STEP, DEPTH_BASE, DEPTH_STEP = range(12, 16)
QUAY_SLOPE = 16
CONSTANT_COLUMNS = 17
# Columns of Scene.plants: foot in metres, height, half width, kind, tint, share of sun at foot and top, rank in 0..1.
P_X, P_Y, P_Z, P_HEIGHT, P_HALF, P_KIND, P_R, P_G, P_B, P_LOW, P_HIGH, P_RANK = range(12)
PLANT_COLUMNS = 12
CHUNK = 16
"""Plants of a chunk: those of a world lie in its table by chunks that stand close together."""
# Columns of Scene.bridges: middle, direction of the axis, then lengths and heights in metres.
B_X, B_Y, B_COS, B_SIN, B_HALF_LENGTH, B_HALF_WIDTH, B_SPAN, B_SPRING, B_RISE, B_DECK, B_HUMP, B_PARAPET = range(12)
BRIDGE_COLUMNS = 12
