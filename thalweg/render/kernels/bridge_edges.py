"""What does a pixel on a bridge's outline show? Stone and what lies beyond it, by their shares of the pixel.

All else is drawn through one ray a pixel, which leaves the outline of a bridge in steps. Here its pixels are drawn
again from four. Outlines of plants need no such thing: their pictures are filtered.
"""

import math

import numpy as np
from numba import int32

from thalweg.core.jit import kernel
from thalweg.render.kernels.bridges import FAR_M, meet_bridge, shade_stone
from thalweg.render.records import scene as table
from thalweg.render.records.classes import BRIDGE

f32 = np.float32


@kernel
def sample_bridge(scene, w, look, eye, height, r, c, down, right, limit):
    """1 and its radiance where a bridge is seen nearer than a depth `limit`, else zeros.

    The ray is that through the centre of pixel (r, c), moved by shares of a pixel.
    """
    ox, oy, oz, fx, fy, fz, rx, ry, ux, uy, uz, half_w, half_h, per_column, near = eye
    per_row = f32(2) * half_h / f32(height)
    sy = half_h - (f32(r) + f32(0.5) + down) * per_row
    sx = (f32(c) + f32(0.5) + right) * per_column - half_w
    slant = math.sqrt(f32(1) + sx * sx + sy * sy)
    seen = f32(0)
    red = f32(0)
    green = f32(0)
    blue = f32(0)
    for b in range(scene.place[w, table.BRIDGE_FROM], scene.place[w, table.BRIDGE_TO]):
        row = scene.bridges[b]
        found = meet_bridge(
            row, ox, oy, oz, fx + sy * ux + sx * rx, fy + sy * uy + sx * ry, fz + sy * uz, near, limit
        )  # fmt: skip
        if found[0] > f32(0):
            limit = found[0]
            seen = f32(1)
            red, green, blue = shade_stone(
                scene, w, look, row, found, found[0] * slant, found[0] * per_row, (fz + sy * uz) / slant
            )
    return seen, red, green, blue


@kernel
def edge_colour(scene, w, look, eye, width, depth, kind, light, red, green, blue, r, c):
    """1 and the radiance of a pixel on a bridge's outline, as its share of stone asks; 0 and its own off any outline.

    All planes are [H, W']. The stone is sampled by four rays; what lies beyond a pixel of the bridge is the mean of its
    neighbours on the other side of the outline, those that lie farther.
    """
    height = kind.shape[0]
    own = kind[r, c] == np.uint8(BRIDGE)
    count = f32(0)
    other_r = f32(0)
    other_g = f32(0)
    other_b = f32(0)
    limit = f32(0) if own else depth[r, c]
    for k in range(4):
        # Up, left, right, down.
        y = min(max(r + (k + 1) // 2 - 1, 0), height - 1)
        x = min(max(c + (k % 3 != 0) * (2 * k - 3), 0), width - 1)
        beyond = ((kind[y, x] == np.uint8(BRIDGE)) != own) & (light[y, x] > f32(0.5))
        # Beside what is nearer, the edge is not the bridge's own, and rays at the bridge can't find it.
        beyond = beyond & ((not own) | (depth[y, x] > depth[r, c]))
        part = f32(1) if beyond else f32(0)
        count += part
        other_r += part * red[y, x]
        other_g += part * green[y, x]
        other_b += part * blue[y, x]
        limit = max(limit, depth[y, x]) if own and beyond else limit
    mixed = count > f32(0) and light[r, c] > f32(0.5)
    if not mixed:
        return f32(0), red[r, c], green[r, c], blue[r, c]
    limit = min(limit, f32(FAR_M))
    share = f32(0)
    stone_r = f32(0)
    stone_g = f32(0)
    stone_b = f32(0)
    for k in range(4):
        # Offsets of -3/8, -1/8, 1/8, 3/8 of a pixel, each once a row and once a column.
        down = (f32(k) - f32(1.5)) * f32(0.25)
        right = (f32((2 * k + 1 - k // 2) & 3) - f32(1.5)) * f32(0.25)
        seen, a, b, d = sample_bridge(scene, w, look, eye, height, r, c, down, right, limit)
        share += f32(0.25) * seen
        stone_r += f32(0.25) * a
        stone_g += f32(0.25) * b
        stone_b += f32(0.25) * d
    through = light[r, c]
    if own:
        # What was drawn there: plants in front, and the stone that the middle of the pixel shows.
        _, a, b, d = sample_bridge(scene, w, look, eye, height, r, c, f32(0), f32(0), f32(FAR_M))
        rest = (f32(1) - share) / count
        return (
            f32(1),
            (red[r, c] - through * a) * share + through * stone_r + other_r * rest,
            (green[r, c] - through * b) * share + through * stone_g + other_g * rest,
            (blue[r, c] - through * d) * share + through * stone_b + other_b * rest,
        )
    rest = f32(1) - share
    return (
        f32(1),
        red[r, c] * rest + through * stone_r,
        green[r, c] * rest + through * stone_g,
        blue[r, c] * rest + through * stone_b,
    )


@kernel
def soften_edges(scene, w, look, eye, width, depth, kind, light, red, green, blue):
    """Mix radiance [H, W'] along the outlines of bridges, so that they run smoothly across the pixels."""
    height = kind.shape[0]
    room = 0
    top = height
    bottom = 0
    for r in range(height):
        here = 0
        for c in range(width):
            own = kind[r, c] == np.uint8(BRIDGE)
            right = kind[r, min(c + 1, width - 1)] == np.uint8(BRIDGE)
            below = kind[min(r + 1, height - 1), c] == np.uint8(BRIDGE)
            here += (1 if own != right else 0) + (1 if own != below else 0)
        room += here
        top = min(top, r) if here > 0 else top
        bottom = r + 1 if here > 0 else bottom
    if room == 0:
        return
    mixed = np.empty((2 * room, 5), np.float32)  # each pixel on an outline is of a pair that differs
    n = 0
    for r in range(top, min(bottom + 1, height)):
        for c in range(width):
            edge, a, b, d = edge_colour(scene, w, look, eye, width, depth, kind, light, red, green, blue, r, c)
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
        red[r, c] = mixed[k, 2]
        green[r, c] = mixed[k, 3]
        blue[r, c] = mixed[k, 4]
