"""Kernel for the shore line: the share of water in each pixel that the line between water and ground crosses.

The map of depths is positive in the water and negative on land. Its change over the footprint of a pixel says how much
of the pixel lies on either side, as if the line were straight. Class and mask stay those of the pixel's centre.
"""

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.camera_rays import ray_at, row_step
from thalweg.render.kernels.table_lookup import clamp, depth_map, sloped
from thalweg.render.records import layout
from thalweg.render.records.classes import GROUND, WATER

f32 = np.float32

DEEPEST_M = 0.4
"""Greatest change of depth over a pixel that counts: far away, where a pixel is longer than the shore is straight, the
line stays sharp."""
CORNER = 0.35
"""Share of the smaller of two changes over a pixel by which an oblique line takes longer to cross it."""
SLIVER = 0.02
"""Least share of a pixel on the shore that is shaded by itself."""
STEEPEST = 0.02
"""Least sine of the angle between sight and surface."""


@kernel(inlined=True, allocates=False)
def covered_share(what, wet):
    """Return the share of a pixel that water, or ground, covers, of which a share `wet` is water."""
    # Slivers are not shaded; what covers nearly all of a pixel then covers all of it.
    wet = f32(0) if wet < f32(SLIVER) else (f32(1) if wet > f32(1 - SLIVER) else wet)
    return wet if what == WATER else f32(1) - wet


@kernel(disjoint=True, allocates=False)
def water_shares(scene, view, origin, row, places, depth, kind, share, n):
    """Fill share [n] float32 with the share of water in each pixel: 0 or 1 away from the shore and for other classes.

    depth and kind [n] are those of the pixels at `places` [n], whose rows are counted from row `row` of the image.
    """
    camera = view.camera
    inv_cell = scene.constants[view.world, layout.INV_CELL]
    water = depth_map(scene, view.world)
    per_row = row_step(camera)
    for c in range(n):
        t = depth[c]
        wet = kind[c] == np.uint8(WATER)
        surface = wet | (kind[c] == np.uint8(GROUND))
        # The sky has no depth; any point will do.
        t = t if surface else f32(0)
        dx, dy, dz = ray_at(camera, row, places[c])
        w, slope_x, slope_y = sloped(water, origin.x + dx * inv_cell * t, origin.y + dy * inv_cell * t)
        slope_x *= inv_cell
        slope_y *= inv_cell
        along = slope_x * dx + slope_y * dy
        # Water is level; the ground falls as the depth rises. The ray meets the surface at the rate `sink`.
        sink = dz + (f32(0) if wet else along)
        sink = min(sink, f32(-STEEPEST))
        # The change of depth from one pixel to the next, to the right and up, along the surface.
        right = (slope_x * camera.right_x + slope_y * camera.right_y) * camera.column_step
        up = (slope_x * camera.up_x + slope_y * camera.up_y) * per_row
        across = abs(right * dz / sink)
        upwards = abs((up * dz - along * camera.up_z * per_row) / sink)
        # The share is a ramp: right for a line along rows or columns, near to it for an oblique one, whose corners the
        # ramp leaves out.
        change = min((max(across, upwards) + f32(CORNER) * min(across, upwards)) * t, f32(DEEPEST_M)) + f32(1e-6)
        part = clamp(f32(0.5) + w / change, f32(0), f32(1))
        share[c] = part if surface else f32(0)
