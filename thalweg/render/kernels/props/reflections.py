"""Kernels for mirror images of props: lists of mirrored rays of the water around a prop that meet its largest parts."""

from typing import Any, NamedTuple

import numpy as np
from numba import int32, uint32, uint64

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.props import models
from thalweg.render.kernels.props.boxes import within_box
from thalweg.render.kernels.props.layers import LEAST_COVER
from thalweg.render.kernels.props.mirror_rays import (
    MirrorRay,
    mapped_ray,
    mirrored_radiance,
    mirrored_strength,
    passes_by,
    put_before,
    stopped,
    water_ray,
)
from thalweg.render.kernels.props.models import CONE, CUBE
from thalweg.render.kernels.props.pose import FADE, SHAPE, TAPER
from thalweg.render.kernels.props.rays import any_at_least, empty_part_rays, hit_of, put_hit
from thalweg.render.kernels.props.solids import meet_cone, meet_cube, meet_sphere
from thalweg.render.kernels.shading.background import CHUNK, fill_up
from thalweg.render.records.props import KIND
from thalweg.render.records.view import LANES

f32 = np.float32


class MirrorScratch(NamedTuple):
    """Scratch for the mirrored rays of a chunk of water; all arrays are [CHUNK + LANES] float32."""

    rays: Any
    """A `MirrorRay` of arrays."""
    near: Any
    """Whether a ray may meet a part, 1 or 0."""
    work: Any
    """`PartRays`: the hits of all rays, and the keys of those that see the part."""


@kernel
def empty_mirror_scratch():
    """Return a `MirrorScratch` without values."""
    a = np.empty((9, CHUNK + LANES), np.float32)
    rays = MirrorRay(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7])
    return MirrorScratch(rays, a[8], empty_part_rays(True))


@kernel(inlined=True, allocates=False)
def ray_of(rays, i):
    """Return ray i of a `MirrorRay` of arrays."""
    return MirrorRay(
        rays.x[i], rays.y[i], rays.z[i], rays.dx[i], rays.dy[i], rays.dz[i], rays.soft[i], rays.before[i]
    )  # fmt: skip


@kernel(inlined=True, allocates=False)
def put_ray(rays, i, ray):
    """Store a `MirrorRay` as ray i of one of arrays."""
    rays.x[i], rays.y[i], rays.z[i] = ray.x, ray.y, ray.z
    rays.dx[i], rays.dy[i], rays.dz[i] = ray.dx, ray.dy, ray.dz
    rays.soft[i], rays.before[i] = ray.soft, ray.before


@kernel(disjoint=True, allocates=False)
def aim_mirrored(scene, world, points, pixel, surface, rays, n):
    """Fill rays [n] with those of a `water.Surface` at `HitPoints`; pixel: height of a pixel at distance one."""
    for i in range(n):
        put_ray(rays, i, water_ray(scene, world, points, pixel, surface, i))


@kernel(inlined=True, allocates=False)
def mirror_prop(scene, view, prop, parts, box, top, places, pixel, mirrored, scratch, begin, end):
    """Put a prop before what the mirrored rays of a `MirrorScratch` from number `begin` to `end` meet, in `Mirrored`.

    parts: its posed ones; box: [4], outside which the pixels at `places` of those rays do not mirror it; pixel: height
    of a pixel at distance one. begin and end are multiples of `LANES`.
    """
    work = scratch.work
    strength = mirrored_strength(view.camera, prop)
    for k in range(int32(models.KINDS[int32(prop[KIND]), models.MAIN])):
        part = parts[k]
        if part[FADE] == f32(0):
            continue
        find_near(view.camera, part, box, top, places, scratch.rays, scratch.near, begin, end - begin)
        count = meet_near(view.camera, part, scratch, begin, end)
        if count == 0:
            continue
        padded = fill_up(work.keys, count)
        paint_mirrored(scene, view, part, pixel, scratch.rays, work.keys, work.hits, work.out, padded)
        for i in range(count):
            key = uint32(work.keys[i])
            put_before(
                mirrored, key, work.hits.cover[key] * strength, work.out.red[i], work.out.green[i], work.out.blue[i]
            )


@kernel(inlined=True, disjoint=True, allocates=False)
def find_near(camera, part, box, top, places, rays, near, first, n):
    """Fill n of near, from number `first` on, with 1 for mirrored rays within a box that do not pass by a posed part,
    else with 0."""
    for k in range(n):
        i = uint64(first + k)
        beside = passes_by(camera, part, ray_of(rays, i))
        near[i] = f32(1) if within_box(box, top, places[i]) & (not beside) else f32(0)


@kernel(inlined=True, allocates=False)
def meet_near(camera, part, scratch, first, last):
    """Meet a posed part with those of the rays of a `MirrorScratch` from number `first` to `last` that are near it, and
    keep the numbers of those that see it; returns how many there are."""
    work = scratch.work
    kept = uint32(0)
    while first < last:
        end = first
        while end < last and any_at_least(scratch.near, end, f32(1)):
            end += LANES
        meet_mirrored(camera, part, scratch.rays, work.hits, first, end - first)
        for block in range(first, end, LANES):
            if any_at_least(work.hits.cover, block, f32(LEAST_COVER)):
                for i in range(block, block + LANES):
                    seen = (work.hits.cover[uint32(i)] >= f32(LEAST_COVER)) & (scratch.near[uint32(i)] > f32(0))
                    # Written in any case, and kept by counting it.
                    work.keys[kept] = int32(i)
                    kept = uint32(kept + uint32(seen))
        # Whole vectors that are all beside it are left out.
        first = end + LANES
    return int32(kept)


@kernel(inlined=True, disjoint=True, allocates=False)
def meet_mirrored(camera, part, rays, hits, first, n):
    """Fill n of hits, from number `first` on, with those of mirrored rays with a posed part."""
    # One loop for each solid: a choice within a loop would compute all of them. An index that might be negative would
    # not vectorise.
    if part[SHAPE] == f32(CUBE):
        for k in range(n):
            i = uint64(first + k)
            ray, width = mapped_ray(camera, part, ray_of(rays, i))
            put_hit(hits, i, stopped(meet_cube(ray), width))
    elif part[SHAPE] == f32(CONE):
        for k in range(n):
            i = uint64(first + k)
            ray, width = mapped_ray(camera, part, ray_of(rays, i))
            put_hit(hits, i, stopped(meet_cone(part[TAPER], ray), width))
    else:
        for k in range(n):
            i = uint64(first + k)
            ray, width = mapped_ray(camera, part, ray_of(rays, i))
            put_hit(hits, i, stopped(meet_sphere(ray), width))


@kernel(inlined=True, disjoint=True, allocates=False)
def paint_mirrored(scene, view, part, pixel, rays, keys, hits, out, n):
    """Fill `Radiance` [n] with that of a posed part where the mirrored rays `keys` [n] meet it, at their hits."""
    for i in range(n):
        key = uint32(keys[i])
        out.red[i], out.green[i], out.blue[i] = mirrored_radiance(
            scene, view, part, pixel, ray_of(rays, key), hit_of(hits, key)
        )
