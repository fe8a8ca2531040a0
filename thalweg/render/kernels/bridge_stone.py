"""Kernels for the stone of bridges: its masonry, its light, and the tops of parapets that are thinner than a pixel."""

import math

import numpy as np
from numba import int32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.bridges import BridgeHit
from thalweg.render.kernels.fast_math import exp, floor
from thalweg.render.kernels.table_lookup import clamp
from thalweg.render.records import layout
from thalweg.render.records.appearance import HAZE_PER_M
from thalweg.world.record import PARAPET_THICKNESS_M

f32 = np.float32

STONE = (0.40, 0.36, 0.29)
"""Reflectance of the stone in red, green and blue."""
SKY_UNDER = 0.30
"""Share of the sky's light that reaches the underside of the arch, mostly by way of the water."""
BOUNCE = 0.04
"""Radiance of white stone under the light that ground and water reflect up to it."""
COURSE_M = 0.32
"""Height of a course of masonry, length of its blocks, width of the joints and their darkness."""
BLOCK_M = 0.62
JOINT_M = 0.02
JOINT_DEPTH = 0.38
BLOCK_CONTRAST = 0.42


@kernel(inlined=True, allocates=False)
def masonry(a, b, footprint):
    """Brightness of masonry at a along a course and b across courses (metres), faded by the pixel's footprint."""
    course = floor(b / f32(COURSE_M))
    # Every other course is shifted by half a block, as in a stretcher bond.
    shifted = a / f32(BLOCK_M) + f32(0.5) * course
    block = floor(shifted)
    # An integer hash gives each block its own shade.
    mixed = np.uint32(np.uint32(int32(block)) * np.uint32(374761393) + np.uint32(int32(course)) * np.uint32(668265263))
    mixed = np.uint32((mixed ^ (mixed >> np.uint32(13))) * np.uint32(1274126177))
    tone = f32(int32((mixed >> np.uint32(16)) & np.uint32(255))) * f32(1 / 255.0)
    inside_a = min(shifted - block, block + f32(1) - shifted) * f32(BLOCK_M)
    inside_b = min(b / f32(COURSE_M) - course, course + f32(1) - b / f32(COURSE_M)) * f32(COURSE_M)
    # A joint narrower than the pixel is widened to it and made as much paler.
    wide = max(f32(JOINT_M), footprint)
    joint = min(max(f32(1.4) - min(inside_a, inside_b) / wide, f32(0)), f32(1)) * f32(JOINT_M) / wide
    visible = min(max(f32(1.2) - footprint * f32(4), f32(0)), f32(1))
    return f32(1) + visible * (f32(BLOCK_CONTRAST) * (tone - f32(0.5)) - f32(JOINT_DEPTH) * joint)


@kernel(inlined=True, allocates=False)
def parapet_cover(row, ray, v_low, pixel, near, far):
    """The share of a pixel that the top of a parapet covers, 1 if that could be told, and the t at which it begins.

    v_low: the parapet's face with the lower v; pixel: height of the pixel in metres at t = 1. The share is that of the
    vertical line through the pixel, on which the top lies between its two edges.
    """
    length = row[layout.B_HALF_LENGTH]
    crown = row[layout.B_DECK] + row[layout.B_PARAPET]
    hump = row[layout.B_HUMP]
    across = abs(ray.dv) > f32(1e-4)
    inverse = f32(1) / (ray.dv if across else f32(1))
    ta = (v_low - ray.v) * inverse
    tb = (v_low + f32(PARAPET_THICKNESS_M) - ray.v) * inverse
    first = min(ta, tb)
    second = max(ta, tb)
    ua = (ray.u + ray.du * first) / length
    ub = (ray.u + ray.du * second) / length
    known = across & (first > near) & (first < far) & (abs(ua) < f32(1)) & (abs(ub) < f32(1))
    # How far the edges lie above the ray, in heights of the pixel.
    low = (crown - hump * ua * ua - ray.z - ray.dz * first) / (max(first, near) * pixel)
    high = (crown - hump * ub * ub - ray.z - ray.dz * second) / (max(second, near) * pixel)
    share = clamp(min(high, f32(0.5)) - max(low, f32(-0.5)), f32(0), f32(1))
    return share if known else f32(0), f32(1) if known else f32(0), first


@kernel(inlined=True, allocates=False)
def line_height(per_row, climb):
    """Height in metres at t = 1 of a pixel on an upright plane, for a line of sight that rises by `climb` a metre."""
    return per_row / math.sqrt(max(f32(1) - climb * climb, f32(0.01)))


@kernel(inlined=True, allocates=False)
def shade_stone(scene, view, row, hit, ray, per_row, slant, high):
    """Radiance of the stone at a `BridgeHit` of a `BridgeRay`: red, green, blue, haze included.

    per_row: height of a pixel at distance one; slant: length of the ray per unit of t; high: share of the pixel's
    height that the ray stands for.
    """
    cos = row[layout.B_COS]
    sin = row[layout.B_SIN]
    number = scene.constants
    w = view.world
    # The sunlit top of a parapet is mostly thinner than a pixel: through the middles of pixels it would be seen in
    # dashes. Each pixel near it shows as much of it as it holds; the rest is the parapet's face.
    share = hit.u / row[layout.B_HALF_LENGTH]
    raised = hit.z > row[layout.B_DECK] - row[layout.B_HUMP] * share * share + f32(0.05)
    top = raised & (hit.normal_z > f32(0.9))
    half = row[layout.B_HALF_WIDTH]
    pixel = line_height(per_row * high, ray.dz / slant)
    limit = hit.t + f32(0.02)
    left, left_known, _ = parapet_cover(row, ray, half - f32(PARAPET_THICKNESS_M), pixel, view.camera.near_m, limit)
    right, right_known, _ = parapet_cover(row, ray, -half, pixel, view.camera.near_m, limit)
    cover = min(left + right, f32(1))
    known = (left_known if hit.v > f32(0) else right_known) > f32(0)
    cover = f32(1) if top and not known else cover
    nu = f32(0) if top else hit.normal_u
    nv = (f32(-1) if ray.dv > f32(0) else f32(1)) if top else hit.normal_v
    nz = f32(0) if top else hit.normal_z
    nx = nu * cos - nv * sin
    ny = nu * sin + nv * cos
    sun_z = number[w, layout.SUN_Z]
    facing = max(nx * number[w, layout.SUN_X] + ny * number[w, layout.SUN_Y] + nz * sun_z, f32(0))
    # No sun gets to the vault: what it does not shade itself the piers do.
    under = (nv == f32(0)) & (nz < f32(0.5)) & (abs(hit.u) < row[layout.B_SPAN] + f32(0.02))
    open_sky = f32(SKY_UNDER) if under else f32(0.55) + f32(0.45) * max(nz, f32(0))
    direct = f32(0) if under else facing
    direct += (sun_z - direct) * cover
    open_sky += (f32(1) - open_sky) * cover
    return stone_radiance(scene, view, row, hit, per_row, slant, direct, open_sky)


@kernel(inlined=True, allocates=False)
def stone_radiance(scene, view, row, hit, per_row, slant, direct, open_sky):
    """Radiance of the stone at a `BridgeHit` under shares of the sun's and of the sky's light, haze included."""
    height = hit.z - row[layout.B_SPRING]
    tone = stone_tone(row, hit, height, hit.t * per_row)
    clear = exp(-hit.t * slant * view.look[HAZE_PER_M])
    bounce = f32(BOUNCE)
    red = f32(STONE[0]) * tone * (direct * f32(layout.SUN_R) + open_sky * f32(layout.SKY_R) + bounce)
    green = f32(STONE[1]) * tone * (direct * f32(layout.SUN_G) + open_sky * f32(layout.SKY_G) + bounce)
    blue = f32(STONE[2]) * tone * (direct * f32(layout.SUN_B) + open_sky * f32(layout.SKY_B) + bounce)
    number = scene.constants
    w = view.world
    return (
        red * clear + number[w, layout.FOG_R] * (f32(1) - clear),
        green * clear + number[w, layout.FOG_G] * (f32(1) - clear),
        blue * clear + number[w, layout.FOG_B] * (f32(1) - clear),
    )


@kernel(inlined=True, allocates=False)
def passing_top(scene, view, row, ray, per_row, slant, high, far):
    """The share of a pixel that parapets' tops cover though its ray passes by the bridge, and their radiance."""
    half = row[layout.B_HALF_WIDTH]
    pixel = line_height(per_row * high, ray.dz / slant)
    left, _, left_t = parapet_cover(row, ray, half - f32(PARAPET_THICKNESS_M), pixel, view.camera.near_m, far)
    right, _, right_t = parapet_cover(row, ray, -half, pixel, view.camera.near_m, far)
    t = left_t if left > right else right_t
    u = ray.u + ray.du * t
    share = u / row[layout.B_HALF_LENGTH]
    z = row[layout.B_DECK] + row[layout.B_PARAPET] - row[layout.B_HUMP] * share * share
    hit = BridgeHit(t, u, ray.v + ray.dv * t, f32(0), f32(0), f32(1), z)
    sun_z = scene.constants[view.world, layout.SUN_Z]
    red, green, blue = stone_radiance(scene, view, row, hit, per_row, slant, sun_z, f32(1))
    return min(left + right, f32(1)), red, green, blue


@kernel(inlined=True, allocates=False)
def stone_tone(row, hit, height, footprint):
    """Factor on the stone's reflectance at a `BridgeHit`: masonry, the ring of the arch, and damp near the water."""
    along = hit.u if abs(hit.normal_u) < f32(0.7) else hit.v
    up = height if abs(hit.normal_z) < f32(0.7) else hit.v
    # The ring of voussoirs around the arch is paler.
    across = hit.u / row[layout.B_SPAN]
    rise = height / (row[layout.B_RISE] + f32(0.001))
    ring = math.sqrt(across * across + rise * rise)
    on_ring = (ring > f32(0.99)) & (ring < f32(1.16)) & (abs(hit.normal_v) > f32(0.5))
    tone = masonry(along, up, footprint) * (f32(1.18) if on_ring else f32(1))
    # Damp and moss near the water.
    damp = min(max(height * f32(0.9) + f32(0.1), f32(0)), f32(1))
    return tone * (f32(0.55) + f32(0.45) * damp)
