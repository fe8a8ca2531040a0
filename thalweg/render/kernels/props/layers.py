"""Kernels for what one pixel shows of a prop: two layers of parts in order of depth, and where the scene cuts parts."""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import int32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.camera_rays import column_of, image_x, image_y, ray_direction, row_of, row_step
from thalweg.render.kernels.table_lookup import clamp
from thalweg.render.kernels.terrain.primary_hits import MISS

f32 = np.float32

LEAST_COVER = 0.02
"""Share of a pixel below which a part is left out."""
HALF = 0.5
"""Share of a pixel from which on it has the prop's class."""
STEEPEST = 0.05
"""Least sine of the angle between sight and water by which a part's edge at the water is softened."""
OPAQUE = 0.999
"""Share of a pixel from which on nothing behind a part is seen."""


class Layers(NamedTuple):
    """What a ray meets of a prop: the nearest part and all behind it, by their share, radiance times share, and t."""

    cover: Any
    t: Any
    red: Any
    green: Any
    blue: Any
    back_cover: Any
    back_t: Any
    back_red: Any
    back_green: Any
    back_blue: Any


class PixelSight(NamedTuple):
    """The ray through a pixel: its position on the image plane, its direction, and the length of that."""

    sx: Any
    sy: Any
    x: Any
    """Metres per metre along the optical axis, as the next two."""
    y: Any
    z: Any
    slant: Any


@kernel(inlined=True, allocates=False)
def pixel_sight(camera, row, column):
    """Return the `PixelSight` of a pixel of the image."""
    sx = image_x(camera, column)
    sy = image_y(camera, row, 1)
    dx, dy, dz = ray_direction(camera, sx, sy)
    return PixelSight(sx, sy, dx, dy, dz, math.sqrt(f32(1) + sx * sx + sy * sy))


@kernel(inlined=True, allocates=False)
def sight_at(camera, top, place):
    """Return the `PixelSight` of the pixel at a place whose row is counted from row `top` of the image."""
    return pixel_sight(camera, int32(top) + row_of(place), column_of(place))


@kernel(inlined=True, allocates=False)
def sharpness(camera, z, behind, on_water):
    """Return one over the depth over which what a ray meets at the depth `behind`, water if on_water, cuts a part.

    z: metres up per metre along the optical axis of the ray.
    """
    # Water cuts a part along a line that is as soft as its other edges: over the depth of one pixel's water.
    return max(-z, f32(STEEPEST)) / (behind * row_step(camera)) if on_water else f32(1e6)


@kernel(inlined=True, allocates=False)
def uncut_share(camera, t, behind, sharp):
    """Return the share of what a ray meets at t that is before what it meets at the depth `behind`, where that cuts it
    by `sharpness`; nothing before the near plane."""
    share = clamp(f32(0.5) + (behind - t) * sharp, f32(0), f32(1))
    return share if t >= camera.near_m else f32(0)


@kernel(inlined=True, allocates=False)
def no_layers():
    """Return `Layers` of nothing."""
    zero = f32(0)
    return Layers(zero, f32(MISS), zero, zero, zero, zero, f32(MISS), zero, zero, zero)


@kernel(inlined=True, allocates=False)
def is_hidden(layers, t):
    """Return whether a part at t lies behind an opaque one, so that it needs no colour."""
    return (layers.cover > f32(OPAQUE)) & (t > layers.t)


@kernel(inlined=True, allocates=False)
def layered(layers, cover, t, red, green, blue):
    """Return `Layers` with one more part: its share of the pixel, depth, and radiance times share.

    Front-to-back compositing (Porter, Duff 1984) of three layers, of which the two farther ones become one.
    """
    front, back = layers.cover, layers.back_cover
    if t < layers.t:
        rest = f32(1) - front
        return Layers(
            cover, t, red, green, blue,
            front + rest * back, layers.t,
            layers.red + rest * layers.back_red, layers.green + rest * layers.back_green,
            layers.blue + rest * layers.back_blue,
        )  # fmt: skip
    before = t < layers.back_t
    rest = f32(1) - (cover if before else back)
    own, old = (f32(1), rest) if before else (rest, f32(1))
    return Layers(
        front, layers.t, layers.red, layers.green, layers.blue,
        own * cover + old * back, min(t, layers.back_t),
        own * red + old * layers.back_red, own * green + old * layers.back_green, own * blue + old * layers.back_blue,
    )  # fmt: skip


@kernel(inlined=True, allocates=False)
def total_cover(layers):
    """Return the share of a pixel that `Layers` cover together."""
    return layers.cover + (f32(1) - layers.cover) * layers.back_cover


@kernel(inlined=True, allocates=False)
def total_radiance(layers):
    """Return the radiance of `Layers` times the share of a pixel that they cover: red, green, blue."""
    rest = f32(1) - layers.cover
    return (
        layers.red + rest * layers.back_red,
        layers.green + rest * layers.back_green,
        layers.blue + rest * layers.back_blue,
    )


@kernel(inlined=True, allocates=False)
def seen_depth(layers, cover):
    """Return the depth of `Layers` that cover a share of a pixel: that of the nearest part if it is half of them."""
    return layers.t if layers.cover >= f32(HALF) * cover else layers.back_t
