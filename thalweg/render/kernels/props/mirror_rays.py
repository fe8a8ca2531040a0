"""Kernels for one mirrored ray of the water near a prop: where it goes and what it shows of a part, on CPU and GPU."""

import math
from typing import Any, NamedTuple

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.props.paint import part_radiance
from thalweg.render.kernels.props.pose import CAMERA, MIDDLE, REACH, depth_of, mapped
from thalweg.render.kernels.props.solids import SolidHit, SolidRay
from thalweg.render.kernels.shading import mirror
from thalweg.render.kernels.shading.water_optics import ROUGHNESS
from thalweg.render.kernels.table_lookup import clamp
from thalweg.render.records import layout

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
    """Return whether a `MirrorRay` misses the ball around a posed part, by more than the ray's own width."""
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
    """Return the `SolidRay` of a `MirrorRay` in the coordinates of a posed part, and the share of its width that
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
    """Return the radiance (red, green, blue) of a posed part at the `SolidHit` of a `MirrorRay`; pixel: height of a
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
