"""Kernels that shade what lies behind the plants: sky, water and ground.

Pixels are gathered by what they show, from all rows of a band, so that each kind is shaded in loops over dense arrays.
Their number is filled up to whole vectors by copies of the last pixel: a loop's remainder, which LLVM does not
vectorise, would take longer than the rest of it.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import int32, uint32

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
from thalweg.render.kernels.shading import ground, quay, reduced_quality, sky, water
from thalweg.render.kernels.shading.shore import DEEPEST_M, covered_share, water_shares
from thalweg.render.kernels.terrain.heightfield_march import TILE
from thalweg.render.records import layout
from thalweg.render.records.classes import GROUND, SKY, WATER
from thalweg.render.records.view import LANES, Buffers

f32 = np.float32

SEEN = 0.004
"""Pixels whose plants let through less than this are not shaded."""
ROWS_TOGETHER = TILE
"""Rows of a band. Those that a thread draws begin at multiples of this."""
CHUNK = 512
"""Most pixels that are shaded together: their scratch fits into a processor's second cache."""
SHORE_M = 0.5 * DEEPEST_M + 0.001
"""Where the water is deeper, or the ground higher, than this, no shore crosses the pixel."""
KINDS = 3
"""Classes that are shaded here: `SKY`, `WATER` and `GROUND`."""


class Gathered(NamedTuple):
    """The pixels of a band by what they show, and scratch for shading them."""

    places: Any
    """[KINDS, pixels of a band + LANES] int32: `camera_rays.place_of` of the pixels that show each class, with rows
    counted from the first of the band."""
    shore: Any
    """[pixels of a band + LANES] int32: places of the pixels that may show both water and ground."""
    wet: Any
    """[pixels of a band] float32: the share of water in each."""
    depth: Any
    """[CHUNK] float32, of the pixels that are shaded together, as all that follow."""
    kind: Any
    """[CHUNK] uint8."""
    points: Any
    """`HitPoints`."""
    out: Any
    """`Radiance`."""
    work: Any
    """A `water.WaterScratch`."""


@kernel
def empty_gathered(wide):
    """`Gathered` without values for bands of rows of W' pixels."""
    size = ROWS_TOGETHER * wide
    # One list for each class and one for the shore, whose pixels are then added to water or ground, or to both.
    places = np.empty((KINDS + 1, size + LANES), np.int32)
    span = np.empty((11, CHUNK), np.float32)
    return Gathered(
        places[:KINDS], places[KINDS], np.empty(size, np.float32), span[0], np.empty(CHUNK, np.uint8),
        HitPoints(span[1], span[2], span[3], span[4], span[5], span[6], span[7]),
        Radiance(span[8], span[9], span[10]), water.empty_scratch(CHUNK),
    )  # fmt: skip


@kernel
def flattened(buffers):
    """`Buffers` [R, W'] as arrays [R * W'], without a copy."""
    return Buffers(
        buffers.depth.reshape(-1),
        buffers.kind.reshape(-1),
        buffers.red.reshape(-1),
        buffers.green.reshape(-1),
        buffers.blue.reshape(-1),
        buffers.transmittance.reshape(-1),
        buffers.plant_depth.reshape(-1),
        buffers.water.reshape(-1),
    )


@kernel
def shade(scene, view, top, reduced, buffers):
    """Add the radiance of sky, water and ground to `Buffers` [R, W'], as much as the plants let through."""
    wide = buffers.depth.shape[1]
    shade_bands(scene, view, top, reduced, flattened(buffers), wide, empty_gathered(wide))


@kernel(allocates=False)
def shade_bands(scene, view, top, reduced, buffers, wide, gathered):
    """As `shade`, for `flattened` buffers of rows of W' pixels, with `Gathered`."""
    for first in range(0, len(buffers.depth), ROWS_TOGETHER * wide):
        band = band_of(buffers, first, wide)
        row = top + first // wide
        counts = gather(scene, view, row, reduced, band, wide, gathered)
        for what in range(KINDS):
            shade_kind(scene, view, row, reduced, what, counts[what], band, wide, gathered)


@kernel(inlined=True, allocates=False)
def band_of(buffers, first, wide):
    """The band of rows of `flattened` buffers that begins with pixel `first`."""
    end = min(first + ROWS_TOGETHER * wide, len(buffers.depth))
    return Buffers(
        buffers.depth[first:end],
        buffers.kind[first:end],
        buffers.red[first:end],
        buffers.green[first:end],
        buffers.blue[first:end],
        buffers.transmittance[first:end],
        buffers.plant_depth[first:end],
        buffers.water[first:end],
    )


@kernel(disjoint=True, allocates=False)
def gather(scene, view, row, reduced, band, wide, gathered):
    """Fill the places of `Gathered`, and its shares of water; returns how many pixels show sky, water and ground.

    band: `flattened` buffers from row `row` of the image on.
    """
    for i in range(len(band.kind)):
        gathered.wet[i] = f32(1) if band.kind[i] == np.uint8(WATER) else f32(0)
    skies, waters, grounds, shores = 0, 0, 0, 0
    for r in range(len(band.kind) // wide):
        for first in range(0, view.camera.width, LANES):
            # Many pixels lie behind dense foliage, often side by side. Their colour would not show.
            if not any_seen(band.transmittance, r * wide + first):
                continue
            for c in range(first, min(first + LANES, view.camera.width)):
                i = uint32(r * wide + c)
                kind = band.kind[i]
                seen = band.transmittance[i] > f32(SEEN)
                on_water = seen & (kind == np.uint8(WATER))
                on_ground = seen & (kind == np.uint8(GROUND))
                on_shore = (on_water | on_ground) & (abs(band.water[i]) < f32(SHORE_M)) & (not reduced)
                place = place_of(int32(r), int32(c))
                # Written in any case, and kept by counting it: a choice would be predicted wrongly too often.
                gathered.places[SKY, skies] = place
                skies += int32(seen & (kind == np.uint8(SKY)))
                gathered.places[WATER, waters] = place
                waters += int32(on_water & (not on_shore))
                gathered.places[GROUND, grounds] = place
                grounds += int32(on_ground & (not on_shore))
                gathered.shore[shores] = place
                shores += int32(on_shore)
    waters, grounds = divide_shores(scene, view, row, shores, band, wide, gathered, waters, grounds)
    return skies, waters, grounds


@kernel(inlined=True, allocates=False)
def any_seen(light, first):
    """Whether any of `LANES` pixels from `first` on is seen behind the plants."""
    most = f32(0)
    for i in range(LANES):
        most = max(most, light[uint32(first + i)])
    return most > f32(SEEN)


@kernel(disjoint=True, allocates=False)
def divide_shores(scene, view, row, count, band, wide, gathered, waters, grounds):
    """Find the shares of water of the `count` pixels that may lie on a shore, and append them to those that show water
    or ground, or both; returns how many of each there are then."""
    origin = map_origin(scene, view)
    share = gathered.points.x
    padded = fill_up(gathered.shore, count)
    for first in range(0, padded, CHUNK):
        places = gathered.shore[first : min(first + CHUNK, padded)]
        n = len(places)
        for k in range(n):
            i = pixel_at(places[k], wide)
            gathered.depth[k] = band.depth[i]
            gathered.kind[k] = band.kind[i]
        water_shares(scene, view, origin, row, places, gathered.depth, gathered.kind, share, n)
        for k in range(min(n, count - first)):
            gathered.wet[pixel_at(places[k], wide)] = share[k]
            gathered.places[WATER, waters] = places[k]
            waters += int32(covered_share(WATER, share[k]) > f32(0))
            gathered.places[GROUND, grounds] = places[k]
            grounds += int32(covered_share(GROUND, share[k]) > f32(0))
    return waters, grounds


@kernel(inlined=True, allocates=False)
def pixel_at(place, wide):
    """Number of the pixel at a place in a band of rows of W' pixels."""
    return uint32(row_of(place) * int32(wide) + column_of(place))


@kernel(inlined=True, allocates=False)
def fill_up(places, count):
    """Append copies of the last place until their number is a multiple of `LANES`; returns that number."""
    padded = (count + (LANES - 1)) // LANES * LANES
    for k in range(count, padded):
        places[k] = places[count - 1]
    return padded


@kernel(disjoint=True, allocates=False)
def shade_kind(scene, view, row, reduced, what, count, band, wide, gathered):
    """Add the radiance of the `count` pixels of a band that show a class, which is sky, water or ground.

    band: `flattened` buffers from row `row` of the image on, whose pixels are `Gathered`.
    """
    origin = map_origin(scene, view)
    inv_cell = scene.constants[view.world, layout.INV_CELL]
    # Computed here and passed on: inside their loops, fastmath would turn it into a division for each pixel.
    pixel = row_step(view.camera)
    out = gathered.out
    padded = fill_up(gathered.places[what], count)
    for first in range(0, padded, CHUNK):
        places = gathered.places[what, first : min(first + CHUNK, padded)]
        n = len(places)
        for k in range(n):
            gathered.depth[k] = band.depth[pixel_at(places[k], wide)]
        hit_points(view.camera, origin, inv_cell, row, places, gathered.depth, gathered.points, n)
        shade_points(scene, view, what, reduced, gathered.points, pixel, gathered.work, out, n)
        for k in range(min(n, count - first)):
            i = pixel_at(places[k], wide)
            share = band.transmittance[i]
            if not reduced and what != SKY:
                share *= covered_share(what, gathered.wet[i])
            band.red[i] += share * out.red[k]
            band.green[i] += share * out.green[k]
            band.blue[i] += share * out.blue[k]


@kernel(disjoint=True, allocates=False)
def shade_points(scene, view, what, reduced, points, pixel, work, out, n):
    """Fill `Radiance` [n] with that of n points of one class, which is sky, water or ground.

    pixel: height of a pixel at distance one; work: a `water.WaterScratch`.
    """
    if what == SKY and reduced:
        reduced_quality.shade_sky(scene, view, points, out, n)
    elif what == WATER and reduced:
        reduced_quality.shade_water(scene, view, points, pixel, out, n)
    elif what == GROUND and reduced:
        reduced_quality.shade_ground(scene, view, points, pixel, out, n)
    elif what == SKY:
        sky.shade_sky(scene, view, points, out, n)
    elif what == WATER:
        water.shade_water(scene, view, points, pixel, work, out, n)
    else:
        ground.shade_ground(scene, view, points, pixel, out, n)
    if what == GROUND and scene.constants[view.world, layout.QUAY_SLOPE] > f32(0):
        quay.shade_quays(scene, view, points, pixel, out, n)
    # The sky map holds its own haze.
    if what != SKY:
        sky.add_haze(scene, view, points, out, n)
