"""Kernels for the share of direct sunlight that passes terrain, plants and bridges on its way to a point.

`ray` is always the unit vector (east, north, up) towards the sun and `frame` the grid's (origin x, origin y, cell) in
metres, all float32. Each node is written by one thread, with its plants in a fixed order, so the result does not depend
on the number of threads.
"""

import math
from functools import partial

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.core.compute.threads import run_in_threads
from thalweg.world.light.crowns import HEIGHT, RADIUS, X, Y, Z, crown_depth, trunk_depth
from thalweg.world.record import PARAPET_THICKNESS_M

f4 = np.float32

SUN_RADIUS = 0.00465
"""Angular radius of the sun's disc in radians: 0.533 degrees across."""
BAND_ROWS = 16
"""Number of rows of nodes that one thread shades at a time."""
BULGE = 1.5
"""Factor on the crown's radius that covers clumps of leaves outside its outline."""
BUCKET_M = 6.0
"""Side of the square buckets for looking up plants."""
BRIDGE_STEP_M = 0.08
"""Step of the ray march through a bridge."""


def band_count(rows: int) -> int:
    """Return the number of bands of `BAND_ROWS` rows."""
    return -(-rows // BAND_ROWS)


@kernel(inlined=True, fastmath=False)
def terrain_share(surface, cell, x, y, z, ray, top):
    """Return the share of the sun's disc that the terrain leaves free, from height z at node coordinates (x, y).

    The march steps one node at a time until the ray is above `top`. The sun's disc gives a penumbra: at distance d it
    is d SUN_RADIUS wide across the ray, and never sharper than a third of a node.
    """
    rows, columns = surface.shape
    flat = math.sqrt(ray[0] * ray[0] + ray[1] * ray[1])
    east = ray[0] / flat
    north = ray[1] / flat
    rise = cell * ray[2] / flat
    # Half the vertical width of the penumbra grows by this per step.
    widening = min(cell * f4(SUN_RADIUS) / (flat * flat), f4(0.5) * rise)
    share = f4(1.0)
    for n in range(1, int((top - z) / rise) + 2):
        px = x + f4(n) * east
        py = y + f4(n) * north
        if px < f4(0.0) or py < f4(0.0) or px > f4(columns - 1) or py > f4(rows - 1):
            break
        j = min(int(px), columns - 2)
        i = min(int(py), rows - 2)
        # Bilinear height of the terrain under the ray.
        fx = px - f4(j)
        fy = py - f4(i)
        low = surface[i, j] + fx * (surface[i, j + 1] - surface[i, j])
        high = surface[i + 1, j] + fx * (surface[i + 1, j + 1] - surface[i + 1, j])
        clearance = z + f4(n) * rise - (low + fy * (high - low))
        # The free share of the disc is linear in the clearance; the tightest point along the ray decides.
        half = max(f4(n) * widening, f4(0.33) * rise)
        share = min(share, f4(0.5) + f4(0.5) * clearance / half)
        if share <= f4(0.0):
            break
    return max(share, f4(0.0))


def terrain_sun(surface: np.ndarray, cell: np.float32, ray: np.ndarray) -> np.ndarray:
    """Return [GY, GX] float32 `terrain_share` at every node of surface [GY, GX]."""
    out = np.empty(surface.shape, np.float32)
    run_in_threads(len(out), partial(_terrain_sun_rows, out, surface, cell, ray, surface.max()))
    return out


@kernel(fastmath=False)
def _terrain_sun_rows(out, surface, cell, ray, top, first, last):
    for i in range(first, last):
        for j in range(out.shape[1]):
            out[i, j] = terrain_share(surface, cell, f4(j), f4(i), surface[i, j], ray, top)


@kernel(fastmath=False)
def add_plant_depth(depth, surface, frame, shadows, ray, outline, tile, first, last):
    """Add to depth [GY, GX] float32 the optical depth of all plants between each node of surface [GY, GX] and the sun.

    Only the bands of `BAND_ROWS` rows from first to last are filled. shadows: the table of plants; boxes [M, 4] int32,
    the first row, last row, first column, last column of each plant's shadow; starts and members: the plants of a band
    are members[starts[band] : starts[band + 1]].
    """
    table, boxes, starts, members = shadows
    rows = len(surface)
    flat = math.sqrt(ray[0] * ray[0] + ray[1] * ray[1])
    for band in range(first, last):
        for member in range(starts[band], starts[band + 1]):
            m = members[member]
            plant = table[m]
            width = plant[RADIUS] * f4(BULGE)
            last = min(boxes[m, 1] + 1, min(rows, (band + 1) * BAND_ROWS))
            for i in range(max(boxes[m, 0], band * BAND_ROWS), last):
                dy = frame[1] + f4(i) * frame[2] - plant[Y]
                for j in range(boxes[m, 2], boxes[m, 3] + 1):
                    dx = frame[0] + f4(j) * frame[2] - plant[X]
                    # Skip nodes beside the shadow and those on the sunny side of the plant.
                    if abs(dx * ray[1] - dy * ray[0]) < width * flat and dx * ray[0] + dy * ray[1] < width * flat:
                        z = surface[i, j] - plant[Z]
                        if z < plant[HEIGHT]:
                            depth[i, j] += crown_depth(plant, dx, dy, z, ray, outline, tile, m)
                            depth[i, j] += trunk_depth(plant, dx, dy, z, ray, f4(0.5) * frame[2])


@kernel(inlined=True, fastmath=False)
def in_bridge(bridge, x, y, z):
    """Return whether a point lies in the stone of a bridge [11]: the body between arch and deck, or a parapet."""
    cos, sin = math.cos(bridge[2]), math.sin(bridge[2])
    # The bridge's own frame; columns are those of `thalweg.world.record.BRIDGE`.
    u = (x - bridge[0]) * cos + (y - bridge[1]) * sin
    v = (y - bridge[1]) * cos - (x - bridge[0]) * sin
    if abs(u) > 0.5 * bridge[3] or abs(v) > 0.5 * bridge[4]:
        return False
    # The deck is a parabola; parapets stand on its two edges.
    deck = bridge[8] - bridge[9] * (2.0 * u / bridge[3]) ** 2
    if abs(v) > 0.5 * bridge[4] - PARAPET_THICKNESS_M:
        deck += bridge[10]
    # Below half an ellipse lies the open arch; beside it the stone reaches down without end.
    across = 2.0 * u / bridge[5]
    arch = bridge[6] + bridge[7] * math.sqrt(1.0 - across * across) if abs(across) < 1.0 else -1e9
    return arch < z < deck


@kernel(inlined=True, fastmath=False)
def bridge_clear(bridge, x, y, z, ray):
    """Return 1 where the ray from (x, y, z) misses the bridge [11], else 0."""
    steps = int((bridge[8] + bridge[10] - z) / (BRIDGE_STEP_M * ray[2])) + 1
    for n in range(steps):
        t = n * BRIDGE_STEP_M
        if in_bridge(bridge, x + t * ray[0], y + t * ray[1], z + t * ray[2]):
            return f4(0.0)
    return f4(1.0)


@kernel(fastmath=False)
def shade_bridges(sun, surface, frame, bridges, ray, first, last):
    """Multiply the rows first to last of sun [GY, GX] by the share that the bridges [B, 11] leave free.

    The share is the mean of four points around each node.
    """
    columns = sun.shape[1]
    quarter = 0.25 * frame[2]
    for i in range(first, last):
        y = frame[1] + i * frame[2]
        for j in range(columns):
            x = frame[0] + j * frame[2]
            z = surface[i, j]
            for b in range(len(bridges)):
                bridge = bridges[b]
                # Nodes out of reach of the shadow are skipped.
                reach = (bridge[8] + bridge[10] - z) / ray[2] + 0.5 * (bridge[3] + bridge[4])
                if (x - bridge[0]) ** 2 + (y - bridge[1]) ** 2 < reach * reach and reach > 0.0:
                    share = f4(0.0)
                    for k in range(4):
                        px = x + quarter * (2 * (k & 1) - 1)
                        py = y + quarter * (2 * (k >> 1) - 1)
                        share += f4(0.25) * bridge_clear(bridge, px, py, z, ray)
                    sun[i, j] *= share


@kernel(fastmath=False)
def shade_points(out, points, own_plant, surface, frame, buckets, bridges, ray, outline, tile, first, last):
    """Fill out[first:last] [P] float32 with the share of sun at points [P, 3] past terrain, bridges and plants.

    `own_plant` [P] is the plant that is left out for a point. buckets: the table of plants, starts, members, columns.
    The plants of bucket (row, column), counted from the grid's origin in squares of `BUCKET_M`, are
    members[starts[k] : starts[k + 1]] with k = row * columns + column.
    """
    table, starts, members, columns = buckets
    bucket_rows = (len(starts) - 1) // columns
    top = surface.max()
    tall = f4(0.0)
    wide = f4(0.0)
    for m in range(len(table)):
        tall = max(tall, table[m, Z] + table[m, HEIGHT])
        wide = max(wide, table[m, RADIUS] * f4(BULGE))
    for p in range(first, last):
        x = points[p, 0]
        y = points[p, 1]
        z = points[p, 2]
        share = terrain_share(surface, frame[2], (x - frame[0]) / frame[2], (y - frame[1]) / frame[2], z, ray, top)
        for b in range(len(bridges)):
            share *= bridge_clear(bridges[b], x, y, z, ray)
        # The buckets under the part of the ray that is lower than the tallest plant.
        length = max(tall - z, f4(0.0)) / ray[2]
        x1 = x + length * ray[0]
        y1 = y + length * ray[1]
        j0 = max(int((min(x, x1) - wide - frame[0]) / f4(BUCKET_M)), 0)
        j1 = min(int((max(x, x1) + wide - frame[0]) / f4(BUCKET_M)), columns - 1)
        i0 = max(int((min(y, y1) - wide - frame[1]) / f4(BUCKET_M)), 0)
        i1 = min(int((max(y, y1) + wide - frame[1]) / f4(BUCKET_M)), bucket_rows - 1)
        depth = f4(0.0)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                for member in range(starts[i * columns + j], starts[i * columns + j + 1]):
                    m = members[member]
                    dx = x - table[m, X]
                    dy = y - table[m, Y]
                    if m != own_plant[p] and abs(dx * ray[1] - dy * ray[0]) < table[m, RADIUS] * f4(BULGE):
                        depth += crown_depth(table[m], dx, dy, z - table[m, Z], ray, outline, tile, m)
        out[p] = share * math.exp(-depth)
