"""Kernel for the light of props: the radiance of a point of a posed part, under sun and sky, through haze.

Plastic and skin shine in the sun; stripes and grain are filtered to the pixel. Props neither cast shadows nor shade
their own parts, but what is close to the water is wet and dark.
"""

import math

import numpy as np
from numba import int32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.fast_math import exp, floor
from thalweg.render.kernels.props import models
from thalweg.render.kernels.props.pose import LEVEL, LOOKS, MAP, SUNLIT, solid_ray
from thalweg.render.kernels.shading.ground import tile_grain
from thalweg.render.kernels.table_lookup import clamp
from thalweg.render.records import layout
from thalweg.render.records.appearance import HAZE_PER_M

f32 = np.float32

BOUNCE = 0.035
"""Radiance of a white surface under the light that water and ground send up to it."""
WET_M = 0.12
"""Height above the water below which a part is wet."""
WET = 0.55
"""Factor on the reflectance of what is wet, at the water."""
GRAIN = 0.14
"""Contrast of the grain of a dull part, and the side of its tile in metres."""
GRAIN_M = 1.9
RED, GREEN, BLUE, STRIPE_R, STRIPE_G, STRIPE_B, AXIS, STRIPES, SHIFT, DUTY, GLOSS = range(
    LOOKS, LOOKS + models.OPACITY - models.RED
)


@kernel(inlined=True, allocates=False)
def stripe_share(part, hit, ray, t):
    """Return the share of a pixel that the stripes of a posed part cover around a `SolidHit` at t on a `SolidRay`."""
    axis = int32(part[AXIS])
    at = ray.ox + ray.x * t if axis == 0 else (ray.oy + ray.y * t if axis == 1 else ray.oz + ray.z * t)
    right = ray.right_x if axis == 0 else (ray.right_y if axis == 1 else ray.right_z)
    up = ray.up_x if axis == 0 else (ray.up_y if axis == 1 else ray.up_z)
    count = part[STRIPES] * f32(0.5)
    turns = (at + f32(1)) * count + part[SHIFT]
    turns -= floor(turns)
    half = f32(0.5) * part[DUTY]
    # The nearest stripe may lie beyond the end of the period.
    away = abs(turns - half)
    inside = half - min(away, f32(1) - away)
    width = max((abs(right) + abs(up)) * t * count, f32(1e-4))
    share = clamp(f32(0.5) + inside / width, f32(0), f32(1))
    # What is much finer than a pixel is seen in the mean.
    return share + (part[DUTY] - share) * clamp(f32(2) * width - f32(1), f32(0), f32(1))


@kernel(inlined=True, allocates=False)
def world_normal(part, hit):
    """Return the unit normal in the world of a `SolidHit` with a posed part."""
    # Normals are turned by the transpose of the inverse map, which is the map that the part holds.
    x = part[MAP] * hit.nx + part[MAP + 3] * hit.ny + part[MAP + 6] * hit.nz
    y = part[MAP + 1] * hit.nx + part[MAP + 4] * hit.ny + part[MAP + 7] * hit.nz
    z = part[MAP + 2] * hit.nx + part[MAP + 5] * hit.ny + part[MAP + 8] * hit.nz
    size = f32(1) / (math.sqrt(x * x + y * y + z * z) + f32(1e-12))
    return x * size, y * size, z * size


@kernel(inlined=True, allocates=False)
def part_radiance(scene, view, part, hit, ray, sight, at, distance, pixel):
    """Return the radiance (red, green, blue) of a posed part at a `SolidHit` of a `SolidRay`, haze included.

    sight: unit direction of sight, as the next a tuple; at: the point in metres; distance: metres of air up to there;
    pixel: side of the pixel there in metres.
    """
    number = scene.constants
    w = view.world
    nx, ny, nz = world_normal(part, hit)
    sun_x, sun_y, sun_z = number[w, layout.SUN_X], number[w, layout.SUN_Y], number[w, layout.SUN_Z]
    direct = max(nx * sun_x + ny * sun_y + nz * sun_z, f32(0)) * part[SUNLIT]
    open_sky = f32(0.55) + f32(0.45) * nz
    share = stripe_share(part, hit, ray, hit.t) if part[STRIPES] > f32(0) else f32(0)
    red = part[RED] + (part[STRIPE_R] - part[RED]) * share
    green = part[GREEN] + (part[STRIPE_G] - part[GREEN]) * share
    blue = part[BLUE] + (part[STRIPE_B] - part[BLUE]) * share
    tone = f32(WET) + f32(1 - WET) * clamp((at[2] - part[LEVEL]) * f32(1 / WET_M), f32(0), f32(1))
    gloss = part[GLOSS]
    if gloss == f32(0):
        tone *= f32(1) + f32(GRAIN) * tile_grain(
            scene.ripples, at[0] + f32(0.6) * at[2], at[1] + f32(0.7) * at[2], pixel, f32(GRAIN_M)
        )
    # Shine: Blinn 1977, with an exponent of 32, and a little of the sky's light at grazing angles (Schlick 1994).
    hx, hy, hz = sun_x - sight[0], sun_y - sight[1], sun_z - sight[2]
    shine = max((nx * hx + ny * hy + nz * hz) / math.sqrt(hx * hx + hy * hy + hz * hz + f32(1e-9)), f32(0))
    shine = shine * shine
    shine = shine * shine
    shine = shine * shine
    shine = shine * shine
    graze = f32(1) - clamp(-(nx * sight[0] + ny * sight[1] + nz * sight[2]), f32(0), f32(1))
    shine = gloss * (shine * shine * part[SUNLIT] + f32(0.5) * graze * graze * graze * max(nz, f32(0)))
    red = red * tone * (direct * f32(layout.SUN_R) + open_sky * f32(layout.SKY_R) + f32(BOUNCE)) + shine
    green = green * tone * (direct * f32(layout.SUN_G) + open_sky * f32(layout.SKY_G) + f32(BOUNCE)) + shine
    blue = blue * tone * (direct * f32(layout.SUN_B) + open_sky * f32(layout.SKY_B) + f32(BOUNCE)) + shine
    clear = exp(-distance * view.look[HAZE_PER_M])
    return (
        red * clear + number[w, layout.FOG_R] * (f32(1) - clear),
        green * clear + number[w, layout.FOG_G] * (f32(1) - clear),
        blue * clear + number[w, layout.FOG_B] * (f32(1) - clear),
    )


@kernel(inlined=True, allocates=False)
def sight_radiance(scene, view, part, pixel, sight, hit):
    """Return `part_radiance` at a `SolidHit` of a `layers.PixelSight`; pixel: height of a pixel at distance one."""
    camera = view.camera
    inverse = f32(1) / sight.slant
    along = sight.x * inverse, sight.y * inverse, sight.z * inverse
    at = camera.x + sight.x * hit.t, camera.y + sight.y * hit.t, camera.z + sight.z * hit.t
    ray = solid_ray(part, camera, sight.sx, sight.sy)
    return part_radiance(scene, view, part, hit, ray, along, at, hit.t * sight.slant, hit.t * pixel)
