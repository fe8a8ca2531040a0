"""Colours of sky, water and ground at a pixel, from the same functions as the CPU, with spans of one pixel."""

import numpy as np
from numba import cuda, float32, int32, uint8

from thalweg.core.compute.jit import kernel
from thalweg.render.gpu.pixel_records import empty_mirrored, empty_points, empty_surface
from thalweg.render.kernels.camera_rays import hit_points, map_origin, place_of, row_step
from thalweg.render.kernels.shading import ground, quay, reduced_quality, sky, water
from thalweg.render.kernels.shading.shore import covered_share, water_shares
from thalweg.render.records import classes, layout

f32 = np.float32


@kernel(inlined=True)
def shade_background(scene, view, kind, reduced, r, c, depth, out):
    """Fill `Radiance` [1] with that of sky, water or ground at pixel (r, c), haze included."""
    inv_cell = scene.constants[view.world, layout.INV_CELL]
    pixel = row_step(view.camera)
    place = cuda.local.array(1, int32)
    place[0] = place_of(int32(0), int32(c))
    points = empty_points()
    hit_points(view.camera, map_origin(scene, view), inv_cell, r, place, depth, points, 1)
    if kind == classes.SKY:
        if reduced:
            reduced_quality.shade_sky(scene, view, points, out, 1)
        else:
            sky.shade_sky(scene, view, points, out, 1)
        # The sky map holds its own haze.
        return
    wet = f32(1) if kind == classes.WATER else f32(0)
    if not reduced:
        share = cuda.local.array(1, float32)
        kinds = cuda.local.array(1, uint8)
        kinds[0] = kind
        water_shares(scene, view, map_origin(scene, view), r, place, depth, kinds, share, 1)
        wet = covered_share(classes.WATER, share[0])
    # A pixel on the shore is the mean of water and ground.
    red = f32(0)
    green = f32(0)
    blue = f32(0)
    if wet > f32(0):
        shade_water(scene, view, points, pixel, reduced, out)
        red = wet * out.red[0]
        green = wet * out.green[0]
        blue = wet * out.blue[0]
    if wet < f32(1):
        if reduced:
            reduced_quality.shade_ground(scene, view, points, pixel, out, 1)
        else:
            ground.shade_ground(scene, view, points, pixel, out, 1)
        if scene.constants[view.world, layout.QUAY_SLOPE] > f32(0):
            quay.shade_quays(scene, view, points, pixel, out, 1)
        red += (f32(1) - wet) * out.red[0]
        green += (f32(1) - wet) * out.green[0]
        blue += (f32(1) - wet) * out.blue[0]
    out.red[0] = red
    out.green[0] = green
    out.blue[0] = blue
    sky.add_haze(scene, view, points, out, 1)


@kernel(inlined=True)
def shade_water(scene, view, points, pixel, reduced, out):
    """Fill `Radiance` [1] with that of water."""
    if reduced:
        reduced_quality.shade_water(scene, view, points, pixel, out, 1)
    else:
        scratch = water.WaterScratch(empty_surface(), empty_mirrored())
        water.shade_water(scene, view, points, pixel, scratch, out, 1)
