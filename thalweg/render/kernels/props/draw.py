"""Kernels that draw props over the rows of a frame, in the rectangles of pixels that their parts may touch.

A prop is drawn tile by tile of its rectangle, and each of its parts over all rays of a tile that may meet it. Two
layers of a pixel are kept in order of depth, so that parts that stand in one another are seen as they should be. A
pixel has the class and the depth of a prop that covers half of it or more. Props are drawn after ground, water and
bridges, and before plants, which hide them.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import int32, uint32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.camera_rays import column_of, place_of, row_of, row_step
from thalweg.render.kernels.props import models
from thalweg.render.kernels.props.boxes import rows_of_box
from thalweg.render.kernels.props.layers import (
    HALF,
    LEAST_COVER,
    Layers,
    is_hidden,
    layered,
    no_layers,
    seen_depth,
    sharpness,
    sight_at,
    total_cover,
    uncut_share,
)
from thalweg.render.kernels.props.marks import MARK_COLUMNS, mark
from thalweg.render.kernels.props.models import CONE, CUBE
from thalweg.render.kernels.props.paint import sight_radiance
from thalweg.render.kernels.props.pose import (
    C0,
    C1,
    FADE,
    R0,
    R1,
    SHAPE,
    TAPER,
    solid_ray,
)
from thalweg.render.kernels.props.posed_props import pixels_of
from thalweg.render.kernels.props.rays import any_at_least, empty_part_rays, hit_of, put_hit
from thalweg.render.kernels.props.solids import meet_cone, meet_cube, meet_sphere
from thalweg.render.kernels.shading.background import CHUNK, fill_up
from thalweg.render.records.classes import WATER
from thalweg.render.records.props import CLASS_OFFSET, KIND
from thalweg.render.records.view import COLOURS, LANES, MASK

f32 = np.float32


class Tile(NamedTuple):
    """Scratch for a tile, which is up to `CHUNK` pixels of the rectangle of a prop, row after row."""

    places: Any
    """[CHUNK + LANES] int32: `camera_rays.place_of`, with rows counted from the first drawn one."""
    behind: Any
    """[CHUNK + LANES] float32, depth of what a pixel shows without the prop, as all that follow."""
    sharp: Any
    """`layers.sharpness` of that."""
    layers: Any
    """`Layers` of arrays, which hold something only for pixels of which `cover` is not 0."""
    touched: Any
    """[CHUNK] int32, numbers of those pixels, as the parts meet them."""


class TileArea(NamedTuple):
    """Where a tile is: rows from, to, counted from the first drawn one, and columns from, to."""

    r0: Any
    r1: Any
    c0: Any
    c1: Any


@kernel
def empty_tile(some):
    """Return a `Tile` without values; if not some, without any room."""
    size = CHUNK + LANES if some else 0
    a = np.empty((12, size), np.float32)
    layers = Layers(a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10], a[11])
    return Tile(np.empty(size, np.int32), a[0], a[1], layers, np.empty(size, np.int32))


@kernel
def draw_props(scene, view, props, posed, top, drawn, depth, kind):
    """Set depth and kind [R, W'] where a prop covers half of a pixel; returns the marks [M, MARK_COLUMNS] of all pixels
    that show any of one, near props first.

    posed: the `PosedProps` of the view. drawn: see `Output`; without colours there are no marks, and for a mask only
    pixels that show water count.
    """
    pixels = pixels_of(posed.boxes, top, len(depth))
    marks = np.empty((pixels if drawn == COLOURS else 0, MARK_COLUMNS), np.float32)
    tile, work = empty_tile(pixels > 0), empty_part_rays(pixels > 0)
    met = meet_props(scene, view, props, posed, top, drawn, depth, kind, tile, work, marks)
    return marks[:met]


@kernel(allocates=False)
def meet_props(scene, view, props, posed, top, drawn, depth, kind, tile, work, marks):
    """Fill marks, of `draw_props`, and set depth and kind [R, W']; returns how many marks there are.

    tile: a `Tile`; work: `PartRays`.
    """
    n = 0
    for k in range(len(posed.counts)):
        c0, c1, r0, r1, size = rows_of_box(posed.boxes[k], top, len(depth))
        if size == 0:
            continue
        first = k * models.MOST_PARTS
        parts = posed.parts[first : first + posed.counts[k]]
        own = np.uint8(int32(props[posed.numbers[k], KIND]) + int32(CLASS_OFFSET))
        wide = min(c1 - c0, int32(CHUNK))
        high = int32(CHUNK) // wide
        for left in range(c0, c1, wide):
            for upper in range(r0, r1, high):
                area = TileArea(int32(upper), int32(min(upper + high, r1)), int32(left), int32(min(left + wide, c1)))
                fill_tile(view.camera, top, area, drawn, depth, kind, tile)
                touched = int32(0)
                for j in range(len(parts)):
                    touched = draw_part(scene, view, parts[j], top, area, drawn, tile, work, touched)
                n = mark_tile(own, drawn, tile, touched, depth, kind, marks, n)
    return n


@kernel(inlined=True, allocates=False)
def fill_tile(camera, top, area, drawn, depth, kind, tile):
    """Fill the `Tile` of a `TileArea` from depth and kind [R, W'], without any part of a prop."""
    # Here and below, numbers of pixels have no sign: an index that might be negative takes longer.
    n = uint32(0)
    for r in range(area.r0, area.r1):
        for c in range(area.c0, area.c1):
            on_water = kind[uint32(r), uint32(c)] == np.uint8(WATER)
            tile.places[n] = place_of(int32(r), int32(c))
            # Where there is no water, a mask stays as it is: nothing is before what lies behind the camera.
            tile.behind[n] = depth[uint32(r), uint32(c)] if on_water or drawn != MASK else f32(-1)
            tile.sharp[n] = f32(1) if on_water else f32(0)
            n = uint32(n + uint32(1))
    clear_tile(camera, top, tile.places, tile.behind, tile.sharp, tile.layers.cover, fill_up(tile.places, int32(n)))


@kernel(inlined=True, disjoint=True, allocates=False)
def clear_tile(camera, top, places, behind, sharp, cover, n):
    """Turn the marks of water in `sharp` into what a `Tile` has there, and let its n `Layers` cover nothing."""
    for i in range(n):
        sight = sight_at(camera, top, places[i])
        sharp[i] = sharpness(camera, sight.z, behind[i], sharp[i] > f32(0))
        cover[i] = f32(0)


@kernel(inlined=True, allocates=False)
def put_layers(layers, i, found):
    """Store `Layers` as number i of those of arrays."""
    layers.cover[i], layers.t[i] = found.cover, found.t
    layers.red[i], layers.green[i], layers.blue[i] = found.red, found.green, found.blue
    layers.back_cover[i], layers.back_t[i] = found.back_cover, found.back_t
    layers.back_red[i], layers.back_green[i], layers.back_blue[i] = found.back_red, found.back_green, found.back_blue


@kernel(inlined=True, allocates=False)
def layers_of(layers, i):
    """Return number i of `Layers` of arrays."""
    return Layers(
        layers.cover[i], layers.t[i], layers.red[i], layers.green[i], layers.blue[i],
        layers.back_cover[i], layers.back_t[i], layers.back_red[i], layers.back_green[i], layers.back_blue[i],
    )  # fmt: skip


@kernel(inlined=True, allocates=False)
def index_of(area, place):
    """Return which pixel of a tile the one at a place is."""
    return uint32((row_of(place) - area.r0) * (area.c1 - area.c0) + column_of(place) - area.c0)


@kernel(inlined=True, allocates=False)
def draw_part(scene, view, part, top, area, drawn, tile, work, touched):
    """Add a posed part [PART_COLUMNS] to the `Layers` of a `Tile`, of which so many pixels are touched already; returns
    how many there are then. work: `PartRays`."""
    count = list_pixels(part, top, area, work.keys)
    # All rays meet the part; then those that see it meet it once more, side by side, to be painted. Two calls in a row
    # would inline the three solids twice, and compile for longer: a loop has them once.
    for painted in range(2 if drawn == COLOURS else 1):
        if count == 0:
            return touched
        n = fill_up(work.keys, count)
        meet_pixels(view.camera, part, top, work.keys, work.hits, n)
        if painted:
            paint_pixels(scene, view, part, row_step(view.camera), top, work.keys, work.hits, work.out, n)
        else:
            cut_hits(view.camera, part[FADE], area, work.keys, tile.behind, tile.sharp, work.hits, n)
            count = keep_seen_pixels(work, count)
    return add_hits(area, tile, work, drawn == COLOURS, count, touched)


@kernel(inlined=True, allocates=False)
def list_pixels(part, top, area, places):
    """Fill places with those of the pixels of a `TileArea` that a posed part may touch; returns how many there are."""
    n = 0
    for r in range(max(int32(part[R0]) - int32(top), area.r0), min(int32(part[R1]) - int32(top), area.r1)):
        for c in range(max(int32(part[C0]), area.c0), min(int32(part[C1]), area.c1)):
            places[n] = place_of(int32(r), int32(c))
            n += 1
    return n


@kernel(inlined=True, disjoint=True, allocates=False)
def meet_pixels(camera, part, top, places, hits, n):
    """Fill hits [n] with those of the rays through the pixels at places [n] with a posed part."""
    # One loop for each solid: a choice within a loop would compute all of them.
    if part[SHAPE] == f32(CUBE):
        for i in range(n):
            put_hit(hits, i, meet_cube(ray_to(camera, part, top, places[i])))
    elif part[SHAPE] == f32(CONE):
        for i in range(n):
            put_hit(hits, i, meet_cone(part[TAPER], ray_to(camera, part, top, places[i])))
    else:
        for i in range(n):
            put_hit(hits, i, meet_sphere(ray_to(camera, part, top, places[i])))


@kernel(inlined=True, allocates=False)
def ray_to(camera, part, top, place):
    """Return the `SolidRay` through the pixel at a place in the coordinates of a posed part."""
    sight = sight_at(camera, top, place)
    return solid_ray(part, camera, sight.sx, sight.sy)


@kernel(inlined=True, disjoint=True, allocates=False)
def cut_hits(camera, fade, area, keys, behind, sharp, hits, n):
    """Reduce the covers of hits [n] of the rays through the pixels `keys` [n] of a tile by `FADE`, and by what the
    `Tile` has behind the part."""
    for i in range(n):
        at = index_of(area, keys[i])
        hits.cover[i] = hits.cover[i] * fade * uncut_share(camera, hits.t[i], behind[at], sharp[at])


@kernel(inlined=True, allocates=False)
def keep_seen_pixels(work, count):
    """Move the keys, covers and t of those of `count` rays of `PartRays` that see a part to the front; returns how many
    there are."""
    kept = uint32(0)
    for first in range(0, count, LANES):
        if any_at_least(work.hits.cover, first, f32(LEAST_COVER)):
            for k in range(first, min(first + LANES, count)):
                i = uint32(k)
                cover = work.hits.cover[i]
                # Written in any case, and kept by counting it.
                work.keys[kept], work.cover[kept], work.t[kept] = work.keys[i], cover, work.hits.t[i]
                kept = uint32(kept + uint32(cover >= f32(LEAST_COVER)))
    return int32(kept)


@kernel(inlined=True, disjoint=True, allocates=False)
def paint_pixels(scene, view, part, pixel, top, places, hits, out, n):
    """Fill `Radiance` [n] with that of a posed part where the rays through the pixels at places [n] meet it, at hits
    [n]; pixel: height of a pixel at distance one."""
    for i in range(n):
        sight = sight_at(view.camera, top, places[i])
        out.red[i], out.green[i], out.blue[i] = sight_radiance(scene, view, part, pixel, sight, hit_of(hits, i))


@kernel(inlined=True, allocates=False)
def add_hits(area, tile, work, coloured, count, touched):
    """Add the first `count` of the rays that `PartRays` keep, painted if coloured, to the `Layers` of a `Tile`, of
    which so many pixels are touched already; returns how many there are then."""
    for i in range(count):
        at = index_of(area, work.keys[i])
        found = no_layers()
        if tile.layers.cover[at] > f32(0):
            found = layers_of(tile.layers, at)
        else:
            tile.touched[uint32(touched)] = int32(at)
            touched += int32(1)
        cover, t = work.cover[i], work.t[i]
        share = f32(0) if not coloured or is_hidden(found, t) else cover
        red, green, blue = f32(0), f32(0), f32(0)
        if share > f32(0):
            red, green, blue = share * work.out.red[i], share * work.out.green[i], share * work.out.blue[i]
        put_layers(tile.layers, at, layered(found, cover, t, red, green, blue))
    return touched


@kernel(inlined=True, allocates=False)
def mark_tile(own, drawn, tile, touched, depth, kind, marks, n):
    """Append the pixels of a `Tile` that are touched to the n marks, and set depth and kind [R, W']; returns how many
    marks there are then. own: the prop's class."""
    for k in range(touched):
        at = uint32(tile.touched[k])
        r, c = uint32(row_of(tile.places[at])), uint32(column_of(tile.places[at]))
        layers = layers_of(tile.layers, at)
        cover = total_cover(layers)
        shown = cover >= f32(HALF)
        met = seen_depth(layers, cover)
        if drawn == COLOURS:
            mark(marks[n], r, c, cover, layers, depth[r, c], kind[r, c], met, own if shown else np.uint8(0))
            n += 1
        depth[r, c] = met if shown else depth[r, c]
        kind[r, c] = own if shown else kind[r, c]
    return n
