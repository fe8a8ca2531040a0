"""Kernels for rays and solids: where a ray meets a sphere, a cube or a cone, and how much of a pixel the solid covers.

A solid has its own coordinates, in which it is of side two about the origin (`models`), so that one affine map places
it. A share of a pixel is estimated from one ray: how far inside the solid's outline the ray passes, over how much that
changes from one pixel to the next, which is the first-order distance of an implicit function.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.props.models import CONE, CUBE
from thalweg.render.kernels.table_lookup import clamp

f32 = np.float32

TINY = 1e-9
"""Keeps divisors from zero."""
LEAST_RATE = 1e-6
"""Least rate of a coordinate along a ray by which is divided."""


class SolidRay(NamedTuple):
    """A ray in a solid's coordinates: its origin, its direction, and how that differs one pixel to the right and up."""

    ox: Any
    oy: Any
    oz: Any
    x: Any
    y: Any
    z: Any
    right_x: Any
    right_y: Any
    right_z: Any
    up_x: Any
    up_y: Any
    up_z: Any


class SolidHit(NamedTuple):
    """Where a ray meets a solid: the share of the pixel that it covers (0: none), t, and its normal there."""

    cover: Any
    t: Any
    nx: Any
    ny: Any
    nz: Any


@kernel(inlined=True, allocates=False)
def apart_from_zero(rate):
    """Return a rate of change, or a small one if it is nearly zero."""
    return rate if abs(rate) > f32(LEAST_RATE) else f32(LEAST_RATE)


@kernel(inlined=True, allocates=False)
def share_inside(inside, right, up):
    """Return the share of a pixel on the inner side of an outline: `inside` is zero on it and changes by right, up."""
    return clamp(f32(0.5) + inside / (math.sqrt(right * right + up * up) + f32(TINY)), f32(0), f32(1))


@kernel(inlined=True, allocates=False)
def meet_solid(shape, taper, ray):
    """Return the `SolidHit` of a `SolidRay` with a solid (see `models`); taper is that of a cone."""
    if shape == f32(CUBE):
        return meet_cube(ray)
    if shape == f32(CONE):
        return meet_cone(taper, ray)
    return meet_sphere(ray)


@kernel(inlined=True, allocates=False)
def meet_sphere(ray):
    """Return the `SolidHit` with the unit sphere."""
    a = ray.x * ray.x + ray.y * ray.y + ray.z * ray.z + f32(TINY)
    b = ray.ox * ray.x + ray.oy * ray.y + ray.oz * ray.z
    c = ray.ox * ray.ox + ray.oy * ray.oy + ray.oz * ray.oz - f32(1)
    inside = b * b - a * c
    right = b * (ray.ox * ray.right_x + ray.oy * ray.right_y + ray.oz * ray.right_z)
    right -= c * (ray.x * ray.right_x + ray.y * ray.right_y + ray.z * ray.right_z)
    up = b * (ray.ox * ray.up_x + ray.oy * ray.up_y + ray.oz * ray.up_z)
    up -= c * (ray.x * ray.up_x + ray.y * ray.up_y + ray.z * ray.up_z)
    cover = share_inside(inside, f32(2) * right, f32(2) * up)
    # A ray that passes by meets the solid where it is nearest to it.
    t = (-b - math.sqrt(max(inside, f32(0)))) / a
    return SolidHit(cover, t, ray.ox + ray.x * t, ray.oy + ray.y * t, ray.oz + ray.z * t)


@kernel(inlined=True, allocates=False)
def meet_cube(ray):
    """Return the `SolidHit` with the cube of side two, by slabs (Kay, Kajiya 1986)."""
    x = apart_from_zero(ray.x)
    y = apart_from_zero(ray.y)
    z = apart_from_zero(ray.z)
    # The signs of the faces through which the ray enters each slab; it leaves through the opposite ones.
    sx = f32(-1) if x > f32(0) else f32(1)
    sy = f32(-1) if y > f32(0) else f32(1)
    sz = f32(-1) if z > f32(0) else f32(1)
    enter_x, leave_x = (sx - ray.ox) / x, (-sx - ray.ox) / x
    enter_y, leave_y = (sy - ray.oy) / y, (-sy - ray.oy) / y
    enter_z, leave_z = (sz - ray.oz) / z, (-sz - ray.oz) / z
    enter = max(enter_x, max(enter_y, enter_z))
    leave = min(leave_x, min(leave_y, leave_z))
    # How the two change from pixel to pixel, by the slab that decides.
    rate_x, rate_y, rate_z = f32(1) / x, f32(1) / y, f32(1) / z
    in_x, in_y = enter == enter_x, (enter == enter_y) & (enter != enter_x)
    out_x, out_y = leave == leave_x, (leave == leave_y) & (leave != leave_x)
    right = enter * (
        ray.right_x * rate_x if in_x else (ray.right_y * rate_y if in_y else ray.right_z * rate_z)
    ) - leave * (ray.right_x * rate_x if out_x else (ray.right_y * rate_y if out_y else ray.right_z * rate_z))
    up = enter * (ray.up_x * rate_x if in_x else (ray.up_y * rate_y if in_y else ray.up_z * rate_z)) - leave * (
        ray.up_x * rate_x if out_x else (ray.up_y * rate_y if out_y else ray.up_z * rate_z)
    )
    cover = share_inside(leave - enter, right, up)
    zero = f32(0)
    return SolidHit(cover, enter, sx if in_x else zero, sy if in_y else zero, zero if in_x or in_y else sz)


@kernel(inlined=True, allocates=False)
def meet_cone(taper, ray):
    """Return the `SolidHit` with the cone |z| <= 1 of radius 1 at z = -1 and `taper` at z = 1."""
    # The radius is m + q z: a quadratic in t for the mantle.
    q = f32(0.5) * (taper - f32(1))
    m = f32(1) + q + q * ray.oz
    qq = q * q
    a = ray.x * ray.x + ray.y * ray.y - qq * ray.z * ray.z
    a = a if abs(a) > f32(TINY) else f32(TINY)
    b = ray.ox * ray.x + ray.oy * ray.y - q * ray.z * m
    c = ray.ox * ray.ox + ray.oy * ray.oy - m * m
    inside = b * b - a * c
    root = math.sqrt(max(inside, f32(0)))
    low, high = (-b - root) / a, (-b + root) / a
    # A ray steeper than the mantle is inside on one side of a root only: below the tip.
    steep = a < f32(0)
    opens = q * ray.z > f32(0)
    far = f32(1e9)
    first = (low if opens else -far) if steep else low
    last = (far if opens else high) if steep else high
    z = apart_from_zero(ray.z)
    s = f32(-1) if z > f32(0) else f32(1)
    enter_z, leave_z = (s - ray.oz) / z, (-s - ray.oz) / z
    by_mantle = first > enter_z
    out_mantle = last < leave_z
    enter = first if by_mantle else enter_z
    leave = last if out_mantle else leave_z
    # Rates of a, half of b, and of the roots, for one pixel to the right and up.
    a_right = f32(2) * (ray.x * ray.right_x + ray.y * ray.right_y - qq * ray.z * ray.right_z)
    a_up = f32(2) * (ray.x * ray.up_x + ray.y * ray.up_y - qq * ray.z * ray.up_z)
    b_right = ray.ox * ray.right_x + ray.oy * ray.right_y - q * m * ray.right_z
    b_up = ray.ox * ray.up_x + ray.oy * ray.up_y - q * m * ray.up_z
    mantle = share_inside(inside, f32(2) * b * b_right - c * a_right, f32(2) * b * b_up - c * a_up)
    slope = f32(-0.5) / max(root, f32(1e-6))
    # At the nearer root the derivative of the quadratic is negative, at the farther one positive.
    right = leave * (slope * (a_right * leave + f32(2) * b_right) if out_mantle else -ray.right_z / z)
    right += enter * (slope * (a_right * enter + f32(2) * b_right) if by_mantle else ray.right_z / z)
    up = leave * (slope * (a_up * leave + f32(2) * b_up) if out_mantle else -ray.up_z / z)
    up += enter * (slope * (a_up * enter + f32(2) * b_up) if by_mantle else ray.up_z / z)
    cover = share_inside(leave - enter, right, up)
    cover = cover if steep else min(cover, mantle)
    nx = ray.ox + ray.x * enter if by_mantle else f32(0)
    ny = ray.oy + ray.y * enter if by_mantle else f32(0)
    nz = -q * (m + q * ray.z * enter) if by_mantle else s
    return SolidHit(cover, enter, nx, ny, nz)
