"""Where does a ray meet an arch bridge, and what does the stone look like there?

A bridge is an extruded outline: across its deck (v) it is the same everywhere, so a ray is cut to the slab between its
two faces and then marched through the outline of arch and deck in the (u, z) plane. Parapets are two thin extrusions
more. Absent on purpose: anything that would need a mesh.
"""

import math

import numpy as np
from numba import int32

from thalweg.core.jit import kernel
from thalweg.render.kernels.fast_math import exp, floor
from thalweg.render.kernels.table_lookup import clamp
from thalweg.render.records import scene as table
from thalweg.render.records.appearance import HAZE_PER_M
from thalweg.world.record import PARAPET_THICKNESS_M

f32 = np.float32

STEPS = 40
FAR_M = 400.0
"""Bridges farther than this are not drawn."""
FOOT_M = 3.0
"""How far the piers reach below the spring of the arch, into bed and bank."""
STONE = (0.40, 0.36, 0.29)
SKY_UNDER = 0.30
"""Share of the sky's light that reaches the underside of the arch, mostly by way of the water."""
BOUNCE = 0.04
"""Radiance that white stone sends back of what ground and water send up to it."""
COURSE_M = 0.32
BLOCK_M = 0.62
JOINT_M = 0.02
JOINT_DEPTH = 0.38
BLOCK_CONTRAST = 0.42


@kernel(inlined=True)
def outline_gap(u, z, low, high_centre, half_length, hump, half_span, spring, rise):
    """Greater than zero outside the outline at (u, z): the largest of its distances beyond a side, all in metres."""
    share = u / half_length
    top = z - (high_centre - hump * share * share)
    across = u / half_span
    arch = spring + rise * math.sqrt(max(f32(1) - across * across, f32(0)))
    hollow = arch - z if abs(u) < half_span else f32(-1)
    return max(max(top, low - z), max(hollow, abs(u) - half_length))


@kernel(inlined=True)
def meet_extrusion(
    u, v, z, du, dv, dz, v_low, v_high, low, high, half_length, hump, half_span, spring, rise, near, far
):
    """The first t in near..far at which a ray is in an extruded outline (-1: none), and 1 if it entered by a face."""
    inverse = f32(1) / (dv if abs(dv) > f32(1e-6) else f32(1e-6))
    ta = (v_low - v) * inverse
    tb = (v_high - v) * inverse
    enter = max(min(ta, tb), near)
    leave = min(max(ta, tb), far)
    by_face = f32(1) if min(ta, tb) >= near else f32(0)
    # The box around the outline cuts the ray further.
    inverse = f32(1) / (du if abs(du) > f32(1e-6) else f32(1e-6))
    ta = (-half_length - u) * inverse
    tb = (half_length - u) * inverse
    by_face = f32(0) if min(ta, tb) > enter else by_face
    enter = max(enter, min(ta, tb))
    leave = min(leave, max(ta, tb))
    inverse = f32(1) / (dz if abs(dz) > f32(1e-6) else f32(1e-6))
    ta = (low - z) * inverse
    tb = (high - z) * inverse
    by_face = f32(0) if min(ta, tb) > enter else by_face
    enter = max(enter, min(ta, tb))
    leave = min(leave, max(ta, tb))
    found = f32(-1)
    if enter < leave:
        step = (leave - enter) / f32(STEPS)
        before = enter
        t = enter + step * f32(0.001)
        for k in range(STEPS + 1):
            gap = outline_gap(u + du * t, z + dz * t, low, high, half_length, hump, half_span, spring, rise)
            if gap <= f32(0):
                found = t
                if k > 0:
                    by_face = f32(0)
                    # Halve the last step until the surface is met to the millimetre.
                    for _ in range(8):
                        middle = f32(0.5) * (before + found)
                        gap = outline_gap(
                            u + du * middle, z + dz * middle, low, high, half_length, hump, half_span, spring, rise
                        )
                        inside = gap <= f32(0)
                        found = middle if inside else found
                        before = before if inside else middle
                break
            before = t
            t += step
    return found, by_face


@kernel
def bridge_box(row, eye, height, width):
    """The columns from, to and rows from, to that a bridge may touch on the screen."""
    ox, oy, oz, fx, fy, fz, rx, ry, ux, uy, uz, half_w, half_h, per_column, near = eye
    per_row = f32(2) * half_h / f32(height)
    low_x = f32(1e9)
    high_x = f32(-1e9)
    low_y = f32(1e9)
    high_y = f32(-1e9)
    behind = 0
    for corner in range(8):
        u = row[table.B_HALF_LENGTH] if corner & 1 else -row[table.B_HALF_LENGTH]
        v = row[table.B_HALF_WIDTH] if corner & 2 else -row[table.B_HALF_WIDTH]
        z = row[table.B_DECK] + row[table.B_PARAPET] if corner & 4 else row[table.B_SPRING] - f32(FOOT_M)
        px = row[table.B_X] + u * row[table.B_COS] - v * row[table.B_SIN] - ox
        py = row[table.B_Y] + u * row[table.B_SIN] + v * row[table.B_COS] - oy
        pz = z - oz
        ahead = px * fx + py * fy + pz * fz
        behind += 1 if ahead < near else 0
        ahead = max(ahead, f32(0.01))
        sx = (px * rx + py * ry) / ahead
        sy = (px * ux + py * uy + pz * uz) / ahead
        low_x = min(low_x, sx)
        high_x = max(high_x, sx)
        low_y = min(low_y, sy)
        high_y = max(high_y, sy)
    c0 = int32(0)
    c1 = int32(width)
    r0 = int32(0)
    r1 = int32(height)
    if behind == 8:
        c1 = int32(0)
        r1 = int32(0)
    elif behind == 0:
        c0 = int32(clamp((low_x + half_w) / per_column, f32(0), f32(width)))
        c1 = int32(clamp((high_x + half_w) / per_column + f32(1), f32(0), f32(width)))
        r0 = int32(clamp((half_h - high_y) / per_row, f32(0), f32(height)))
        r1 = int32(clamp((half_h - low_y) / per_row + f32(1), f32(0), f32(height)))
    return c0, c1, r0, r1


@kernel(inlined=True)
def meet_bridge(row, ox, oy, oz, dx, dy, dz, near, far):
    """Where a ray (world metres) first meets a bridge: t or -1, the point's u, v, the normal in (u, v, z), and z."""
    cos = row[table.B_COS]
    sin = row[table.B_SIN]
    px = ox - row[table.B_X]
    py = oy - row[table.B_Y]
    u = px * cos + py * sin
    v = py * cos - px * sin
    du = dx * cos + dy * sin
    dv = dy * cos - dx * sin
    half = row[table.B_HALF_WIDTH]
    length = row[table.B_HALF_LENGTH]
    hump = row[table.B_HUMP]
    span = row[table.B_SPAN]
    spring = row[table.B_SPRING]
    rise = row[table.B_RISE]
    deck = row[table.B_DECK]
    parapet = row[table.B_PARAPET]
    wall = f32(PARAPET_THICKNESS_M)
    low = spring - f32(FOOT_M)
    t, face = meet_extrusion(
        u, v, oz, du, dv, dz, -half, half, low, deck, length, hump, span, spring, rise, near, far
    )  # fmt: skip
    far = t if t > f32(0) else far
    # The parapets' outlines have no arch: its span is put out of reach below them.
    for side in range(2):
        inner = half - wall
        v_low = inner if side == 0 else -half
        ts, fs = meet_extrusion(
            u, v, oz, du, dv, dz, v_low, v_low + wall, deck - hump, deck + parapet,
            length, hump, span, deck - hump - f32(9), f32(0.01), near, far,
        )  # fmt: skip
        t = ts if ts > f32(0) else t
        face = fs if ts > f32(0) else face
        far = ts if ts > f32(0) else far
    hu = u + du * t
    hv = v + dv * t
    hz = oz + dz * t
    along = hu / length
    on_top = hz > deck - hump * along * along - f32(0.02)
    end = abs(hu) > length - f32(0.01)
    nu = f32(0)
    nv = f32(0)
    nz = f32(0)
    if face > f32(0):
        nv = f32(-1) if dv > f32(0) else f32(1)
    elif on_top:
        nz = f32(1)
    elif end:
        nu = f32(1) if hu > f32(0) else f32(-1)
    else:
        # The intrados faces the axis of the arch, the piers below it face each other.
        eu = -hu / (span * span)
        ez = -max(hz - spring, f32(0)) / (rise * rise)
        size = math.sqrt(eu * eu + ez * ez) + f32(1e-9)
        nu = eu / size
        nz = ez / size
    return t, hu, hv, nu, nv, nz, hz


@kernel(inlined=True)
def block_shade(a, b, footprint):
    """Brightness of masonry at a along a course and b across courses (metres), faded by the pixel's footprint."""
    course = floor(b / f32(COURSE_M))
    shifted = a / f32(BLOCK_M) + f32(0.5) * course
    block = floor(shifted)
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


@kernel(inlined=True)
def shade_stone(scene, w, look, row, found, far, footprint, climb):
    """Radiance of the stone at a point found by `meet_bridge`; far and footprint in metres.

    climb: rise of the line of sight, in metres per metre along it.
    """
    _, u, v, nu, nv, nz, z = found
    cos = row[table.B_COS]
    sin = row[table.B_SIN]
    nx = nu * cos - nv * sin
    ny = nu * sin + nv * cos
    number = scene.number
    facing = max(nx * number[w, table.SUN_X] + ny * number[w, table.SUN_Y] + nz * number[w, table.SUN_Z], f32(0))
    height = z - row[table.B_SPRING]
    # No sun gets to the vault: what it does not shade itself the piers do.
    under = (nv == f32(0)) & (nz < f32(0.5)) & (abs(u) < row[table.B_SPAN] + f32(0.02))
    open_sky = f32(SKY_UNDER) if under else f32(0.55) + f32(0.45) * max(nz, f32(0))
    direct = f32(0) if under else facing
    # The sunlit top of a parapet that looks thinner than a pixel is dimmed as much as a pixel misses it; the definition
    # has samples enough to do without.
    share = u / row[table.B_HALF_LENGTH]
    raised = z > row[table.B_DECK] - row[table.B_HUMP] * share * share + f32(0.05)
    thin = min(f32(PARAPET_THICKNESS_M) * abs(climb) / max(footprint, f32(1e-6)), f32(1))
    direct *= thin if raised and nz > f32(0.9) else f32(1)
    along = u if abs(nu) < f32(0.7) else v
    up = height if abs(nz) < f32(0.7) else v
    # The ring of voussoirs around the arch is paler and has joints along its radius.
    across = u / row[table.B_SPAN]
    rise = height / (row[table.B_RISE] + f32(0.001))
    ring = math.sqrt(across * across + rise * rise)
    on_ring = (ring > f32(0.99)) & (ring < f32(1.16)) & (abs(nv) > f32(0.5))
    tone = block_shade(along, up, footprint) * (f32(1.18) if on_ring else f32(1))
    # Damp and moss near the water.
    damp = min(max(height * f32(0.9) + f32(0.1), f32(0)), f32(1))
    tone *= f32(0.55) + f32(0.45) * damp
    bounce = f32(BOUNCE)
    clear = exp(-far * look[HAZE_PER_M])
    red = f32(STONE[0]) * tone * (direct * f32(table.SUN_R) + open_sky * f32(table.SKY_R) + bounce)
    green = f32(STONE[1]) * tone * (direct * f32(table.SUN_G) + open_sky * f32(table.SKY_G) + bounce)
    blue = f32(STONE[2]) * tone * (direct * f32(table.SUN_B) + open_sky * f32(table.SKY_B) + bounce)
    return (
        red * clear + number[w, table.FOG_R] * (f32(1) - clear),
        green * clear + number[w, table.FOG_G] * (f32(1) - clear),
        blue * clear + number[w, table.FOG_B] * (f32(1) - clear),
    )
