"""Where does each ray of a row meet the ground or the water? A march over the height field, some rays at a time.

`SPAN` neighbouring rays, of pixels or of squares, advance together, so that LLVM works on 8 or 16 of them at once. A
ray's parameter t counts metres along the optical axis. The step is the greatest of three: what the cone above the cell
allows (no surface can be met sooner), a share of the height above the surface, and a least step that grows with
distance.
"""

import math

import numpy as np
from numba import int32, uint32

from thalweg.core.jit import kernel
from thalweg.render.kernels.table_lookup import bilinear, clamp, sloped
from thalweg.render.records import scene as table

f32 = np.float32

MOST_STEPS = 160
LEAST_STEP_M = 0.10
LEAST_STEP_SHARE = 0.008
"""The least step is the greater of LEAST_STEP_M and this share of the distance."""
STEEPEST = 1.0
"""Slope of the ground that a step by height reckons with."""
TRACK = 5
"""Arrays of scratch that the march needs."""
SPAN = 32
"""Rays that a CPU advances together: two of its widest vectors; of more, too many would wait for the slowest."""
SQUARE = 2
"""Pixels a side of the squares that share a march in the modest quality."""
TILE = 8
"""Pixels a side of the bundles of rays that start together."""
BUNDLE_STEPS = 40
"""At most so many steps does a bundle take."""
BUNDLE_LEAST_M = 0.25
"""A bundle that gets on by less than this is left to its rays."""
SETTLE_SHARE = 0.35
"""A ray that would differ in length by more than this share from its square's, at an edge or near the horizon, takes
that one's length."""
FAR_M = 320.0
"""Beyond this all ground is lost in the haze and drawn as the horizon."""


@kernel(inlined=True)
def bundle_spread(eye, height):
    """How far a ray of a tile strays from the one through the tile's middle, in metres per metre along the axis."""
    per_row = f32(2) * eye[12] / f32(height)
    return f32(0.501 * TILE) * math.sqrt(per_row * per_row + eye[13] * eye[13])


@kernel(disjoint=True)
def approach(scene, w, ox, oy, oz, spread, dx, dy, dz, t, n):
    """Advance n bundles of rays from t [n] as far as surely none of their rays meets the surface.

    dx, dy, dz: the bundles' middle rays, as in `march`; spread: how far the other rays stray from them in metres per
    metre along the axis.
    """
    columns = int32(scene.place[w, table.GX])
    rows = int32(scene.place[w, table.GY])
    cone_columns = int32(scene.place[w, table.CONE_X])
    cone_at = int32(scene.place[w, table.CONE_AT])
    cell = f32(1) / scene.number[w, table.INV_CELL]
    cone = scene.cone
    for _ in range(BUNDLE_STEPS):
        active = f32(0)
        for i in range(n):
            ti = t[i]
            x = clamp(ox + dx[i] * ti, f32(0), f32(columns) - f32(1.001))
            y = clamp(oy + dy[i] * ti, f32(0), f32(rows) - f32(1.001))
            column = int32(x) // int32(table.CONE_CELL)
            row = int32(y) // int32(table.CONE_CELL)
            block = uint32(cone_at + int32(2) * (row * cone_columns + column))
            height = cone[block]
            slope = cone[block + uint32(1)]
            # The lowest ray may sink this fast, and the outermost may be so far from the middle one.
            sink = dz[i] - spread
            speed = math.sqrt(dx[i] * dx[i] + dy[i] * dy[i]) * cell + spread
            gap = oz + sink * ti - height - slope * spread * ti
            step = gap / max(slope * speed - sink, f32(1e-6))
            onward = (step > f32(BUNDLE_LEAST_M)) & (ti < f32(FAR_M))
            t[i] = ti + step if onward else ti
            active += f32(1) if onward else f32(0)
        if active == f32(0):
            break


@kernel(disjoint=True)
def march(scene, w, ox, oy, oz, dx, dy, dz, t, hit, track, n):
    """Advance n rays from t [n] until they meet the surface (hit 1) or leave (hit 0); t is then where they meet it.

    Origin ox, oy and directions dx, dy in nodes, heights in metres. t must begin where the ray is above the surface.
    track: TRACK arrays [n] of scratch.
    """
    columns = int32(scene.place[w, table.GX])
    rows = int32(scene.place[w, table.GY])
    at = int32(scene.place[w, table.MAP_AT])
    cone_columns = int32(scene.place[w, table.CONE_X])
    cone_at = int32(scene.place[w, table.CONE_AT])
    cell = f32(1) / scene.number[w, table.INV_CELL]
    summit = scene.number[w, table.TOP_MAX]
    top = scene.top
    cone = scene.cone

    before, gap_before, gap_after, speed, leave = track
    for i in range(n):
        speed[i] = math.sqrt(dx[i] * dx[i] + dy[i] * dy[i]) * cell + f32(1e-9)
        rising = (summit + f32(0.01) - oz) / max(dz[i], f32(1e-9))
        leave[i] = min(rising, f32(FAR_M)) if dz[i] > f32(0) else f32(FAR_M)
        before[i] = t[i]
        gap_before[i] = f32(1)
        gap_after[i] = f32(0)
        hit[i] = f32(0)

    for _ in range(MOST_STEPS):
        active = f32(0)
        for i in range(n):
            ti = t[i]
            x = clamp(ox + dx[i] * ti, f32(0), f32(columns) - f32(1.001))
            y = clamp(oy + dy[i] * ti, f32(0), f32(rows) - f32(1.001))
            z = oz + dz[i] * ti
            column = int32(x)
            row = int32(y)
            u = x - f32(column)
            v = y - f32(row)
            k = at + row * columns + column
            a = top[uint32(k)]
            b = top[uint32(k + 1)]
            c = top[uint32(k + columns)]
            d = top[uint32(k + columns + 1)]
            low = a + (b - a) * u
            high = c + (d - c) * u
            gap = z - (low + (high - low) * v)
            place = (row // int32(table.CONE_CELL)) * cone_columns + column // int32(table.CONE_CELL)
            block = uint32(cone_at + int32(2) * place)
            # In these units a cone of slope s is left behind at the rate s * speed - dz.
            rate = max(cone[block + uint32(1)] * speed[i] - dz[i], f32(1e-6))
            by_cone = (z - cone[block]) / rate
            by_height = gap * f32(0.7) / max(f32(STEEPEST) * speed[i] - dz[i], f32(0.05))
            least = max(f32(LEAST_STEP_M), f32(LEAST_STEP_SHARE) * ti)
            running = (hit[i] == f32(0)) & (ti < leave[i])
            below = gap <= f32(0)
            met = running & below
            onward = running & (gap > f32(0))
            hit[i] = f32(1) if met else hit[i]
            gap_after[i] = gap if met else gap_after[i]
            before[i] = ti if onward else before[i]
            gap_before[i] = gap if onward else gap_before[i]
            t[i] = ti + max(max(by_cone, by_height), least) if onward else ti
            active += f32(1) if onward else f32(0)
        if active == f32(0):
            break

    for i in range(n):
        # The secant through the last point above and the first below, and once more from there.
        t0 = before[i]
        t1 = t[i]
        g0 = gap_before[i]
        g1 = gap_after[i]
        tm = t0 + (t1 - t0) * g0 / max(g0 - g1, f32(1e-6))
        gm = oz + dz[i] * tm - bilinear(top, at, columns, rows, ox + dx[i] * tm, oy + dy[i] * tm)
        t0 = tm if gm > f32(0) else t0
        g0 = gm if gm > f32(0) else g0
        t1 = t1 if gm > f32(0) else tm
        g1 = g1 if gm > f32(0) else gm
        tm = t0 + (t1 - t0) * g0 / max(g0 - g1, f32(1e-6))
        t[i] = tm if hit[i] > f32(0) else min(t1, leave[i])
        # Sloping down for ever: far ground, whose colour is the horizon's.
        hit[i] = f32(0) if t[i] >= f32(FAR_M) else hit[i]


@kernel(disjoint=True)
def touch(scene, w, ox, oy, oz, dx, dy, t, tilt_x, tilt_y, gap, n):
    """The plane that touches the surface where each of n rays has got to.

    tilt_x, tilt_y [n]: its rise in metres per node; gap [n]: metres from the eye straight down to it. Other arguments
    as of `march`.
    """
    columns = int32(scene.place[w, table.GX])
    rows = int32(scene.place[w, table.GY])
    at = int32(scene.place[w, table.MAP_AT])
    for i in range(n):
        height, across, along = sloped(scene.top, at, columns, rows, ox + dx[i] * t[i], oy + dy[i] * t[i])
        tilt_x[i] = across
        tilt_y[i] = along
        gap[i] = oz - height + (across * dx[i] + along * dy[i]) * t[i]


@kernel(disjoint=True)
def settle(tilt_x, tilt_y, gap, met, dx, dy, dz, t, n):
    """How far n rays of a row go to the planes of `touch`, two neighbours to a plane: t [n].

    tilt_x, tilt_y, gap, met [n / 2]: the planes, and how far the ray through the middle of a square went.
    """
    for i in range(n):
        k = uint32(i // SQUARE)
        rate = tilt_x[k] * dx[i] + tilt_y[k] * dy[i] - dz[i]
        there = gap[k] / max(rate, f32(1e-6))
        t[i] = there if abs(there - met[k]) < f32(SETTLE_SHARE) * met[k] else met[k]


@kernel(disjoint=True)
def wetness(scene, w, ox, oy, dx, dy, t, wet, n):
    """Depth of the water [n] where each ray has got to; not above zero on dry ground."""
    columns = int32(scene.place[w, table.GX])
    rows = int32(scene.place[w, table.GY])
    at = int32(scene.place[w, table.MAP_AT])
    depth = scene.depth
    for i in range(n):
        wet[i] = bilinear(depth, at, columns, rows, ox + dx[i] * t[i], oy + dy[i] * t[i])
