"""Scalar table look-ups: bilinear heights, paint, the ripple tile and the sky, inlined into the loops that call them.

Points are in node coordinates: their distance from the grid's origin in cells. Indices are clamped, so that the border
of a map continues outside it. Indices into tables are uint32, for which Numba leaves out the wraparound of negative
ones.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import int32, uint32

from thalweg.core.compute.jit import kernel
from thalweg.render.bake import ripples, sky
from thalweg.render.kernels.fast_math import floor
from thalweg.render.records import layout

f32 = np.float32


@kernel(inlined=True, allocates=False)
def clamp(value, low, high):
    """Return the value limited to low..high."""
    return min(max(value, low), high)


class HeightMap(NamedTuple):
    """One of a world's maps of heights: `Scene.top` or `Scene.depth`."""

    codes: Any
    """[nodes] uint32 of all worlds."""
    at: Any
    """Index at which this world's map begins, int32, as the next two: its size."""
    columns: Any
    rows: Any
    base: Any
    """Metres that code 0 stands for, and those from one code to the next."""
    step: Any


@kernel(inlined=True, allocates=False)
def height_map(scene, world, codes, base, step):
    """Return a `HeightMap` of a world from those of its fields that its maps differ by."""
    return HeightMap(
        codes,
        int32(scene.extents[world, layout.MAP_AT]),
        int32(scene.extents[world, layout.GX]),
        int32(scene.extents[world, layout.GY]),
        base,
        step,
    )


@kernel(inlined=True, allocates=False)
def top_map(scene, world):
    """Return the `HeightMap` of a world's upper surface."""
    number = scene.constants
    return height_map(scene, world, scene.top, number[world, layout.TOP_BASE], number[world, layout.TOP_STEP])


@kernel(inlined=True, allocates=False)
def depth_map(scene, world):
    """Return the `HeightMap` of a world's water: its surface minus the ground."""
    number = scene.constants
    return height_map(scene, world, scene.depth, number[world, layout.DEPTH_BASE], number[world, layout.DEPTH_STEP])


@kernel(inlined=True, allocates=False)
def within_map(heights, x, y):
    """Return node coordinates limited to those that have four nodes around them."""
    # A little less than the last node, so that its right neighbour still exists.
    return clamp(x, f32(0), f32(heights.columns) - f32(1.001)), clamp(y, f32(0), f32(heights.rows) - f32(1.001))


@kernel(inlined=True, allocates=False)
def corner_codes(heights, column, row):
    """Return the codes of a node, of the next ones in x and in y, and of that in both, as floats."""
    k = heights.at + row * heights.columns + column
    left = heights.codes[uint32(k)]
    right = heights.codes[uint32(k + int32(1))]
    low = uint32(0xFFFF)
    return f32(int32(left & low)), f32(int32(right & low)), f32(int32(left >> 16)), f32(int32(right >> 16))


@kernel(inlined=True, allocates=False)
def bilinear(heights, x, y):
    """Return the height in metres at node coordinates x, y of a `HeightMap`, interpolated between its four nodes."""
    x, y = within_map(heights, x, y)
    column = int32(x)
    row = int32(y)
    u = x - f32(column)
    v = y - f32(row)
    a, b, c, d = corner_codes(heights, column, row)
    low = a + (b - a) * u
    high = c + (d - c) * u
    return heights.base + heights.step * (low + (high - low) * v)


@kernel(inlined=True, allocates=False)
def sloped(heights, x, y):
    """Return the value of `bilinear` and its rise per node in x and in y; the map is level outside its edges."""
    inside_x, inside_y = within_map(heights, x, y)
    # The clamped coordinate does not move outside, so the slope there must be zero.
    rise_x = heights.step if x == inside_x else f32(0)
    rise_y = heights.step if y == inside_y else f32(0)
    column = int32(inside_x)
    row = int32(inside_y)
    u = inside_x - f32(column)
    v = inside_y - f32(row)
    a, b, c, d = corner_codes(heights, column, row)
    low = a + (b - a) * u
    high = c + (d - c) * u
    height = heights.base + heights.step * (low + (high - low) * v)
    return height, ((b - a) + (d - c - b + a) * v) * rise_x, (high - low) * rise_y


@kernel(inlined=True, allocates=False)
def channel(packed, shift):
    """Return one byte of a packed texel as a float in 0..255."""
    return f32(int32((packed >> uint32(shift)) & uint32(255)))


@kernel(inlined=True, allocates=False)
def mix_texels(a, b, c, d, u, v):
    """Return four channels (0..255) interpolated between four packed texels."""
    wa = (f32(1) - u) * (f32(1) - v)
    wb = u * (f32(1) - v)
    wc = (f32(1) - u) * v
    wd = u * v
    red = channel(a, 0) * wa + channel(b, 0) * wb + channel(c, 0) * wc + channel(d, 0) * wd
    green = channel(a, 8) * wa + channel(b, 8) * wb + channel(c, 8) * wc + channel(d, 8) * wd
    blue = channel(a, 16) * wa + channel(b, 16) * wb + channel(c, 16) * wc + channel(d, 16) * wd
    fourth = channel(a, 24) * wa + channel(b, 24) * wb + channel(c, 24) * wc + channel(d, 24) * wd
    return red, green, blue, fourth


@kernel(inlined=True, allocates=False)
def paint_level(paint, begin, columns, rows, x, y, level):
    """Return four channels (0..255) of the paint on one mip level; columns and rows are those of level 0."""
    # Texels of level 0 have their middles on nodes; half a texel is added and taken off around the change of size.
    shrink = f32(1) / f32(int32(1) << level)
    wide = int32(columns) >> level
    high = int32(rows) >> level
    px = clamp((x + f32(0.5)) * shrink - f32(0.5), f32(0), f32(wide) - f32(1.001))
    py = clamp((y + f32(0.5)) * shrink - f32(0.5), f32(0), f32(high) - f32(1.001))
    column = int32(px)
    row = int32(py)
    k = begin + row * wide + column
    return mix_texels(
        paint[uint32(k)],
        paint[uint32(k + 1)],
        paint[uint32(k + wide)],
        paint[uint32(k + wide + 1)],
        px - f32(column),
        py - f32(row),
    )


@kernel(inlined=True, allocates=False)
def tile_level(tile, x, y, level):
    """Return four channels (0..255) of the repeating ripple tile on one mip level, at texel coordinates of level 0."""
    size = int32(ripples.SIZE) >> level
    # Levels follow one another: the sum of the geometric series of their sizes.
    begin = (int32(ripples.SIZE * ripples.SIZE) - size * size) * int32(4) // int32(3)
    shrink = f32(1) / f32(int32(1) << level)
    px = (x + f32(0.5)) * shrink - f32(0.5)
    py = (y + f32(0.5)) * shrink - f32(0.5)
    floor_x = floor(px)
    floor_y = floor(py)
    # The size is a power of two, so that a mask wraps an index around, negative ones too.
    mask = size - int32(1)
    column = int32(floor_x) & mask
    row = int32(floor_y) & mask
    right = (column + int32(1)) & mask
    above = (row + int32(1)) & mask
    return mix_texels(
        tile[uint32(begin + row * size + column)],
        tile[uint32(begin + row * size + right)],
        tile[uint32(begin + above * size + column)],
        tile[uint32(begin + above * size + right)],
        px - floor_x,
        py - floor_y,
    )


@kernel(inlined=True, allocates=False)
def sky_at(table, begin, dx, dy, dz):
    """Return the radiance of the sky in a direction of any length: red, green, blue. See `thalweg.render.bake.sky`."""
    # The azimuth is measured along the unit diamond instead of the circle, which needs no arc tangent.
    flat = abs(dx) + abs(dy) + f32(1e-12)
    sine = dz / math.sqrt(dx * dx + dy * dy + dz * dz)
    # Rows are spaced as the root of the sine, so that most lie near the horizon, where the sky changes most.
    root = math.sqrt(abs(sine))
    v = (f32(0.5) + f32(0.5) * (root if sine > f32(0) else -root)) * f32(sky.ROWS) - f32(0.5)
    east = dx / flat
    turn = f32(1) - east if dy >= f32(0) else f32(3) + east
    u = turn * f32(sky.COLUMNS / 4) - f32(0.5)
    u = u + f32(sky.COLUMNS) if u < f32(0) else u
    v = clamp(v, f32(0), f32(sky.ROWS - 1.001))
    column = int32(u)
    row = int32(v)
    right = (column + int32(1)) & int32(sky.COLUMNS - 1)
    column = column & int32(sky.COLUMNS - 1)
    k = begin + row * int32(sky.COLUMNS)
    red, green, blue, _ = mix_texels(
        table[uint32(k + column)],
        table[uint32(k + right)],
        table[uint32(k + int32(sky.COLUMNS) + column)],
        table[uint32(k + int32(sky.COLUMNS) + right)],
        u - floor(u),
        v - f32(row),
    )
    scale = f32(sky.CODE_RANGE / 255.0**2)
    return red * red * scale, green * green * scale, blue * blue * scale
