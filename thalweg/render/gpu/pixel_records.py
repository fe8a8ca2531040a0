"""Records of one pixel: their arrays of one element stay in registers."""

from numba import cuda, float32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.camera_rays import HitPoints, Radiance, Rays
from thalweg.render.kernels.shading import mirror, water
from thalweg.render.kernels.terrain.heightfield_march import Tangents, Track


@kernel(inlined=True)
def empty_rays():
    """Return the `Rays` of one pixel, in registers."""
    return Rays(cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32))


@kernel(inlined=True)
def empty_radiance():
    """Return the `Radiance` of one pixel, in registers."""
    return Radiance(cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32))


@kernel(inlined=True)
def empty_tangents():
    """Return the `Tangents` of one pixel, in registers."""
    return Tangents(cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32))


@kernel(inlined=True)
def empty_track():
    """Return the `Track` of one ray, in registers."""
    return Track(
        cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32),
        cuda.local.array(1, float32), cuda.local.array(1, float32),
    )  # fmt: skip


@kernel(inlined=True)
def empty_points():
    """Return the `HitPoints` of one pixel, in registers."""
    return HitPoints(
        cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32),
        cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32),
        cuda.local.array(1, float32),
    )  # fmt: skip


@kernel(inlined=True)
def empty_surface():
    """Return the `water.Surface` of one pixel, in registers."""
    return water.Surface(
        cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32),
        cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32),
        cuda.local.array(1, float32),
    )  # fmt: skip


@kernel(inlined=True)
def empty_mirrored():
    """Return the `mirror.Mirrored` of one pixel, in registers."""
    return mirror.Mirrored(
        cuda.local.array(1, float32), cuda.local.array(1, float32), cuda.local.array(1, float32),
        cuda.local.array(1, float32),
    )  # fmt: skip
