"""Kernels for the water around props: waves that spread from them, and their mirror images.

The water within a rectangle of pixels around a prop is shaded apart from the rest of the frame, by the same functions:
waves are added to the slopes of its ripples, and mirrored rays meet the largest parts of the prop before they meet
canopies and sky. Only in full quality; in the reduced one water mirrors no props, as it mirrors no woods.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import int32

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
    """[pixels] int32, `camera_rays.place_of` with rows counted from the first drawn one."""
    light: Any
    """[pixels] float32, share of the light that plants and props let through."""


class StirredScratch(NamedTuple):
    """Scratch for `CHUNK` pixels of water."""

    depth: Any
    """[CHUNK] float32, metres along the optical axis."""
    places: Any
    """[CHUNK + LANES] int32, as `Stirred.places`, filled up to whole vectors."""
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
    stirred = Stirred(zones, np.empty(count + 1, np.int32), np.empty(pixels, np.int32), np.empty(pixels, np.float32))
    gather_water(top, rows, stirred)
    return stirred


@kernel(allocates=False)
def gather_water(top, rows, stirred):
    """Fill all of `Stirred` but its zones, and take the light of its pixels."""
    n = 0
    for k in range(len(stirred.zones)):
        stirred.first[k] = n
        for half in range(2):
            box = stirred.zones[k, 4 * half : 4 * half + 4]
            c0, c1, r0, r1, _ = rows_of_box(box, top, len(rows.depth))
            for r in range(r0, r1):
                for c in range(c0, c1):
                    light = rows.transmittance[r, c]
                    wet = (rows.kind[r, c] == np.uint8(WATER)) & (rows.water[r, c] >= f32(SHORE_M))
                    # A pixel that an earlier zone holds has no light any more.
                    held = wet & (light > f32(SEEN))
                    # Written in any case, and kept by counting it: a choice would be predicted wrongly too often.
                    stirred.places[n] = place_of(int32(r), int32(c))
                    stirred.light[n] = light
                    rows.transmittance[r, c] = f32(0) if held else light
                    n += int32(held)
    stirred.first[len(stirred.zones)] = n


@kernel
def release_water(scene, view, props, posed, top, stirred, rows):
    """Shade the pixels of `Stirred`, add them to `Buffers` [R, W'] and give them their light back."""
    if stirred.first[len(stirred.zones)] > 0:
        span = np.empty((11, CHUNK), np.float32)
        scratch = StirredScratch(
            span[0], np.empty(CHUNK + LANES, np.int32),
            HitPoints(span[1], span[2], span[3], span[4], span[5], span[6], span[7]),
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
    depth, places, points, out, _, _ = scratch
    for k in range(len(stirred.zones)):
        for begin in range(stirred.first[k], stirred.first[k + 1], CHUNK):
            n = min(stirred.first[k + 1] - begin, CHUNK)
            for i in range(n):
                places[i] = stirred.places[begin + i]
            padded = fill_up(places, n)
            for i in range(padded):
                depth[i] = rows.depth[row_of(places[i]), column_of(places[i])]
            hit_points(camera, origin, inv_cell, top, places, depth, points, padded)
            shade_chunk(scene, view, props, posed, top, stirred.zones, k, pixel, scratch, padded)
            sky.add_haze(scene, view, points, out, padded)
            for i in range(n):
                r, c = row_of(places[i]), column_of(places[i])
                light = stirred.light[begin + i]
                rows.red[r, c] += light * out.red[i]
                rows.green[r, c] += light * out.green[i]
                rows.blue[r, c] += light * out.blue[i]
                rows.transmittance[r, c] = light


@kernel(allocates=False)
def shade_chunk(scene, view, props, posed, top, zones, k, pixel, scratch, n):
    """As `water.shade_water`, for the n points of `StirredScratch`, which are in the zone of posed prop k, with all
    props whose zones touch it; pixel: height of a pixel at distance one."""
    _, places, points, out, work, rays = scratch
    water.ripple_surface(scene, view, points, pixel, work.surface, n)
    for j in range(len(zones)):
        if zones_touch(zones[k], zones[j, 4:]):
            prop = props[posed.numbers[j]]
            add_waves(scene, view, prop, zones[j, 4:], top, places, points, pixel, work.surface, n)
    mirror.mirror_canopy(scene, view, points, pixel, work.surface, work.mirrored, out, n)
    aim_mirrored(scene, view.world, points, pixel, work.surface, rays.rays, n)
    # From far to near, so that the nearest is mirrored last, before all others.
    for j in range(len(zones) - 1, -1, -1):
        if zones_touch(zones[k], zones[j, :4]):
            first = j * models.MOST_PARTS
            parts = posed.parts[first : first + posed.counts[j]]
            prop = props[posed.numbers[j]]
            mirror_prop(scene, view, prop, parts, zones[j], top, places, pixel, work.mirrored, rays, n)
    water.compose(scene, view, points, pixel, work.surface, work.mirrored, out, n)


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


@kernel(disjoint=True, allocates=False)
def add_waves(scene, view, prop, box, top, places, points, pixel, surface, n):
    """Add the waves of a prop to a `water.Surface` [n] at `HitPoints` of pixels at places [n] within a box [4]."""
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
    for i in range(n):
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
