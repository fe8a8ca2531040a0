"""Kernel for the stone of quays: the courses of the wall, its coping, and the slabs behind it.

The map of paint has a node each quarter of a metre, seen from above, which is too coarse for a wall. What a pixel shows
of a quay follows from its height above the water and from the slope there: the wall is as steep as `QUAY_SLOPE`, or a
little less on a coarse map, and the pavement rises by `QUAY_FALL` towards the land, so that its height says how far it
is from the edge. Other banks may be as steep: a mask tells where quays are, see `thalweg.render.bake.quay_mask`. Stone
gets the sun of the pavement behind the edge, since the baked shares of nodes on the wall are those of single points of
it.

Only worlds that have quays pay for this.
"""

import math

import numpy as np
from numba import int32, uint32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.bridge_stone import masonry
from thalweg.render.kernels.shading.ground import tile_grain
from thalweg.render.kernels.table_lookup import clamp, depth_map, paint_level, sloped
from thalweg.render.records import layout
from thalweg.world.banks import QUAY_COPING_M, QUAY_FALL, QUAY_PAVED_M, QUAY_WALL_M

f32 = np.float32

STONE = (0.250, 0.228, 0.188)
"""Reflectance of the wall's stone in red, green and blue, and of the coping's."""
COPING = (0.375, 0.355, 0.315)
SLIME = (0.072, 0.070, 0.050)
"""Reflectance of the algae on the foot of the wall."""
SLIME_M = 0.32
"""Height above the water to which algae grow."""
SLIME_EDGE, SLIME_RAGGED, SLIME_MOST = 5.0, 0.4, 0.9
"""Change of their cover per metre of height, that by the tone of a block, and their greatest cover."""
TOP_M = 0.05
"""Height above the wall's from which nothing is wall."""
BETWEEN_M = 0.16
"""Height in the middle of a course, where there is no joint along it."""
COPING_HIGH_M = 0.20
"""Height of the coping's face."""
COPING_LONG = 0.45
"""Length of a block of the wall over that of a stone of the coping."""
SLAB = 0.55
"""Size of a block of the wall over that of a slab of the pavement."""
SLAB_CONTRAST = 0.85
"""Contrast of the slabs, as a share of the wall's."""
GRAIN_M = 1.9
"""Side of the tile of grain on the stone."""
GRAIN_DEPTH = 0.13
"""Contrast of that grain."""
SUN_INLAND_M = 0.45
"""Distance towards the land from which the stone takes its share of the sun."""
WALL_SHARES = (0.35, 0.65)
"""Slopes, as shares of the wall's, between which ground becomes wall."""
FLAT_SHARES = (0.5, 1.6)
"""Slopes, as shares of the pavement's, between which ground is pavement."""
FADE_FROM_M, FADE_TO_M = 0.25, 0.60
"""Sizes of a pixel between which stones give way to the paint of the map."""
MASK_FULL = 250.0
"""Number of the mask at which ground is wholly that of a quay; a little less than its greatest, for rounding."""
OPEN_SKY = 0.62
"""Share of the sky's light that reaches a wall, and the radiance of white stone under what water reflects up to it."""
BOUNCE = 0.035


@kernel(disjoint=True, allocates=False)
def shade_quays(scene, view, points, pixel, out, n):
    """Replace the ground's `Radiance` [n] at `HitPoints` by that of stone where a quay is; pixel: height of a pixel at
    distance one."""
    x, y, _, _, _, _, distance = points
    red, green, blue = out
    number = scene.constants
    w = view.world
    heights = depth_map(scene, w)
    inv_cell = number[w, layout.INV_CELL]
    cell = f32(1) / inv_cell
    steepest = number[w, layout.QUAY_SLOPE]
    columns = int32(scene.extents[w, layout.PAINT_X])
    rows = int32(scene.extents[w, layout.PAINT_Y])
    mask = int32(scene.extents[w, layout.QUAY_AT])
    begin = int32(scene.extents[w, uint32(int32(layout.PAINT_AT) + int32(1))])
    sun_x = number[w, layout.SUN_X]
    sun_y = number[w, layout.SUN_Y]
    sun_z = number[w, layout.SUN_Z]
    for i in range(n):
        depth, fall_x, fall_y = sloped(heights, x[i], y[i])
        rise_x = -fall_x * inv_cell
        rise_y = -fall_y * inv_cell
        steep = math.sqrt(rise_x * rise_x + rise_y * rise_y) + f32(1e-6)
        height = -depth
        over = height - f32(QUAY_WALL_M)
        wall = clamp(
            (steep - f32(WALL_SHARES[0]) * steepest) / (f32(WALL_SHARES[1] - WALL_SHARES[0]) * steepest), f32(0), f32(1)
        )
        wall = wall if over < f32(TOP_M) else f32(0)
        # How far past the edge a point of the pavement is.
        past = over * f32(1 / QUAY_FALL)
        flat = (steep > f32(FLAT_SHARES[0] * QUAY_FALL)) & (steep < f32(FLAT_SHARES[1] * QUAY_FALL))
        paved = flat & (past > f32(-0.1)) & (past < f32(QUAY_PAVED_M))
        on_top = paved & (past < f32(QUAY_COPING_M))
        # Along the wall by the axis that it follows more.
        along = (x[i] if abs(rise_y) > abs(rise_x) else y[i]) * cell
        foot = distance[i] * pixel
        up = height if wall > f32(0) else f32(BETWEEN_M)
        high = (over > f32(-COPING_HIGH_M)) | on_top
        blocks = masonry(along, up, foot)
        stones = masonry(along * f32(COPING_LONG), f32(BETWEEN_M), foot)
        tone = stones if high else blocks
        grain = tile_grain(scene.ripples, along, past if paved else height, foot, f32(GRAIN_M))
        tone *= max(f32(1) + f32(GRAIN_DEPTH) * grain, f32(0.2))
        ragged = f32(SLIME_RAGGED) * (blocks - f32(1))
        slime = clamp((f32(SLIME_M) - height) * f32(SLIME_EDGE) + ragged, f32(0), f32(SLIME_MOST))
        slime = f32(0) if high else slime

        inland = f32(SUN_INLAND_M) * inv_cell / steep
        _, _, _, share = paint_level(
            scene.paint, begin, columns, rows, x[i] + rise_x * inland, y[i] + rise_y * inland, int32(1)
        )
        up_z = f32(1) / math.sqrt(f32(1) + steep * steep)
        facing = max((sun_z - rise_x * sun_x - rise_y * sun_y) * up_z, f32(0))
        direct = share * f32(1 / 255.0) * facing
        sky = f32(OPEN_SKY) + f32(1 - OPEN_SKY) * up_z
        stone_r = (f32(COPING[0]) if high else f32(STONE[0])) * tone
        stone_g = (f32(COPING[1]) if high else f32(STONE[1])) * tone
        stone_b = (f32(COPING[2]) if high else f32(STONE[2])) * tone
        light_r = direct * f32(layout.SUN_R) + sky * f32(layout.SKY_R) + f32(BOUNCE)
        light_g = direct * f32(layout.SUN_G) + sky * f32(layout.SKY_G) + f32(BOUNCE)
        light_b = direct * f32(layout.SUN_B) + sky * f32(layout.SKY_B) + f32(BOUNCE)
        stone_r = (stone_r + (f32(SLIME[0]) - stone_r) * slime) * light_r
        stone_g = (stone_g + (f32(SLIME[1]) - stone_g) * slime) * light_g
        stone_b = (stone_b + (f32(SLIME[2]) - stone_b) * slime) * light_b
        # Other banks may be as steep, and as flat.
        belongs, _, _, _ = paint_level(scene.paint, mask, columns, rows, x[i], y[i], int32(layout.QUAY_LEVEL))
        belongs = clamp(belongs * f32(1 / MASK_FULL), f32(0), f32(1))
        # Far away, where stones are smaller than a pixel, the paint's prefiltered colours stay.
        near = belongs * clamp((f32(FADE_TO_M) - foot) * f32(1 / (FADE_TO_M - FADE_FROM_M)), f32(0), f32(1))
        covered = near if on_top else wall * near
        contrast = f32(SLAB_CONTRAST) * belongs
        slabs = f32(1) + contrast * (masonry(along * f32(SLAB), past * f32(SLAB), foot * f32(SLAB)) - f32(1))
        slabs = slabs if paved else f32(1)
        red[i] = red[i] * slabs + (stone_r - red[i] * slabs) * covered
        green[i] = green[i] * slabs + (stone_g - green[i] * slabs) * covered
        blue[i] = blue[i] * slabs + (stone_b - blue[i] * slabs) * covered
