"""Kernels that antialias the edges of bridges: pixels there mix stone and what lies behind, by their shares.

Everything else is drawn through one ray a pixel, which would leave the edge of a bridge in steps. Here its pixels are
drawn again from four. Pixels are first tested for a neighbour across an edge, which few have. Edges of plants need no
such thing, because billboards are filtered.
"""

import math

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.bridge_stone import passing_top, shade_stone
from thalweg.render.kernels.bridges import FAR_M, bridge_ray, meet_bridge
from thalweg.render.kernels.camera_rays import image_x, image_y, ray_direction, row_step
from thalweg.render.records import layout
from thalweg.render.records.classes import BRIDGE

f32 = np.float32


@kernel(allocates=False)
def sample_bridge(scene, view, r, c, down, right, high, limit):
    """The share of stone in a part of a pixel, nearer than a depth `limit`, and that share of its radiance.

    The ray is that through the centre of pixel (r, c), moved by shares of a pixel; `high` is the share of the pixel's
    height that it stands for. Where it passes by, only the top of a parapet is seen.
    """
    camera = view.camera
    per_row = row_step(camera)
    sx = image_x(camera, f32(c) + right)
    sy = image_y(camera, f32(r) + down, 1)
    dx, dy, dz = ray_direction(camera, sx, sy)
    slant = math.sqrt(f32(1) + sx * sx + sy * sy)
    seen = f32(0)
    red = f32(0)
    green = f32(0)
    blue = f32(0)
    for b in range(scene.extents[view.world, layout.BRIDGE_FROM], scene.extents[view.world, layout.BRIDGE_TO]):
        row = scene.bridges[b]
        # The limit shrinks with each hit, so that the nearest bridge is the last one shaded.
        ray = bridge_ray(row, camera, dx, dy, dz)
        hit = meet_bridge(row, ray, camera.near_m, limit)
        if hit.t > f32(0):
            limit = hit.t
            seen = f32(1)
            red, green, blue = shade_stone(scene, view, row, hit, ray, per_row, slant, high)
        elif seen == f32(0):
            part, a, b, d = passing_top(scene, view, row, ray, per_row, slant, high, limit)
            if part > f32(0):
                seen = part
                red = part * a
                green = part * b
                blue = part * d
    return seen, red, green, blue


@kernel(inlined=True, allocates=False)
def background(buffers, width, r, c):
    """The neighbours across a bridge's edge from pixel (r, c): their number, the sums of their radiance, and the depth
    before which stone can be seen in this pixel."""
    height = buffers.kind.shape[0]
    on_bridge = buffers.kind[r, c] == np.uint8(BRIDGE)
    count = f32(0)
    other_r = f32(0)
    other_g = f32(0)
    other_b = f32(0)
    limit = f32(0) if on_bridge else buffers.depth[r, c]
    for k in range(4):
        # Up, left, right, down.
        y = min(max(r + (k + 1) // 2 - 1, 0), height - 1)
        x = min(max(c + (k % 3 != 0) * (2 * k - 3), 0), width - 1)
        across = ((buffers.kind[y, x] == np.uint8(BRIDGE)) != on_bridge) & (buffers.transmittance[y, x] > f32(0.5))
        # Beside what is nearer, the edge is not the bridge's own, and rays at the bridge can't find it.
        across = across & ((not on_bridge) | (buffers.depth[y, x] > buffers.depth[r, c]))
        part = f32(1) if across else f32(0)
        count += part
        other_r += part * buffers.red[y, x]
        other_g += part * buffers.green[y, x]
        other_b += part * buffers.blue[y, x]
        limit = max(limit, buffers.depth[y, x]) if on_bridge and across else limit
    return count, other_r, other_g, other_b, limit


@kernel(allocates=False)
def edge_colour(scene, view, buffers, r, c):
    """The radiance of a pixel: red, green, blue, antialiased where it lies on a bridge's edge.

    buffers: `Buffers` [H, W'] of the whole image. Four rays sample the stone. Behind a pixel of the bridge lies the
    mean of those neighbours across the edge that are farther away.
    """
    on_bridge = buffers.kind[r, c] == np.uint8(BRIDGE)
    through = buffers.transmittance[r, c]
    red = buffers.red[r, c]
    green = buffers.green[r, c]
    blue = buffers.blue[r, c]
    count, other_r, other_g, other_b, limit = background(buffers, view.camera.width, r, c)
    # Behind dense plants an edge is hardly visible, and its five rays are saved.
    mixed = count > f32(0) and through > f32(0.5)
    if not mixed:
        return red, green, blue
    limit = min(limit, f32(FAR_M))
    share = f32(0)
    stone_r = f32(0)
    stone_g = f32(0)
    stone_b = f32(0)
    for k in range(4):
        # Offsets of -3/8, -1/8, 1/8, 3/8 of a pixel, each once a row and once a column: a rotated grid.
        down = (f32(k) - f32(1.5)) * f32(0.25)
        right = (f32((2 * k + 1 - k // 2) & 3) - f32(1.5)) * f32(0.25)
        seen, a, b, d = sample_bridge(scene, view, r, c, down, right, f32(0.25), limit)
        share += f32(0.25) * seen
        stone_r += f32(0.25) * a
        stone_g += f32(0.25) * b
        stone_b += f32(0.25) * d
    if on_bridge:
        # The pixel holds plants in front and the stone at its middle; that stone is replaced by the mixture.
        _, a, b, d = sample_bridge(scene, view, r, c, f32(0), f32(0), f32(1), f32(FAR_M))
        rest = (f32(1) - share) / count
        return (
            (red - through * a) * share + through * stone_r + other_r * rest,
            (green - through * b) * share + through * stone_g + other_g * rest,
            (blue - through * d) * share + through * stone_b + other_b * rest,
        )
    rest = f32(1) - share
    return (
        red * rest + through * stone_r,
        green * rest + through * stone_g,
        blue * rest + through * stone_b,
    )


@kernel(inlined=True, allocates=False)
def beside_edge(kind, r, c, width):
    """1 where one of the four neighbours of pixel (r, c) is stone and the pixel isn't, or the other way round."""
    stone = kind[r, c] == np.uint8(BRIDGE)
    above = kind[max(r - 1, 0), c] == np.uint8(BRIDGE)
    below = kind[min(r + 1, kind.shape[0] - 1), c] == np.uint8(BRIDGE)
    left = kind[r, max(c - 1, 0)] == np.uint8(BRIDGE)
    right = kind[r, min(c + 1, width - 1)] == np.uint8(BRIDGE)
    return 1 if (above != stone) | (below != stone) | (left != stone) | (right != stone) else 0


@kernel(allocates=False)
def stone_rows(kind, width):
    """The first row that shows stone and the row after the last one; the first is past the second where none does."""
    height = kind.shape[0]
    top = height
    bottom = 0
    for r in range(height):
        stone = 0
        # A sum over all pixels of a row vectorises, a search that stops at the first does not.
        for c in range(width):
            stone += 1 if kind[r, c] == np.uint8(BRIDGE) else 0
        top = min(top, r) if stone > 0 else top
        bottom = r + 1 if stone > 0 else bottom
    return top, bottom


@kernel
def soften_edges(scene, view, buffers):
    """Antialias the radiance of `Buffers` [H, W'] along the edges of bridges."""
    kind = buffers.kind
    width = view.camera.width
    top, bottom = stone_rows(kind, width)
    if top < bottom:
        # One row more on either side, whose pixels may lie beside stone.
        top = max(top - 1, 0)
        bottom = min(bottom + 1, kind.shape[0])
        count = count_beside_edges(kind, top, bottom, width)
        mix_edges(scene, view, buffers, top, bottom, np.empty((count, 2), np.int32), np.empty((count, 3), np.float32))


@kernel(allocates=False)
def count_beside_edges(kind, top, bottom, width):
    """Return the number of pixels beside an edge of a bridge in the rows top to bottom."""
    count = 0
    for r in range(top, bottom):
        for c in range(width):
            count += beside_edge(kind, r, c, width)
    return count


@kernel(allocates=False)
def mix_edges(scene, view, buffers, top, bottom, places, mixed):
    """Antialias the pixels beside an edge in the rows top to bottom; places [K, 2] and mixed [K, 3] are scratch."""
    width = view.camera.width
    n = 0
    for r in range(top, bottom):
        for c in range(width):
            if beside_edge(buffers.kind, r, c, width) == 1:
                places[n, 0] = r
                places[n, 1] = c
                n += 1
    # Colours are written only after all are known, because each pixel reads its neighbours.
    for k in range(n):
        mixed[k, 0], mixed[k, 1], mixed[k, 2] = edge_colour(scene, view, buffers, places[k, 0], places[k, 1])
    for k in range(n):
        buffers.red[places[k, 0], places[k, 1]] = mixed[k, 0]
        buffers.green[places[k, 0], places[k, 1]] = mixed[k, 1]
        buffers.blue[places[k, 0], places[k, 1]] = mixed[k, 2]
