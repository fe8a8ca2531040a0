"""Kernels that put clouds before the sky in a direction: cumulus and cirrus from a baked map.

`thalweg.render.bake.clouds` makes the map. The look's cover sets the threshold above which the map's field is cloud.
Both the sky itself and its mirror image in the water read the map.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import int32, uint32

from thalweg.core.compute.jit import kernel
from thalweg.render.bake import clouds
from thalweg.render.kernels.table_lookup import channel, clamp, mix_texels
from thalweg.render.records import layout
from thalweg.render.records.appearance import CLOUDS

f32 = np.float32

SOFTNESS = 0.10
"""Range of the field over which the edge of a cloud becomes opaque."""
MIRROR_SOFTNESS = 0.45
"""As `SOFTNESS`, in the mirror of water, whose ripples blur it: rays of one pixel end in different parts of the sky."""
BRIGHT = (0.82, 0.80, 0.765)
"""Radiance of a cloud in full sun, seen from below: about three quarters of a white surface's."""
DARK = (0.30, 0.325, 0.365)
"""Radiance of a cloud's shaded base, which is lit by the sky and the ground."""
CIRRUS = 0.62
"""Greatest opacity of cirrus, which is reached at a cover of one third."""
CIRRUS_RADIANCE = (0.66, 0.67, 0.70)


class CloudLayer(NamedTuple):
    """The clouds of a view."""

    begin: Any
    """Where the map of its world begins."""
    threshold: Any
    """Value of the field, in 0..255, above which there is cumulus."""
    steepness: Any
    """Opacity that is gained for each 255th of the field above the threshold."""
    veil: Any
    """Factor on the opacity of cirrus, which is in 0..255."""


@kernel(inlined=True, allocates=False)
def cloud_layer(scene, view, softness):
    """Return the `CloudLayer` of a view whose clouds become opaque over a range `softness` of the field."""
    cover = view.look[CLOUDS]
    # The middle of the edge stays where it is, whatever its softness; a clear sky has no edges.
    threshold = f32(1) - cover - f32(0.5) * (softness - f32(SOFTNESS))
    return CloudLayer(
        int32(scene.extents[view.world, layout.CLOUD_AT]),
        f32(255) * (threshold if cover > f32(0) else f32(1)),
        f32(1 / 255.0) / softness,
        min(f32(3) * cover, f32(1)) * f32(CIRRUS / 255.0),
    )


@kernel(inlined=True, allocates=False)
def add_clouds(table, layer, dx, dy, dz, red, green, blue):
    """Return the radiance of the sky in a unit direction with its clouds; red, green, blue is that without."""
    # The stereographic projection of the upper half of the sky. Below the horizon no cloud shows.
    scale = f32(0.5 * clouds.SIDE) / (f32(1) + max(dz, f32(0)))
    u = clamp(dx * scale + f32(0.5 * clouds.SIDE - 0.5), f32(0), f32(clouds.SIDE - 1.001))
    v = clamp(dy * scale + f32(0.5 * clouds.SIDE - 0.5), f32(0), f32(clouds.SIDE - 1.001))
    column = int32(u)
    row = int32(v)
    k = layer.begin + row * int32(clouds.SIDE) + column
    excess, light, veil, shown = mix_texels(
        table[uint32(k)],
        table[uint32(k + 1)],
        table[uint32(k + int32(clouds.SIDE))],
        table[uint32(k + int32(clouds.SIDE + 1))],
        u - f32(column),
        v - f32(row),
    )
    return over_sky(layer, excess, light, veil, shown, dz, red, green, blue)


@kernel(inlined=True, allocates=False)
def add_nearest_clouds(table, layer, dx, dy, dz, red, green, blue):
    """As `add_clouds`, from the nearest texel."""
    scale = f32(0.5 * clouds.SIDE) / (f32(1) + max(dz, f32(0)))
    column = int32(clamp(dx * scale + f32(0.5 * clouds.SIDE), f32(0), f32(clouds.SIDE - 1)))
    row = int32(clamp(dy * scale + f32(0.5 * clouds.SIDE), f32(0), f32(clouds.SIDE - 1)))
    texel = table[uint32(layer.begin + row * int32(clouds.SIDE) + column)]
    return over_sky(
        layer, channel(texel, 0), channel(texel, 8), channel(texel, 16), channel(texel, 24), dz, red, green, blue
    )


@kernel(inlined=True, allocates=False)
def over_sky(layer, excess, light, veil, shown, dz, red, green, blue):
    """Return the radiance red, green, blue behind clouds, whose four channels are in 0..255."""
    high = f32(1) if dz > f32(0) else f32(0)
    # Cirrus lies behind cumulus.
    part = veil * layer.veil * high
    red += (f32(CIRRUS_RADIANCE[0]) - red) * part
    green += (f32(CIRRUS_RADIANCE[1]) - green) * part
    blue += (f32(CIRRUS_RADIANCE[2]) - blue) * part
    part = clamp((excess - layer.threshold) * layer.steepness, f32(0), f32(1))
    part = part * part * (f32(3) - f32(2) * part) * shown * high * f32(1 / 255.0)
    lit = light * f32(1 / 255.0)
    red += (f32(DARK[0]) + f32(BRIGHT[0] - DARK[0]) * lit - red) * part
    green += (f32(DARK[1]) + f32(BRIGHT[1] - DARK[1]) * lit - green) * part
    blue += (f32(DARK[2]) + f32(BRIGHT[2] - DARK[2]) * lit - blue) * part
    return red, green, blue
