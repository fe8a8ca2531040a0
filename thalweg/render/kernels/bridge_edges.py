"""Kernels that antialias the edges of bridges: pixels there mix stone and what lies behind, by their shares.

Everything else is drawn through one ray a pixel, which would leave the edge of a bridge in steps. Here its pixels are
drawn again from four. Edges of plants need no such thing, because billboards are filtered.
"""

import math

import numpy as np
from numba import int32

from thalweg.core.jit import kernel
from thalweg.render.kernels.bridges import FAR_M, meet_bridge, shade_stone
from thalweg.render.kernels.camera_rays import row_step
from thalweg.render.records import layout
from thalweg.render.records.classes import BRIDGE

f32 = np.float32


@kernel(allocates=False)
def sample_bridge(scene, view, r, c, down, right, limit):
    """1 and the stone's radiance where a bridge is seen nearer than a depth `limit`, else zeros.

    The ray is that through the centre of pixel (r, c), moved by shares of a pixel.
    """
    camera = view.camera
    per_row = row_step(camera)
    sy = camera.half_h - (f32(r) + f32(0.5) + down) * per_row
    sx = (f32(c) + f32(0.5) + right) * camera.column_step - camera.half_w
    dx = camera.forward_x + sy * camera.up_x + sx * camera.right_x
    dy = camera.forward_y + sy * camera.up_y + sx * camera.right_y
    dz = camera.forward_z + sy * camera.up_z
    slant = math.sqrt(f32(1) + sx * sx + sy * sy)
    seen = f32(0)
    red = f32(0)
    green = f32(0)
    blue = f32(0)
    for b in range(scene.extents[view.world, layout.BRIDGE_FROM], scene.extents[view.world, layout.BRIDGE_TO]):
        row = scene.bridges[b]
        # The limit shrinks with each hit, so that the nearest bridge is the last one shaded.
        hit = meet_bridge(row, camera, dx, dy, dz, limit)
        if hit.t > f32(0):
            limit = hit.t
            seen = f32(1)
            red, green, blue = shade_stone(scene, view, row, hit, hit.t * slant, hit.t * per_row, dz / slant)
    return seen, red, green, blue


@kernel(inlined=True, allocates=False)
def background(planes, width, r, c):
    """The neighbours across a bridge's edge from pixel (r, c): their number, the sums of their radiance, and the depth
    before which stone can be seen in this pixel."""
    height = planes.kind.shape[0]
    on_bridge = planes.kind[r, c] == np.uint8(BRIDGE)
    count = f32(0)
    other_r = f32(0)
    other_g = f32(0)
    other_b = f32(0)
    limit = f32(0) if on_bridge else planes.depth[r, c]
    for k in range(4):
        # Up, left, right, down.
        y = min(max(r + (k + 1) // 2 - 1, 0), height - 1)
        x = min(max(c + (k % 3 != 0) * (2 * k - 3), 0), width - 1)
        across = ((planes.kind[y, x] == np.uint8(BRIDGE)) != on_bridge) & (planes.transmittance[y, x] > f32(0.5))
        # Beside what is nearer, the edge is not the bridge's own, and rays at the bridge can't find it.
        across = across & ((not on_bridge) | (planes.depth[y, x] > planes.depth[r, c]))
        part = f32(1) if across else f32(0)
        count += part
        other_r += part * planes.red[y, x]
        other_g += part * planes.green[y, x]
        other_b += part * planes.blue[y, x]
        limit = max(limit, planes.depth[y, x]) if on_bridge and across else limit
    return count, other_r, other_g, other_b, limit


@kernel(allocates=False)
def edge_colour(scene, view, planes, r, c):
    """1 and the antialiased radiance of a pixel on a bridge's edge; 0 and its own radiance for any other pixel.

    planes: `Planes` [H, W'] of the whole image. Four rays sample the stone. Behind a pixel of the bridge lies the mean
    of those neighbours across the edge that are farther away.
    """
    on_bridge = planes.kind[r, c] == np.uint8(BRIDGE)
    through = planes.transmittance[r, c]
    red = planes.red[r, c]
    green = planes.green[r, c]
    blue = planes.blue[r, c]
    count, other_r, other_g, other_b, limit = background(planes, view.camera.width, r, c)
    # Behind dense plants an edge is hardly visible, and its five rays are saved.
    mixed = count > f32(0) and through > f32(0.5)
    if not mixed:
        return f32(0), red, green, blue
    limit = min(limit, f32(FAR_M))
    share = f32(0)
    stone_r = f32(0)
    stone_g = f32(0)
    stone_b = f32(0)
    for k in range(4):
        # Offsets of -3/8, -1/8, 1/8, 3/8 of a pixel, each once a row and once a column: a rotated grid.
        down = (f32(k) - f32(1.5)) * f32(0.25)
        right = (f32((2 * k + 1 - k // 2) & 3) - f32(1.5)) * f32(0.25)
        seen, a, b, d = sample_bridge(scene, view, r, c, down, right, limit)
        share += f32(0.25) * seen
        stone_r += f32(0.25) * a
        stone_g += f32(0.25) * b
        stone_b += f32(0.25) * d
    if on_bridge:
        # The pixel holds plants in front and the stone at its middle; that stone is replaced by the mixture.
        _, a, b, d = sample_bridge(scene, view, r, c, f32(0), f32(0), f32(FAR_M))
        rest = (f32(1) - share) / count
        return (
            f32(1),
            (red - through * a) * share + through * stone_r + other_r * rest,
            (green - through * b) * share + through * stone_g + other_g * rest,
            (blue - through * d) * share + through * stone_b + other_b * rest,
        )
    rest = f32(1) - share
    return (
        f32(1),
        red * rest + through * stone_r,
        green * rest + through * stone_g,
        blue * rest + through * stone_b,
    )


@kernel
def soften_edges(scene, view, planes):
    """Antialias the radiance of `Planes` [H, W'] along the edges of bridges."""
    pairs, top, bottom = edge_rows(planes.kind, view.camera.width)
    if pairs > 0:
        mix_edges(scene, view, planes, top, bottom, np.empty((2 * pairs, 5), np.float32))


@kernel(allocates=False)
def edge_rows(kind, width):
    """Pairs of neighbours of which one is on a bridge, and the rows from, to that hold their upper or left pixels."""
    height = kind.shape[0]
    pairs = 0
    top = height
    bottom = 0
    for r in range(height):
        row_pairs = 0
        for c in range(width):
            on_bridge = kind[r, c] == np.uint8(BRIDGE)
            # Each pair of neighbours is counted once, from its upper or left pixel.
            right = kind[r, min(c + 1, width - 1)] == np.uint8(BRIDGE)
            below = kind[min(r + 1, height - 1), c] == np.uint8(BRIDGE)
            row_pairs += (1 if on_bridge != right else 0) + (1 if on_bridge != below else 0)
        pairs += row_pairs
        top = min(top, r) if row_pairs > 0 else top
        bottom = r + 1 if row_pairs > 0 else bottom
    return pairs, top, bottom


@kernel(allocates=False)
def mix_edges(scene, view, planes, top, bottom, mixed):
    """Antialias the radiance of the rows from top to bottom and one more; mixed [2 * pairs, 5] is scratch."""
    height = planes.kind.shape[0]
    width = view.camera.width
    # Colours are written only after all are known, because each pixel reads its neighbours.
    n = 0
    for r in range(top, min(bottom + 1, height)):
        for c in range(width):
            edge, a, b, d = edge_colour(scene, view, planes, r, c)
            if edge > f32(0):
                mixed[n, 0] = f32(r)
                mixed[n, 1] = f32(c)
                mixed[n, 2] = a
                mixed[n, 3] = b
                mixed[n, 4] = d
                n += 1
    for k in range(n):
        r = int32(mixed[k, 0])
        c = int32(mixed[k, 1])
        planes.red[r, c] = mixed[k, 2]
        planes.green[r, c] = mixed[k, 3]
        planes.blue[r, c] = mixed[k, 4]
