"""Shading kernels for the sky, and for the haze in front of everything else."""

import numpy as np
from numba import int32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.fast_math import exp
from thalweg.render.kernels.shading.clouds import SOFTNESS, add_clouds, cloud_layer
from thalweg.render.kernels.table_lookup import sky_at
from thalweg.render.records import layout
from thalweg.render.records.appearance import HAZE_PER_M

f32 = np.float32


@kernel(disjoint=True, allocates=False)
def shade_sky(scene, view, points, out, n):
    """Fill `Radiance` [n] with that of the sky in the directions of sight of `HitPoints`."""
    _, _, _, dx, dy, dz, _ = points
    red, green, blue = out
    begin = int32(scene.extents[view.world, layout.SKY_AT])
    layer = cloud_layer(scene, view, f32(SOFTNESS))
    # Local names: the loop then reads the pointers once, not through the record.
    table = scene.sky
    clouds = scene.clouds
    for k in range(n):
        r, g, b = sky_at(table, begin, dx[k], dy[k], dz[k])
        r, g, b = add_clouds(clouds, layer, dx[k], dy[k], dz[k], r, g, b)
        red[k] = r
        green[k] = g
        blue[k] = b


@kernel(disjoint=True, allocates=False)
def add_haze(scene, view, points, out, n):
    """Fade `Radiance` [n] into the colour of the haze over the distance of `HitPoints` (Beer, Lambert)."""
    distance = points.distance
    red, green, blue = out
    fog_r = scene.constants[view.world, layout.FOG_R]
    fog_g = scene.constants[view.world, layout.FOG_G]
    fog_b = scene.constants[view.world, layout.FOG_B]
    look = view.look
    for k in range(n):
        # What the haze takes from the surface it replaces by its own light, which is that of the horizon.
        clear = exp(-distance[k] * look[HAZE_PER_M])
        red[k] = red[k] * clear + fog_r * (f32(1) - clear)
        green[k] = green[k] * clear + fog_g * (f32(1) - clear)
        blue[k] = blue[k] * clear + fog_b * (f32(1) - clear)
