"""Formulas of water for one ray: reflection, refraction, absorption and the sun's glitter, for both qualities.

Sources:

* Fresnel reflectance, n = 1.333: Schlick, "An Inexpensive BRDF Model", 1994; lessened by the spread of the ripples'
  slopes as in Bruneton, Neyret, Holzschuch, "Real-time Realistic Ocean Lighting", 2010, equation 20.
* Absorption and scattering over the refracted path: Beer, Lambert.
* Glitter: the density of slopes that mirror the sun, Gaussian; Cox, Munk, "Measurement of the Roughness of the Sea
  Surface", 1954.
"""

import math

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.fast_math import exp
from thalweg.render.kernels.table_lookup import clamp
from thalweg.render.records import layout

f32 = np.float32

INDEX = 1.333
"""Refractive index of water."""
ROUGHNESS = 0.0008
"""Mean square slope, along each axis, of the ripples too small for the tile."""
SHADE_GLOW = 0.12
"""Share of the scattered light that is left in the shade."""
SUN_WIDTH = 0.0006
"""Mean square slope, along each axis, that the sun's own width adds to a glint."""
GLITTER = 0.014
"""Radiance of a glint, as a share of the density of slopes that mirror the sun."""
GLITTER_MOST = 1.1
"""Greatest radiance of a glint."""
GLITTER_FADES = 40.0
"""Greatest exponent of that density: 4e-18 of its peak."""
GLITTER_TINT = (1.0, 0.95, 0.86)
"""Colour of a glint: factors on its radiance in red, green and blue."""


@kernel(inlined=True, allocates=False)
def mirrored_ray(dx, dy, dz, lean_x, lean_y):
    """The cosine between sight and a surface of these slopes, and the mirrored ray, which never points down."""
    size = f32(1) / math.sqrt(f32(1) + lean_x * lean_x + lean_y * lean_y)
    # Ripples can lean away from the camera on their far side, which would be hidden: sight is never from behind.
    facing = clamp((dx * lean_x + dy * lean_y - dz) * size, f32(0.01), f32(1))
    rx = dx - f32(2) * facing * lean_x * size
    ry = dy - f32(2) * facing * lean_y * size
    return facing, rx, ry, max(dz + f32(2) * facing * size, f32(0.02))


@kernel(inlined=True, allocates=False)
def mirrored_share(facing, spread):
    """Fresnel reflectance of rippled water; spread: mean square slope of the ripples too small to be seen."""
    graze = f32(1) - facing
    graze2 = graze * graze
    # The fifth power and the root by multiplications, which vectorise.
    rough = math.sqrt(spread)
    return f32(0.02) + f32(0.98) * graze2 * graze2 * graze / (f32(1) + f32(22.7) * rough * math.sqrt(rough))


@kernel(inlined=True, allocates=False)
def refracted_slant(dz):
    """Length of a refracted ray's path through water of depth 1; dz: rise of its unit direction in air (Snell)."""
    return f32(1) / math.sqrt(f32(1) - (f32(1) - dz * dz) * f32(1 / INDEX**2))


@kernel(inlined=True, allocates=False)
def from_below(bed, path, absorb, scatter, sunlit):
    """Radiance from under water in one channel: that of the bed, `path` metres of water away, and scattered on the way.

    bed: the square-root coded paint of the bed, 0..255; sunlit: share of the sun there.
    """
    through = exp(-absorb * path)
    # Skylight scatters too, so that shaded water is dimmer but not black.
    glow = f32(SHADE_GLOW) + f32(1 - SHADE_GLOW) * sunlit
    return bed * bed * f32(layout.PAINT_RANGE / 255.0**2) * through + scatter * glow * (f32(1) - through)


@kernel(inlined=True, allocates=False)
def glints(sun, dx, dy, dz, lean_x, lean_y, spread, sunlit):
    """Radiance of the ripples within a pixel that mirror the sun, whose slope is half way between sun and sight.

    sun: unit vector to the sun, a tuple; spread: see `mirrored_share`.
    """
    sun_x, sun_y, sun_z = sun
    # A facet mirrors the sun when its normal is half way between sun and sight; scaled to height one, that is a slope.
    half_z = sun_z - dz
    off_x = -(sun_x - dx) / half_z - lean_x
    off_y = -(sun_y - dy) / half_z - lean_y
    # The density needs the mean square slope along one axis. What filtering took away is that of both axes together,
    # ROUGHNESS that along each, and `spread` their sum: with ROUGHNESS once more it is twice what is needed.
    variance = f32(0.5) * (spread + f32(ROUGHNESS)) + f32(SUN_WIDTH)
    # Far from the sun's image a glint is nothing; without the limit it would be a subnormal number, which is slow.
    away = min((off_x * off_x + off_y * off_y) / (f32(2) * variance), f32(GLITTER_FADES))
    density = exp(-away) / (f32(6.2832) * variance)
    return min(f32(GLITTER) * density * sunlit, f32(GLITTER_MOST))


@kernel(inlined=True, allocates=False)
def footprint(distance, pixel, dz):
    """Side of a pixel on the water in metres: the geometric mean, since it is stretched along the ray."""
    # Limited near the horizon, where a pixel would stretch without end.
    return distance * pixel / math.sqrt(max(-dz, f32(0.03)))
