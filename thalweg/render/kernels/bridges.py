"""Kernels for arch bridges: where a ray meets one. `bridge_stone` has the radiance of its stone.

A bridge is an extruded profile: across its deck (v) it is the same everywhere, so a ray is cut to the slab between its
two faces and then marched through the profile of arch and deck in the (u, z) plane. Parapets are two thin extrusions
more. Anything that would need a mesh is absent on purpose.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import int32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.camera_rays import row_step
from thalweg.render.kernels.table_lookup import clamp
from thalweg.render.records import layout
from thalweg.world.record import PARAPET_THICKNESS_M

f32 = np.float32

STEPS = 40
"""Steps of the march through a profile."""
FAR_M = 400.0
"""Bridges farther than this are not drawn."""
FOOT_M = 3.0
"""How far the piers reach below the spring of the arch, into bed and bank."""


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
def meet_slab(at, rate, low, high):
    """The t at which a coordinate that begins at `at` and changes by `rate` enters low..high, and at which it leaves
    (slabs: Kay, Kajiya 1986)."""
    # The divisor is kept from zero.
    inverse = f32(1) / (rate if abs(rate) > f32(1e-6) else f32(1e-6))
    ta = (low - at) * inverse
    tb = (high - at) * inverse
    return min(ta, tb), max(ta, tb)


@kernel(inlined=True, allocates=False)
def meet_extrusion(ray, v_low, v_high, profile, near, far):
    """The first t in near..far at which a ray is inside an extruded profile (-1: none), and 1 if it entered by a face.

    The profile is extruded over v_low..v_high.
    """
    # First between the two faces.
    first, last = meet_slab(ray.v, ray.dv, v_low, v_high)
    enter = max(first, near)
    leave = min(last, far)
    by_face = f32(1) if first >= near else f32(0)
    # The box around the profile cuts the ray further.
    first, last = meet_slab(ray.u, ray.du, -profile.half_length, profile.half_length)
    by_face = f32(0) if first > enter else by_face
    enter = max(enter, first)
    leave = min(leave, last)
    first, last = meet_slab(ray.z, ray.dz, profile.low, profile.high)
    by_face = f32(0) if first > enter else by_face
    enter = max(enter, first)
    leave = min(leave, last)
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
    first_v, last_v = meet_slab(ray.v, ray.dv, -half, half)
    first_u, last_u = meet_slab(ray.u, ray.du, -length, length)
    first_z, last_z = meet_slab(
        ray.z, ray.dz, row[layout.B_SPRING] - f32(FOOT_M), row[layout.B_DECK] + row[layout.B_PARAPET]
    )
    enter = max(max(first_v, near), max(first_u, first_z))
    leave = min(min(last_v, far), min(last_u, last_z))
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
