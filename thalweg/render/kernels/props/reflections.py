"""Kernels for mirror images of props: mirrored rays of the water around a prop that meet its largest parts."""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import int32, uint64

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.props import models
from thalweg.render.kernels.props.boxes import within_box
from thalweg.render.kernels.props.layers import LEAST_COVER
from thalweg.render.kernels.props.models import CONE, CUBE
from thalweg.render.kernels.props.paint import part_radiance
from thalweg.render.kernels.props.pose import CAMERA, FADE, MIDDLE, REACH, SHAPE, TAPER, depth_of, mapped
from thalweg.render.kernels.props.rays import any_at_least, empty_part_rays, hit_of, put_hit
from thalweg.render.kernels.props.solids import SolidHit, SolidRay, meet_cone, meet_cube, meet_sphere
from thalweg.render.kernels.shading import mirror
from thalweg.render.kernels.shading.background import CHUNK
from thalweg.render.kernels.shading.water_optics import ROUGHNESS
from thalweg.render.kernels.table_lookup import clamp
from thalweg.render.records import layout
from thalweg.render.records.props import KIND
from thalweg.render.records.view import LANES

f32 = np.float32

MIRRORED_M, MIRROR_FADE_M = 45.0, 10.0
"""Depth from which on water mirrors no prop, and over how many metres before that mirror images fade."""
SOFTNESS = 0.5
"""Share of the softening of mirrored canopies that edges of a mirrored prop have."""


class MirrorRay(NamedTuple):
    """A mirrored ray, or arrays of them."""

    x: Any
    """Metres, where it leaves the water, as the next two."""
    y: Any
    z: Any
    dx: Any
    """Unit direction, as the next two."""
    dy: Any
    dz: Any
    soft: Any
    """Its width at distance one."""
    before: Any
    """Metres from the camera to where it begins."""


class MirrorScratch(NamedTuple):
    """Scratch for the mirrored rays of a chunk of water; all arrays are [CHUNK + LANES] float32."""

    rays: Any
    """A `MirrorRay` of arrays: all rays."""
    seen: Any
    """The same for those that see a part."""
    near: Any
    """Whether a ray may meet a part, 1 or 0."""
    work: Any
    """`PartRays`, of those that see it."""


@kernel(inlined=True, allocates=False)
def mirrored_strength(camera, prop):
    """Return the share of its mirror image that is left of a prop at its distance."""
    return clamp(f32(MIRRORED_M) - depth_of(camera, prop), f32(0), f32(MIRROR_FADE_M)) * f32(1 / MIRROR_FADE_M)


@kernel(inlined=True, allocates=False)
def water_ray(scene, world, points, pixel, surface, i):
    """Return the `MirrorRay` of point i of `HitPoints` with a `water.Surface`; pixel: height of a pixel at distance
    one."""
    cell = f32(1) / scene.constants[world, layout.INV_CELL]
    lost = max(surface.spread[i] - f32(ROUGHNESS), f32(0))
    soft = f32(SOFTNESS) * math.sqrt(f32(mirror.SPREAD_BLUR**2) * lost + f32(mirror.BLUR**2)) + pixel
    return MirrorRay(
        points.x[i] * cell + scene.constants[world, layout.ORIGIN_X],
        points.y[i] * cell + scene.constants[world, layout.ORIGIN_Y],
        points.z[i],
        surface.mirror_x[i], surface.mirror_y[i], surface.mirror_z[i], soft, points.distance[i],
    )  # fmt: skip


@kernel(inlined=True, allocates=False)
def passes_by(camera, part, ray):
    """Return whether a `MirrorRay` misses the ball around a placed part, by more than the ray's own width."""
    x = part[MIDDLE] + camera.x - ray.x
    y = part[MIDDLE + 1] + camera.y - ray.y
    z = part[MIDDLE + 2] + camera.z - ray.z
    along = max(x * ray.dx + y * ray.dy + z * ray.dz, f32(0))
    reach = part[REACH] + ray.soft * along
    x -= along * ray.dx
    y -= along * ray.dy
    z -= along * ray.dz
    return x * x + y * y + z * z > reach * reach


@kernel(inlined=True, allocates=False)
def narrowed(ray):
    """Return a `SolidRay` that is no wider than the solid where it passes by, and the share of its width that is left.

    What is thinner than the ray stops only a part of it, and the outline of a wider one could not be told.
    """
    right = ray.right_x * ray.right_x + ray.right_y * ray.right_y + ray.right_z * ray.right_z
    up = ray.up_x * ray.up_x + ray.up_y * ray.up_y + ray.up_z * ray.up_z
    square = ray.x * ray.x + ray.y * ray.y + ray.z * ray.z
    away = -(ray.ox * ray.x + ray.oy * ray.y + ray.oz * ray.z) / square
    share = min(f32(1) / (math.sqrt(max(right, up)) * max(away, f32(0)) + f32(1e-6)), f32(1))
    return SolidRay(
        ray.ox, ray.oy, ray.oz, ray.x, ray.y, ray.z,
        ray.right_x * share, ray.right_y * share, ray.right_z * share,
        ray.up_x * share, ray.up_y * share, ray.up_z * share,
    ), share  # fmt: skip


@kernel(inlined=True, allocates=False)
def mapped_ray(camera, part, ray):
    """Return the `SolidRay` of a `MirrorRay` in the coordinates of a placed part, and the share of its width that
    `narrowed` leaves."""
    # Two directions across the ray: a level one, and one that is level with neither.
    level = f32(1) / (math.sqrt(ray.dx * ray.dx + ray.dy * ray.dy) + f32(1e-6))
    ax, ay = -ray.dy * level * ray.soft, ray.dx * level * ray.soft
    bx, by = -ray.dx * ray.dz * level * ray.soft, -ray.dy * ray.dz * level * ray.soft
    ox, oy, oz = mapped(part, ray.x - camera.x, ray.y - camera.y, ray.z - camera.z)
    return narrowed(
        SolidRay(
            part[CAMERA] + ox, part[CAMERA + 1] + oy, part[CAMERA + 2] + oz,
            *mapped(part, ray.dx, ray.dy, ray.dz), *mapped(part, ax, ay, f32(0)),
            *mapped(part, bx, by, ray.soft / level),
        )
    )  # fmt: skip


@kernel(inlined=True, allocates=False)
def stopped(hit, width):
    """Return the `SolidHit` of a ray of which only a share of its width can meet the solid, above the water."""
    cover = hit.cover * width if hit.t > f32(0) else f32(0)
    return SolidHit(cover, hit.t, hit.nx, hit.ny, hit.nz)


@kernel(inlined=True, allocates=False)
def mirrored_radiance(scene, view, part, pixel, ray, hit):
    """Return the radiance (red, green, blue) of a placed part at the `SolidHit` of a `MirrorRay`; pixel: height of a
    pixel at distance one."""
    mapped_one, _ = mapped_ray(view.camera, part, ray)
    at = ray.x + ray.dx * hit.t, ray.y + ray.dy * hit.t, ray.z + ray.dz * hit.t
    towards = ray.dx, ray.dy, ray.dz
    return part_radiance(scene, view, part, hit, mapped_one, towards, at, hit.t, (ray.before + hit.t) * pixel)


@kernel(inlined=True, allocates=False)
def put_before(mirrored, i, cover, red, green, blue):
    """Put what covers a share of mirrored ray i, and its radiance, before what is in `Mirrored`."""
    rest = f32(1) - cover
    mirrored.passing[i] *= rest
    mirrored.red[i] = mirrored.red[i] * rest + cover * red
    mirrored.green[i] = mirrored.green[i] * rest + cover * green
    mirrored.blue[i] = mirrored.blue[i] * rest + cover * blue


@kernel
def empty_mirror_scratch():
    """Return a `MirrorScratch` without values."""
    a = np.empty((17, CHUNK + LANES), np.float32)
    return MirrorScratch(
        MirrorRay(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7]),
        MirrorRay(a[8], a[9], a[10], a[11], a[12], a[13], a[14], a[15]),
        a[16], empty_part_rays(True),
    )  # fmt: skip


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


@kernel(allocates=False)
def mirror_prop(scene, view, prop, parts, box, top, places, pixel, mirrored, scratch, n):
    """Put a prop before what the mirrored rays of a `MirrorScratch` meet, in `Mirrored` [n].

    parts: its placed ones; box: [4], outside which pixels at places [n] do not mirror it; pixel: height of a pixel at
    distance one. n is a multiple of `LANES`.
    """
    work = scratch.work
    strength = mirrored_strength(view.camera, prop)
    for k in range(int32(models.KINDS[int32(prop[KIND]), models.MAIN])):
        part = parts[k]
        if part[FADE] == f32(0):
            continue
        find_near(view.camera, part, box, top, places, scratch.rays, scratch.near, n)
        count = meet_near(view.camera, part, scratch, n)
        if count == 0:
            continue
        padded = fill_seen(scratch.seen, count)
        # They meet it once more, side by side.
        meet_mirrored(view.camera, part, scratch.seen, work.hits, 0, padded)
        paint_mirrored(scene, view, part, pixel, scratch.seen, work.hits, work.out, padded)
        for i in range(count):
            cover = work.cover[i] * strength
            put_before(mirrored, work.keys[i], cover, work.out.red[i], work.out.green[i], work.out.blue[i])


@kernel(inlined=True, disjoint=True, allocates=False)
def find_near(camera, part, box, top, places, rays, near, n):
    """Fill near [n] with 1 for mirrored rays within a box that do not pass by a placed part, else with 0."""
    for i in range(n):
        beside = passes_by(camera, part, ray_of(rays, i))
        near[i] = f32(1) if within_box(box, top, places[i]) & (not beside) else f32(0)


@kernel(inlined=True, allocates=False)
def meet_near(camera, part, scratch, n):
    """Meet a placed part with those of n rays of a `MirrorScratch` that are near it, and keep those that see it: their
    numbers and covers, and the rays; returns how many there are."""
    work = scratch.work
    kept = int32(0)
    first = 0
    while first < n:
        end = first
        while end < n and any_at_least(scratch.near, end, f32(1)):
            end += LANES
        meet_mirrored(camera, part, scratch.rays, work.hits, first, end - first)
        for block in range(first, end, LANES):
            if any_at_least(work.hits.cover, block, f32(LEAST_COVER)):
                kept = keep_seen(scratch, block, kept)
        # Whole vectors that are all beside it are left out.
        first = end + LANES
    return kept


@kernel(inlined=True, allocates=False)
def keep_seen(scratch, block, kept):
    """Keep those of `LANES` rays from number `block` on that are near a part and see it, after so many that are kept
    already; returns how many there are then."""
    work = scratch.work
    for i in range(block, block + LANES):
        if work.hits.cover[i] >= f32(LEAST_COVER) and scratch.near[i] > f32(0):
            work.keys[kept], work.cover[kept] = int32(i), work.hits.cover[i]
            put_ray(scratch.seen, kept, ray_of(scratch.rays, i))
            kept += int32(1)
    return kept


@kernel(inlined=True, allocates=False)
def fill_seen(rays, count):
    """Append copies of the last ray until their number is a multiple of `LANES`; returns that number."""
    padded = (count + (LANES - 1)) // LANES * LANES
    for i in range(count, padded):
        put_ray(rays, i, ray_of(rays, count - 1))
    return padded


@kernel(inlined=True, disjoint=True, allocates=False)
def meet_mirrored(camera, part, rays, hits, first, n):
    """Fill n of hits, from number `first` on, with those of mirrored rays with a placed part."""
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
def paint_mirrored(scene, view, part, pixel, rays, hits, out, n):
    """Fill `Radiance` [n] with that of a placed part where mirrored rays [n] meet it, at hits [n]."""
    for i in range(n):
        out.red[i], out.green[i], out.blue[i] = mirrored_radiance(
            scene, view, part, pixel, ray_of(rays, i), hit_of(hits, i)
        )
