"""Kernels that draw the billboard of one plant: an upright, filtered picture from the atlas that faces the camera."""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import int32, uint32

from thalweg.core.compute.jit import kernel
from thalweg.render.bake import impostors
from thalweg.render.kernels.camera_rays import ray_direction, row_step
from thalweg.render.kernels.fast_math import exp, log2
from thalweg.render.kernels.table_lookup import channel, clamp
from thalweg.render.records import layout
from thalweg.render.records.appearance import HAZE_PER_M, SEASON

f32 = np.float32

SHIFT = 2
SIDE = 1 << SHIFT
"""Samples along each side of a tile, a power of two."""
SAMPLES = SIDE * SIDE
"""Samples of a tile. In the reduced quality a sample stands for two pixels, one below the other."""
SHARPEN = 0.35
"""Levels by which billboards are sampled finer than their size asks for: the original's frames are as crisp."""
CLOSED = 0.02
"""A plant that would leave less than this share of a pixel's light stops all that is left."""
MOST_SHARP = 8.0
"""Upper limit of the sharpness of a near plant's edges."""
BLEND_M = 10.0
"""Within this distance low plants and rocks fade from one of their views to the next, instead of changing at once."""
BLEND_FADE_M = 3.0
"""Distance over which that begins, so that it does not begin at once either."""
BLEND_HEIGHT_M = 4.0
"""What is higher than this is a tree, whose views do not fade."""
BLEND_ZONE = 0.25
"""Part of the angle between two views, to either side of the middle between them, over which they fade."""
BLEND_SHARP = 6.0
"""How much sharper edges are per share of a neighbouring view, so that what only one of the views covers is seldom half
there."""
EDGE = math.tan(math.pi / 8)
"""Slope of the line between two of the eight views."""
assert impostors.VIEWS == 8


class Billboard(NamedTuple):
    """What all pixels of a plant's billboard share: where it stands, its texels, and how texels become radiance."""

    distance: Any
    """Horizontal metres from the camera."""
    sight_x: Any
    """Horizontal unit vector to the plant, as the next; the billboard's plane is perpendicular to it."""
    sight_y: Any
    foot: Any
    """Height of the plant's foot above the camera in metres."""
    per_height: Any
    """One over the plant's height, and one over half its width."""
    per_half_width: Any
    begin: Any
    """Index of its first texel, an integer, as the next two: columns and rows of its level."""
    columns: Any
    rows: Any
    tint_r: Any
    """Factors on a texel's squared code, haze included."""
    tint_g: Any
    tint_b: Any
    haze_r: Any
    """Radiance of the haze in front of the plant."""
    haze_g: Any
    haze_b: Any
    sun_low: Any
    """Share of the sun at the foot, and how much more of it reaches the top."""
    sun_rise: Any
    shade_r: Any
    """Radiance without direct sun as a share of that in full sun."""
    shade_g: Any
    shade_b: Any
    sharp: Any
    """Sharpness of its edges: the height of a texel in pixels, at least 1; more where two views are seen."""
    blend: Any
    """Share of the neighbouring view in what is seen, 0 to 1/2."""
    step: Any
    """How many views farther in the atlas that view is, an integer."""
    outline: Any
    """Index of its picture's outline in `Scene.outlines`, an integer."""


@kernel(inlined=True, allocates=False)
def atlas_view(sight_x, sight_y, sun_x, sun_y):
    """The view of the atlas for a horizontal direction of sight, with the sun towards sun_x, sun_y.

    As `thalweg.render.bake.impostors.view_of`, by comparisons: an arc tangent would take longer than the rest of what a
    billboard needs.
    """
    along = sight_x * sun_x + sight_y * sun_y
    across = sight_y * sun_x - sight_x * sun_y
    # First the eighth of a turn within a quarter, then the reflections that bring it to the right quarter.
    eighth = int32(1)
    if abs(across) <= abs(along) * f32(EDGE):
        eighth = int32(0)
    elif abs(along) <= abs(across) * f32(EDGE):
        eighth = int32(2)
    eighth = int32(4) - eighth if along < f32(0) else eighth
    eighth = -eighth if across < f32(0) else eighth
    return int32(eighth & int32(impostors.VIEWS - 1))


@kernel(inlined=True, allocates=False)
def neighbouring_view(sight_x, sight_y, sun_x, sun_y, view):
    """The view on the other side of a direction of sight than the nearest one, `view`, and its share of what is seen.

    The share is 0 near the direction of `view` and rises to 1/2 in the middle between the two.
    """
    along = sight_x * sun_x + sight_y * sun_y
    across = sight_y * sun_x - sight_x * sun_y
    turn = f32(math.atan2(across, along)) * f32(impostors.VIEWS / (2 * math.pi)) - f32(view)
    # A view is counted from 0 to 7, an angle from -4 to 4.
    turn = turn + f32(impostors.VIEWS) if turn < f32(-impostors.VIEWS / 2) else turn
    step = int32(1) if turn > f32(0) else int32(-1)
    part = clamp((abs(turn) - f32(0.5 - BLEND_ZONE)) * f32(1 / BLEND_ZONE), f32(0), f32(1))
    # Two parabolas, one from each view, meet in the middle without a bend.
    return int32((view + step) & int32(impostors.VIEWS - 1)), f32(0.5) * part * part


@kernel(inlined=True, allocates=False)
def make_billboard(scene, view, p, distance, sharpen):
    """The `Billboard` of plant p at a horizontal distance in metres.

    sharpen: mip levels by which it is sampled finer than its size asks for.
    """
    camera = view.camera
    plant = scene.plants[p]
    nx = (plant[layout.P_X] - camera.x) / distance
    ny = (plant[layout.P_Y] - camera.y) / distance
    foot = plant[layout.P_Z] - camera.z
    height = plant[layout.P_HEIGHT]
    per_height = f32(1) / height
    per_half_width = f32(1) / plant[layout.P_HALF]

    # The atlas holds the side that the sun lights, on the level whose texels are as large as pixels.
    east = scene.constants[view.world, layout.SUN_EAST]
    side = atlas_view(nx, ny, east, scene.constants[view.world, layout.SUN_NORTH])
    kind = int32(plant[layout.P_KIND])
    ahead = distance * (nx * camera.forward_x + ny * camera.forward_y) + (foot + height * f32(0.5)) * camera.forward_z
    height_px = height / (max(ahead, camera.near_m) * row_step(camera))
    level = int32(clamp(log2(f32(impostors.ROWS) / height_px) - sharpen, f32(0), f32(impostors.LEVELS - 1)))
    rows = int32(impostors.ROWS) >> level
    columns = int32(impostors.COLS) >> level
    begin = int32(scene.extents[view.world, layout.ATLAS_AT] + scene.atlas_level[level])
    begin = int32(begin + (kind * int32(impostors.VIEWS) + side) * rows * columns)
    blend = f32(0)
    step = int32(0)
    if distance < f32(BLEND_M) and height < f32(BLEND_HEIGHT_M):
        neighbour, blend = neighbouring_view(nx, ny, east, scene.constants[view.world, layout.SUN_NORTH], side)
        blend *= clamp((f32(BLEND_M) - distance) * f32(1 / BLEND_FADE_M), f32(0), f32(1))
        step = int32(neighbour - side)

    # Haze is the same over the whole billboard (Beer, Lambert); texels are square-root coded in 0..255.
    clear = exp(-distance * view.look[HAZE_PER_M])
    season = view.look[SEASON]
    tint_r = plant[layout.P_R] * clear * f32(1 / 255.0**2) * (f32(1) + season * (scene.autumn[kind, 0] - f32(1)))
    tint_g = plant[layout.P_G] * clear * f32(1 / 255.0**2) * (f32(1) + season * (scene.autumn[kind, 1] - f32(1)))
    tint_b = plant[layout.P_B] * clear * f32(1 / 255.0**2) * (f32(1) + season * (scene.autumn[kind, 2] - f32(1)))
    haze_r = scene.constants[view.world, layout.FOG_R] * (f32(1) - clear)
    haze_g = scene.constants[view.world, layout.FOG_G] * (f32(1) - clear)
    haze_b = scene.constants[view.world, layout.FOG_B] * (f32(1) - clear)
    sun_low = plant[layout.P_LOW]
    shade = scene.extents[view.world, layout.SHADE_AT] + kind * int32(impostors.VIEWS) + side
    beside = shade + step
    shade_r = scene.shade[shade, 0] + (scene.shade[beside, 0] - scene.shade[shade, 0]) * blend
    shade_g = scene.shade[shade, 1] + (scene.shade[beside, 1] - scene.shade[shade, 1]) * blend
    shade_b = scene.shade[shade, 2] + (scene.shade[beside, 2] - scene.shade[shade, 2]) * blend
    return Billboard(
        distance, nx, ny, foot, per_height, per_half_width, begin, columns, rows,
        tint_r, tint_g, tint_b, haze_r, haze_g, haze_b, sun_low, plant[layout.P_HIGH] - sun_low,
        shade_r, shade_g, shade_b,
        clamp(height_px / f32(rows), f32(1), f32(MOST_SHARP)) * (f32(1) + f32(BLEND_SHARP) * blend), blend, step,
        int32(shade * int32(impostors.LEVELS) + level),
    )  # fmt: skip


@kernel(inlined=True, allocates=False, fastmath=False)
def texel_cover(a, b, t00, t10, t01, t11):
    """The coverage, 0..255, that each of four texels adds at a point a, b between them, and their sum.

    Without fastmath, so that masks that are drawn without colours have the same bits.
    """
    w00 = (f32(1) - a) * (f32(1) - b) * channel(t00, 24)
    w10 = a * (f32(1) - b) * channel(t10, 24)
    w01 = (f32(1) - a) * b * channel(t01, 24)
    w11 = a * b * channel(t11, 24)
    return w00, w10, w01, w11, w00 + w10 + w01 + w11


@kernel(inlined=True, allocates=False, fastmath=False)
def mixed_cover(cover, other, blend):
    """The coverage between those of two views, of which the other has the share `blend`; without fastmath as well."""
    return cover * (f32(1) - blend) + other * blend


@kernel(inlined=True, allocates=False, fastmath=False)
def sharp_cover(cover, sharp):
    """The share of a pixel, 0..1, that a coverage of 0..255 between texels stands for; without fastmath as well.

    Where a texel is larger than a pixel, the edge lies where half is covered and is a pixel wide (Green 2007, "Improved
    alpha-tested magnification for vector textures and special effects").
    """
    return clamp((cover * f32(1 / 255.0) - f32(0.5)) * sharp + f32(0.5), f32(0), f32(1))


@kernel(inlined=True, allocates=False, fastmath=False)
def stopped(passing, cover, closed):
    """The part of the passing light that a plant stops: as much as it covers, and all if less than `closed` is left.

    So a pixel has an end, and what it shows does not depend on which pixels are drawn together. Without fastmath, for
    the same bits wherever it is inlined.
    """
    part = passing * cover
    return passing if passing - part < closed else part


@kernel(inlined=True, allocates=False)
def sample_ray(camera, left, height, per_row, i):
    """The `ray_direction` of sample i of a tile whose first one is at left, height on the image plane.

    per_row: by how much the samples of a row are lower than those of the row above.
    """
    return ray_direction(camera, left + f32(i & (SIDE - 1)) * camera.column_step, height - f32(i >> SHIFT) * per_row)


@kernel(inlined=True, allocates=False)
def meet_billboard(board, dx, dy, dz, near):
    """Where a ray meets a billboard's upright plane, and whether that is on the billboard and behind the near plane.

    Returned before that are t, u from -1 to 1 across, and v from 0 at the foot to 1 at the top.
    """
    towards = dx * board.sight_x + dy * board.sight_y
    t = board.distance / max(towards, f32(1e-4))
    v = (dz * t - board.foot) * board.per_height
    u = (dy * board.sight_x - dx * board.sight_y) * t * board.per_half_width
    # One condition instead of early returns, so that the loop over pixels has no branches.
    inside = (towards > f32(1e-3)) & (t > near) & (v >= f32(0)) & (v < f32(1)) & (abs(u) < f32(1))
    return t, u, v, inside


@kernel(inlined=True, allocates=False)
def texel_at(board, u, v):
    """The texel to the lower left of a point of a billboard, and how far the point lies to its right and above it."""
    # Column 0 of a billboard is on the camera's left, where u = 1.
    tu = clamp((f32(1) - u) * f32(0.5) * f32(board.columns) - f32(0.5), f32(0), f32(board.columns) - f32(1.001))
    tv = clamp(v * f32(board.rows) - f32(0.5), f32(0), f32(board.rows) - f32(1.001))
    column = int32(tu)
    row = int32(tv)
    return board.begin + row * board.columns + column, tu - f32(column), tv - f32(row)


@kernel(inlined=True, allocates=False)
def nearest_texel(board, u, v):
    """The texel nearest to a point of a billboard."""
    column = int32(clamp((f32(1) - u) * f32(0.5) * f32(board.columns), f32(0), f32(board.columns) - f32(1)))
    row = int32(clamp(v * f32(board.rows), f32(0), f32(board.rows) - f32(1)))
    return board.begin + row * board.columns + column


@kernel(inlined=True, allocates=False)
def filtered(atlas, k, columns, a, b):
    """Red, green, blue and coverage (0..255) between texel k, its right neighbour and the two above them.

    columns: of the picture; a, b: how far to the right and up.
    """
    t00 = atlas[uint32(k)]
    t10 = atlas[uint32(k + 1)]
    t01 = atlas[uint32(k + columns)]
    t11 = atlas[uint32(k + columns + 1)]
    # Colours are weighted by coverage, so that empty texels do not bleed in.
    w00, w10, w01, w11, cover = texel_cover(a, b, t00, t10, t01, t11)
    share = f32(1) / max(cover, f32(1e-3))
    cr = channel(t00, 0) * w00 + channel(t10, 0) * w10 + channel(t01, 0) * w01 + channel(t11, 0) * w11
    cg = channel(t00, 8) * w00 + channel(t10, 8) * w10 + channel(t01, 8) * w01 + channel(t11, 8) * w11
    cb = channel(t00, 16) * w00 + channel(t10, 16) * w10 + channel(t01, 16) * w01 + channel(t11, 16) * w11
    return cr * share, cg * share, cb * share, cover


@kernel(inlined=True, allocates=False)
def billboard_pixel(atlas, board, dx, dy, dz, near, ground, passing, closed, blended):
    """What a billboard adds to one pixel: red, green, blue, the share of `passing` that it stops, and its depth.

    dx, dy, dz: the ray in metres per metre along the axis; ground: depth of what lies behind; passing: share of light
    that nearer plants let through; closed: of which this one stops all if it lets less than this through;
    blended: whether the neighbouring view is looked at too.
    """
    t, u, v, inside = meet_billboard(board, dx, dy, dz, near)
    inside = inside & (t < ground)
    k, a, b = texel_at(board, u, v)
    cr, cg, cb, cover = filtered(atlas, k, board.columns, a, b)
    if blended:
        other_r, other_g, other_b, other = filtered(
            atlas, k + board.step * board.rows * board.columns, board.columns, a, b
        )
        whole = mixed_cover(cover, other, board.blend)
        share = other * board.blend / max(whole, f32(1e-3))
        cr += (other_r - cr) * share
        cg += (other_g - cg) * share
        cb += (other_b - cb) * share
        cover = whole
    sun = clamp(board.sun_low + board.sun_rise * v, f32(0), f32(1))
    # Front-to-back compositing (Porter, Duff 1984): what is stopped here takes its share of what still passes.
    part = stopped(passing, sharp_cover(cover, board.sharp) if inside else f32(0), closed)
    red = part * (cr * cr * board.tint_r * (board.shade_r + (f32(1) - board.shade_r) * sun) + board.haze_r)
    green = part * (cg * cg * board.tint_g * (board.shade_g + (f32(1) - board.shade_g) * sun) + board.haze_g)
    blue = part * (cb * cb * board.tint_b * (board.shade_b + (f32(1) - board.shade_b) * sun) + board.haze_b)
    return red, green, blue, part, t


@kernel(inlined=True, allocates=False)
def nearest_depth(distance, camera):
    """Lower bound of the depth at which any ray meets a billboard at a horizontal distance: that of the upper corners.

    An upper corner's ray is the one that gets farthest horizontally per metre along the axis.
    """
    level = math.sqrt(camera.forward_x * camera.forward_x + camera.forward_y * camera.forward_y)
    rise = math.sqrt(camera.up_x * camera.up_x + camera.up_y * camera.up_y)
    spread = level + camera.half_h * rise
    return distance / math.sqrt(spread * spread + camera.half_w * camera.half_w)
