"""Kernels for arch bridges: where a ray meets one, and the radiance of its stone.

A bridge is an extruded profile: across its deck (v) it is the same everywhere, so a ray is cut to the slab between its
two faces and then marched through the profile of arch and deck in the (u, z) plane. Parapets are two thin extrusions
more. Anything that would need a mesh is absent on purpose.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import int32

from thalweg.core.jit import kernel
from thalweg.render.kernels.camera_rays import row_step
from thalweg.render.kernels.fast_math import exp, floor
from thalweg.render.kernels.table_lookup import clamp
from thalweg.render.records import layout
from thalweg.render.records.appearance import HAZE_PER_M
from thalweg.world.record import PARAPET_THICKNESS_M

f32 = np.float32

STEPS = 40
"""Steps of the march through a profile."""
FAR_M = 400.0
"""Bridges farther than this are not drawn."""
FOOT_M = 3.0
"""How far the piers reach below the spring of the arch, into bed and bank."""
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


class BridgeRay(NamedTuple):
    """A ray in a bridge's frame: u along the axis, v across it, z up, in metres, and their rates per unit of t."""

    u: Any
    v: Any
    z: Any
    du: Any
    dv: Any
    dz: Any


class Profile(NamedTuple):
    """A profile in the (u, z) plane, in metres: a slab with a humped top and an elliptic arch cut out of it."""

    low: Any
    """Lowest z."""
    high: Any
    """z of the top over the middle; towards the ends it is lower by up to `hump`."""
    half_length: Any
    hump: Any
    half_span: Any
    """Half width of the arch."""
    spring: Any
    """z at which the arch begins, and how far it rises from there."""
    rise: Any


class BridgeHit(NamedTuple):
    """Where a ray meets a bridge: t (-1: nowhere), the point and the normal in the bridge's frame."""

    t: Any
    u: Any
    v: Any
    normal_u: Any
    normal_v: Any
    normal_z: Any
    z: Any


@kernel(inlined=True, allocates=False)
def profile_gap(profile, u, z):
    """Greater than zero outside a profile at (u, z): the largest distance beyond one of its sides, in metres."""
    share = u / profile.half_length
    top = z - (profile.high - profile.hump * share * share)
    across = u / profile.half_span
    arch = profile.spring + profile.rise * math.sqrt(max(f32(1) - across * across, f32(0)))
    hollow = arch - z if abs(u) < profile.half_span else f32(-1)
    return max(max(top, profile.low - z), max(hollow, abs(u) - profile.half_length))


@kernel(inlined=True, allocates=False)
def meet_extrusion(ray, v_low, v_high, profile, near, far):
    """The first t in near..far at which a ray is inside an extruded profile (-1: none), and 1 if it entered by a face.

    The profile is extruded over v_low..v_high.
    """
    # Slabs (Kay, Kajiya 1986), first between the two faces. The divisor is kept from zero.
    inverse = f32(1) / (ray.dv if abs(ray.dv) > f32(1e-6) else f32(1e-6))
    ta = (v_low - ray.v) * inverse
    tb = (v_high - ray.v) * inverse
    enter = max(min(ta, tb), near)
    leave = min(max(ta, tb), far)
    by_face = f32(1) if min(ta, tb) >= near else f32(0)
    # The box around the profile cuts the ray further.
    inverse = f32(1) / (ray.du if abs(ray.du) > f32(1e-6) else f32(1e-6))
    ta = (-profile.half_length - ray.u) * inverse
    tb = (profile.half_length - ray.u) * inverse
    by_face = f32(0) if min(ta, tb) > enter else by_face
    enter = max(enter, min(ta, tb))
    leave = min(leave, max(ta, tb))
    inverse = f32(1) / (ray.dz if abs(ray.dz) > f32(1e-6) else f32(1e-6))
    ta = (profile.low - ray.z) * inverse
    tb = (profile.high - ray.z) * inverse
    by_face = f32(0) if min(ta, tb) > enter else by_face
    enter = max(enter, min(ta, tb))
    leave = min(leave, max(ta, tb))
    found = f32(-1)
    if enter < leave:
        step = (leave - enter) / f32(STEPS)
        before = enter
        # Slightly inside the face, whose own points would otherwise count as outside by rounding.
        t = enter + step * f32(0.001)
        for k in range(STEPS + 1):
            gap = profile_gap(profile, ray.u + ray.du * t, ray.z + ray.dz * t)
            if gap <= f32(0):
                found = t
                if k > 0:
                    by_face = f32(0)
                    # Halve the last step until the surface is met to the millimetre.
                    for _ in range(8):
                        middle = f32(0.5) * (before + found)
                        gap = profile_gap(profile, ray.u + ray.du * middle, ray.z + ray.dz * middle)
                        inside = gap <= f32(0)
                        found = middle if inside else found
                        before = before if inside else middle
                break
            before = t
            t += step
    return found, by_face


@kernel(allocates=False)
def bridge_box(row, camera):
    """The columns from, to and rows from, to that a bridge may touch in the image, and its least depth in metres.

    The box is empty for a bridge behind the camera, or farther than `FAR_M`.
    """
    per_row = row_step(camera)
    low_x = f32(1e9)
    high_x = f32(-1e9)
    low_y = f32(1e9)
    high_y = f32(-1e9)
    behind = 0
    closest = f32(1e9)
    for corner in range(8):
        u = row[layout.B_HALF_LENGTH] if corner & 1 else -row[layout.B_HALF_LENGTH]
        v = row[layout.B_HALF_WIDTH] if corner & 2 else -row[layout.B_HALF_WIDTH]
        z = row[layout.B_DECK] + row[layout.B_PARAPET] if corner & 4 else row[layout.B_SPRING] - f32(FOOT_M)
        px = row[layout.B_X] + u * row[layout.B_COS] - v * row[layout.B_SIN] - camera.x
        py = row[layout.B_Y] + u * row[layout.B_SIN] + v * row[layout.B_COS] - camera.y
        pz = z - camera.z
        ahead = px * camera.forward_x + py * camera.forward_y + pz * camera.forward_z
        behind += 1 if ahead < camera.near_m else 0
        # The depth is linear, so that no point of the bridge is nearer than the nearest corner.
        closest = min(closest, ahead)
        ahead = max(ahead, f32(0.01))
        sx = (px * camera.right_x + py * camera.right_y) / ahead
        sy = (px * camera.up_x + py * camera.up_y + pz * camera.up_z) / ahead
        low_x = min(low_x, sx)
        high_x = max(high_x, sx)
        low_y = min(low_y, sy)
        high_y = max(high_y, sy)
    # With corners on both sides of the near plane their images bound nothing: the whole image is searched.
    c0 = int32(0)
    c1 = int32(camera.width)
    r0 = int32(0)
    r1 = int32(camera.height)
    if behind == 8 or closest > f32(FAR_M):
        c1 = int32(0)
        r1 = int32(0)
    elif behind == 0:
        c0 = int32(clamp((low_x + camera.half_w) / camera.column_step, f32(0), f32(camera.width)))
        c1 = int32(clamp((high_x + camera.half_w) / camera.column_step + f32(1), f32(0), f32(camera.width)))
        r0 = int32(clamp((camera.half_h - high_y) / per_row, f32(0), f32(camera.height)))
        r1 = int32(clamp((camera.half_h - low_y) / per_row + f32(1), f32(0), f32(camera.height)))
    return c0, c1, r0, r1, closest


@kernel(inlined=True, allocates=False)
def bridge_ray(row, camera, dx, dy, dz):
    """The `BridgeRay` of a camera's ray (metres per metre along the axis) in the frame of a row of `Scene.bridges`."""
    cos = row[layout.B_COS]
    sin = row[layout.B_SIN]
    px = camera.x - row[layout.B_X]
    py = camera.y - row[layout.B_Y]
    return BridgeRay(px * cos + py * sin, py * cos - px * sin, camera.z, dx * cos + dy * sin, dy * cos - dx * sin, dz)


@kernel(inlined=True, allocates=False)
def passes_by(row, ray, near, far):
    """Whether a ray clearly misses the box around a bridge, parapets included, between near and far."""
    half = row[layout.B_HALF_WIDTH]
    length = row[layout.B_HALF_LENGTH]
    inverse = f32(1) / (ray.dv if abs(ray.dv) > f32(1e-6) else f32(1e-6))
    ta = (-half - ray.v) * inverse
    tb = (half - ray.v) * inverse
    enter = max(min(ta, tb), near)
    leave = min(max(ta, tb), far)
    inverse = f32(1) / (ray.du if abs(ray.du) > f32(1e-6) else f32(1e-6))
    ta = (-length - ray.u) * inverse
    tb = (length - ray.u) * inverse
    enter = max(enter, min(ta, tb))
    leave = min(leave, max(ta, tb))
    inverse = f32(1) / (ray.dz if abs(ray.dz) > f32(1e-6) else f32(1e-6))
    ta = (row[layout.B_SPRING] - f32(FOOT_M) - ray.z) * inverse
    tb = (row[layout.B_DECK] + row[layout.B_PARAPET] - ray.z) * inverse
    enter = max(enter, min(ta, tb))
    leave = min(leave, max(ta, tb))
    # With a margin for rounding: what is left is tested exactly.
    return enter > leave + f32(1e-3) * (f32(1) + abs(enter))


@kernel(inlined=True, allocates=False)
def meet_bridge(row, ray, near, far):
    """The `BridgeHit` of a `BridgeRay` with the bridge of a row of `Scene.bridges`, between near and far."""
    if passes_by(row, ray, near, far):
        return BridgeHit(f32(-1), f32(0), f32(0), f32(0), f32(0), f32(0), f32(0))
    half = row[layout.B_HALF_WIDTH]
    length = row[layout.B_HALF_LENGTH]
    hump = row[layout.B_HUMP]
    span = row[layout.B_SPAN]
    spring = row[layout.B_SPRING]
    deck = row[layout.B_DECK]
    wall = f32(PARAPET_THICKNESS_M)
    body = Profile(spring - f32(FOOT_M), deck, length, hump, span, spring, row[layout.B_RISE])
    t, by_face = meet_extrusion(ray, -half, half, body, near, far)
    far = t if t > f32(0) else far
    # The parapets' profiles have no arch: its span is put out of reach below them.
    parapet = Profile(
        deck - hump, deck + row[layout.B_PARAPET], length, hump, span, deck - hump - f32(9), f32(0.01)
    )  # fmt: skip
    for side in range(2):
        inner = half - wall
        v_low = inner if side == 0 else -half
        ts, fs = meet_extrusion(ray, v_low, v_low + wall, parapet, near, far)
        t = ts if ts > f32(0) else t
        by_face = fs if ts > f32(0) else by_face
        far = ts if ts > f32(0) else far
    return hit_normal(row, ray, t, by_face)


@kernel(inlined=True, allocates=False)
def hit_normal(row, ray, t, by_face):
    """The `BridgeHit` at t along a ray, which entered by a face of the extrusion if by_face is 1."""
    length = row[layout.B_HALF_LENGTH]
    span = row[layout.B_SPAN]
    rise = row[layout.B_RISE]
    u = ray.u + ray.du * t
    v = ray.v + ray.dv * t
    z = ray.z + ray.dz * t
    along = u / length
    on_top = z > row[layout.B_DECK] - row[layout.B_HUMP] * along * along - f32(0.02)
    end = abs(u) > length - f32(0.01)
    nu = f32(0)
    nv = f32(0)
    nz = f32(0)
    if by_face > f32(0):
        nv = f32(-1) if ray.dv > f32(0) else f32(1)
    elif on_top:
        nz = f32(1)
    elif end:
        nu = f32(1) if u > f32(0) else f32(-1)
    else:
        # The intrados faces the axis of the arch, the piers below it face each other.
        eu = -u / (span * span)
        ez = -max(z - row[layout.B_SPRING], f32(0)) / (rise * rise)
        size = math.sqrt(eu * eu + ez * ez) + f32(1e-9)
        nu = eu / size
        nz = ez / size
    return BridgeHit(t, u, v, nu, nv, nz, z)


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
