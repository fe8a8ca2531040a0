"""Kernels for the water around props: waves that spread from them, and their mirror images.

The water within a rectangle of pixels around a prop is shaded apart from the rest of the frame, by the same functions:
waves are added to the slopes of its ripples, and mirrored rays meet the largest parts of the prop before they meet
canopies and sky. Only in full quality; in the reduced one water mirrors no props, as it mirrors no woods.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import int32, uint32, uint64

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.camera_rays import (
    HitPoints,
    Radiance,
    column_of,
    hit_points,
    map_origin,
    place_of,
    row_of,
    row_step,
)
from thalweg.render.kernels.fast_math import floor
from thalweg.render.kernels.props import models
from thalweg.render.kernels.props.boxes import pixel_box, rows_of_box, seen_at
from thalweg.render.kernels.props.mirror_rays import MIRRORED_M
from thalweg.render.kernels.props.pose import FADE, depth_of, mirror_box
from thalweg.render.kernels.props.reflections import aim_mirrored, empty_mirror_scratch, mirror_prop
from thalweg.render.kernels.shading import mirror, sky, water
from thalweg.render.kernels.shading.background import CHUNK, SEEN, SHORE_M, fill_up
from thalweg.render.kernels.shading.water_optics import footprint, mirrored_ray
from thalweg.render.kernels.table_lookup import clamp
from thalweg.render.records import layout
from thalweg.render.records.appearance import RIPPLE, RIPPLE_1
from thalweg.render.records.classes import WATER
from thalweg.render.records.props import KIND, PHASE, YAW, X, Y, Z
from thalweg.render.records.view import LANES

f32 = np.float32

WAVE_M = 0.55
"""Length of the waves."""
WAVE_RATE = 2.0
"""Waves that pass by in a period of the prop's motion."""
WAVE_START_M = 0.12
"""Distance from the hull over which they begin."""
WAVES_SEEN_M, WAVES_FADE_M = 26.0, 6.0
"""Depth from which on waves are too fine to be seen, and over how many metres before they fade."""


class Stirred(NamedTuple):
    """Pixels of water around props, and what they would show without them."""

    zones: Any
    """[K, 8] int32, columns from, to and rows from, to of the image that the mirror image of each posed prop may
    touch, and the same for its waves."""
    first: Any
    """[K + 1] int32, where the pixels of each prop begin."""
    places: Any
    """[pixels + LANES] int32, `camera_rays.place_of` with rows counted from the first drawn one."""
    light: Any
    """[pixels] float32, share of the light that plants and props let through."""


class StirredScratch(NamedTuple):
    """Scratch for `CHUNK` pixels of water."""

    depth: Any
    """[CHUNK] float32, metres along the optical axis."""
    points: Any
    """`HitPoints` [CHUNK]."""
    out: Any
    """`Radiance` [CHUNK]."""
    work: Any
    """A `water.WaterScratch` for `CHUNK` points."""
    rays: Any
    """A `reflections.MirrorScratch`, whose arrays are [CHUNK + LANES]."""


@kernel(inlined=True, allocates=False)
def fill_zone(prop, parts, camera, zone):
    """Fill zone [8] with the rectangles of `Stirred.zones` for a prop; parts: its posed ones."""
    kind = int32(prop[KIND])
    c0, c1, r0, r1 = int32(camera.width), int32(0), int32(camera.height), int32(0)
    if depth_of(camera, prop) < f32(MIRRORED_M):
        for k in range(int32(models.KINDS[kind, models.MAIN])):
            if parts[k, FADE] > f32(0):
                a0, a1, b0, b1 = mirror_box(parts[k], camera)
                shown = (a0 < a1) & (b0 < b1)
                c0, c1 = min(c0, a0) if shown else c0, max(c1, a1) if shown else c1
                r0, r1 = min(r0, b0) if shown else r0, max(r1, b1) if shown else r1
    zone[0], zone[1], zone[2], zone[3] = c0, max(c1, c0), r0, max(r1, r0)
    c0, c1, r0, r1 = int32(0), int32(0), int32(0), int32(0)
    if depth_of(camera, prop) < f32(WAVES_SEEN_M):
        px, py, pz = prop[X] - camera.x, prop[Y] - camera.y, prop[Z] - camera.z
        c0, c1, r0, r1 = wave_box(kind, f32(math.cos(prop[YAW])), f32(math.sin(prop[YAW])), px, py, pz, camera)
    zone[4], zone[5], zone[6], zone[7] = c0, c1, r0, r1


@kernel(inlined=True, allocates=False)
def wave_box(kind, cos, sin, px, py, pz, camera):
    """Return the columns from, to and rows from, to of the image that the waves of a kind at px, py, pz metres from the
    camera may touch; cos, sin: of its yaw."""
    across = models.KINDS[kind, models.WAVE_REACH] + models.KINDS[kind, models.HULL_WIDTH]
    ahead_m = models.KINDS[kind, models.HULL_LENGTH] + across
    low_x, high_x, low_y, high_y = f32(1e9), f32(-1e9), f32(1e9), f32(-1e9)
    behind = 0
    for corner in range(4):
        u = ahead_m if corner & 1 else -ahead_m
        v = across if corner & 2 else -across
        ahead, sx, sy = seen_at(camera, px + u * cos - v * sin, py + u * sin + v * cos, pz)
        behind += 1 if ahead < camera.near_m else 0
        low_x, high_x = min(low_x, sx), max(high_x, sx)
        low_y, high_y = min(low_y, sy), max(high_y, sy)
    return pixel_box(camera, behind > 0, low_x, high_x, low_y, high_y)


@kernel(inlined=True, allocates=False)
def fill_zones(view, props, posed, top, rows, zones):
    """Fill the zones [K, 8] of the first K posed props; return how many pixels they have within so many rows from
    `top` on."""
    pixels = 0
    for k in range(len(zones)):
        first = k * models.MOST_PARTS
        parts = posed.parts[first : first + posed.counts[k]]
        fill_zone(props[posed.numbers[k]], parts, view.camera, zones[k])
        for half in range(2):
            _, _, _, _, size = rows_of_box(zones[k, 4 * half : 4 * half + 4], top, rows)
            pixels += size
    return pixels


@kernel
def hold_water(view, props, posed, reduced, top, rows):
    """Take the pixels of water around props out of `Buffers` [R, W'], whose rows begin with row `top` of the image, by
    leaving them no light; returns them as `Stirred`. There are none in the reduced quality."""
    count = 0 if reduced else len(posed.counts)
    zones = np.empty((count, 8), np.int32)
    pixels = fill_zones(view, props, posed, top, len(rows.depth), zones)
    first, places = np.empty(count + 1, np.int32), np.empty(pixels + LANES, np.int32)
    stirred = Stirred(zones, first, places, np.empty(pixels, np.float32))
    gather_water(top, rows, stirred)
    return stirred


@kernel(allocates=False)
def gather_water(top, rows, stirred):
    """Fill all of `Stirred` but its zones, and take the light of its pixels."""
    n = uint32(0)
    for k in range(len(stirred.zones)):
        stirred.first[k] = int32(n)
        m0, m1, top_row, end_row, _ = rows_of_box(stirred.zones[k, :4], top, len(rows.depth))
        for half in range(2):
            c0, c1, r0, r1, _ = rows_of_box(stirred.zones[k, 4 * half : 4 * half + 4], top, len(rows.depth))
            for r in range(r0, r1):
                # The columns of the first rectangle, where the second one has them too, are left out.
                both = (half == 1) & (top_row <= r) & (r < end_row)
                n = gather_span(r, c0, min(c1, m0) if both else c1, rows, stirred, n)
                n = gather_span(r, max(c0, m1) if both else c1, c1, rows, stirred, n)
    stirred.first[len(stirred.zones)] = int32(n)


@kernel(inlined=True, allocates=False)
def gather_span(row, begin, end, rows, stirred, n):
    """Append the pixels of water of a row from column `begin` to `end` to the n of `Stirred`, and take their light;
    returns how many there are then."""
    r = uint32(row)
    for column in range(begin, end):
        c = uint32(column)
        light = rows.transmittance[r, c]
        wet = (rows.kind[r, c] == np.uint8(WATER)) & (rows.water[r, c] >= f32(SHORE_M))
        # A pixel that an earlier zone holds has no light any more.
        held = wet & (light > f32(SEEN))
        # Written in any case, and kept by counting it: a choice would be predicted wrongly too often.
        stirred.places[n] = place_of(int32(row), int32(column))
        stirred.light[n] = light
        rows.transmittance[r, c] = f32(0) if held else light
        n = uint32(n + uint32(held))
    return n


@kernel
def release_water(scene, view, props, posed, top, stirred, rows):
    """Shade the pixels of `Stirred`, add them to `Buffers` [R, W'] and give them their light back."""
    if stirred.first[len(stirred.zones)] > 0:
        span = np.empty((11, CHUNK), np.float32)
        scratch = StirredScratch(
            span[0], HitPoints(span[1], span[2], span[3], span[4], span[5], span[6], span[7]),
            Radiance(span[8], span[9], span[10]), water.empty_scratch(CHUNK), empty_mirror_scratch(),
        )  # fmt: skip
        shade_stirred(scene, view, props, posed, top, stirred, scratch, rows)


@kernel(allocates=False)
def shade_stirred(scene, view, props, posed, top, stirred, scratch, rows):
    """As `release_water`, with `StirredScratch`."""
    camera = view.camera
    origin = map_origin(scene, view)
    inv_cell = scene.constants[view.world, layout.INV_CELL]
    pixel = row_step(camera)
    depth, points, out, _, _ = scratch
    count = stirred.first[len(stirred.zones)]
    padded = fill_up(stirred.places, count)
    # The pixels of all props are shaded together: a chunk has a price, however few pixels it has.
    for begin in range(0, padded, CHUNK):
        n = min(padded - begin, CHUNK)
        places = stirred.places[begin : begin + n]
        for i in range(n):
            depth[i] = rows.depth[uint32(row_of(places[i])), uint32(column_of(places[i]))]
        hit_points(camera, origin, inv_cell, top, places, depth, points, n)
        shade_chunk(scene, view, props, posed, top, stirred, begin, places, pixel, scratch, n)
        sky.add_haze(scene, view, points, out, n)
        for i in range(min(n, count - begin)):
            r, c = uint32(row_of(places[i])), uint32(column_of(places[i]))
            light = stirred.light[uint32(begin + i)]
            rows.red[r, c] += light * out.red[i]
            rows.green[r, c] += light * out.green[i]
            rows.blue[r, c] += light * out.blue[i]
            rows.transmittance[r, c] = light


@kernel(inlined=True, allocates=False)
def shade_chunk(scene, view, props, posed, top, stirred, begin, places, pixel, scratch, n):
    """As `water.shade_water`, for the n points of `StirredScratch` of the pixels from number `begin` on of `Stirred`,
    with all props whose zones touch theirs; pixel: height of a pixel at distance one."""
    _, points, out, work, rays = scratch
    zones = stirred.zones
    water.ripple_surface(scene, view, points, pixel, work.surface, n)
    for j in range(len(zones)):
        first, end = touched_span(stirred, zones[j, 4:], begin, n)
        if first < end:
            prop = props[posed.numbers[j]]
            add_waves(scene, view, prop, zones[j, 4:], top, places, points, pixel, work.surface, first, end - first)
    mirror.mirror_canopy(scene, view, points, pixel, work.surface, work.mirrored, out, n)
    aim_mirrored(scene, view.world, points, pixel, work.surface, rays.rays, n)
    # From far to near, so that the nearest is mirrored last, before all others.
    for j in range(len(zones) - 1, -1, -1):
        first, end = touched_span(stirred, zones[j, :4], begin, n)
        if first < end:
            parts = posed.parts[j * models.MOST_PARTS : j * models.MOST_PARTS + posed.counts[j]]
            prop = props[posed.numbers[j]]
            mirror_prop(scene, view, prop, parts, zones[j], top, places, pixel, work.mirrored, rays, first, end)
    water.compose(scene, view, points, pixel, work.surface, work.mirrored, out, n)


@kernel(inlined=True, allocates=False)
def touched_span(stirred, box, begin, n):
    """Return the first and the end, as multiples of `LANES`, of those of n pixels of `Stirred` from number `begin` on
    that belong to props whose zones touch a rectangle [4]; the end is not after the first if there are none."""
    first, end = int32(n), int32(0)
    for k in range(len(stirred.zones)):
        own = max(stirred.first[k] - int32(begin), int32(0))
        own_end = min(stirred.first[k + 1] - int32(begin), int32(n))
        if own < own_end and zones_touch(stirred.zones[k], box):
            first, end = min(first, own), max(end, own_end)
    return first // int32(LANES) * int32(LANES), (end + int32(LANES - 1)) // int32(LANES) * int32(LANES)


@kernel(inlined=True, allocates=False)
def zones_touch(zone, box):
    """Return whether either rectangle of a zone [8] may have pixels in common with a rectangle [4]."""
    first = (zone[0] < box[1]) & (box[0] < zone[1]) & (zone[2] < box[3]) & (box[2] < zone[3])
    second = (zone[4] < box[1]) & (box[0] < zone[5]) & (zone[6] < box[3]) & (box[2] < zone[7])
    return first | second


@kernel(inlined=True, allocates=False)
def wave(turns):
    """Return a wave of height one at a phase in turns: two parabolas, near to a sine, which vectorise."""
    part = turns - floor(turns)
    half = part if part < f32(0.5) else part - f32(0.5)
    arc = f32(16) * half * (f32(0.5) - half)
    return arc if part < f32(0.5) else -arc


@kernel(inlined=True, disjoint=True, allocates=False)
def add_waves(scene, view, prop, box, top, places, points, pixel, surface, first, n):
    """Add the waves of a prop to n of a `water.Surface`, from number `first` on, at `HitPoints` of pixels at places
    within a box [4]."""
    kind = int32(prop[KIND])
    cell = f32(1) / scene.constants[view.world, layout.INV_CELL]
    # The prop in metres from the map's origin, as the points.
    px = prop[X] - scene.constants[view.world, layout.ORIGIN_X]
    py = prop[Y] - scene.constants[view.world, layout.ORIGIN_Y]
    cos, sin = f32(math.cos(prop[YAW])), f32(math.sin(prop[YAW]))
    steep = models.KINDS[kind, models.WAVE] * min(view.look[RIPPLE] * f32(1 / RIPPLE_1), f32(1.5))
    near = clamp(f32(WAVES_SEEN_M) - depth_of(view.camera, prop), f32(0), f32(WAVES_FADE_M)) * f32(1 / WAVES_FADE_M)
    half, wide = models.KINDS[kind, models.HULL_LENGTH], models.KINDS[kind, models.HULL_WIDTH]
    per_reach = f32(1) / models.KINDS[kind, models.WAVE_REACH]
    beat = f32(WAVE_RATE / (2 * math.pi)) * prop[PHASE]
    x, y, _, sight_x, sight_y, sight_z, distance = points
    slope_x, slope_y, spread, facing, mirror_x, mirror_y, mirror_z = surface
    c0, c1, r0, r1 = box[0], box[1], box[2] - int32(top), box[3] - int32(top)
    for k in range(n):
        # An index that might be negative would not vectorise.
        i = uint64(first + k)
        dx = x[i] * cell - px
        dy = y[i] * cell - py
        along = dx * cos + dy * sin
        # From the nearest point of the hull's middle line.
        back = along - clamp(along, -half, half)
        side = dy * cos - dx * sin
        away = math.sqrt(back * back + side * side) + f32(1e-4)
        far = away - wide
        c, r = column_of(places[i]), row_of(places[i])
        inside = (c >= c0) & (c < c1) & (r >= r0) & (r < r1) & (far > f32(0))
        # What is finer than two pixels is seen as roughness.
        foot = footprint(distance[i], pixel, sight_z[i])
        seen = clamp(f32(1.5) - f32(2 / WAVE_M) * foot, f32(0), f32(1))
        size = steep * near * max(f32(1) - far * per_reach, f32(0)) * min(far * f32(1 / WAVE_START_M), f32(1))
        size = size if inside else f32(0)
        lean = size * seen * wave(far * f32(1 / WAVE_M) - beat) / away
        lean_x = slope_x[i] + lean * (back * cos - side * sin)
        lean_y = slope_y[i] + lean * (back * sin + side * cos)
        slope_x[i] = lean_x
        slope_y[i] = lean_y
        spread[i] += f32(0.5) * size * size * (f32(1) - seen * seen)
        facing[i], mirror_x[i], mirror_y[i], mirror_z[i] = mirrored_ray(
            sight_x[i], sight_y[i], sight_z[i], lean_x, lean_y
        )
