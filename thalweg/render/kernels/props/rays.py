"""Lists of rays that may meet one part of a prop, so that it is met and painted in dense loops, which vectorise.

A list is filled up to whole vectors by copies of its last ray (`shading.background`). Rays that see the part are kept,
and only those are painted; they meet it once more, which takes less time than to move all that was computed.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import uint64

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.camera_rays import Radiance
from thalweg.render.kernels.props.solids import SolidHit
from thalweg.render.kernels.shading.background import CHUNK
from thalweg.render.records.view import LANES

f32 = np.float32


class PartRays(NamedTuple):
    """Scratch for a list of up to `CHUNK` rays; all arrays are [CHUNK + LANES]."""

    keys: Any
    """int32: which ray each is, as the caller counts them."""
    cover: Any
    """float32, share that the part stops of each ray that is kept."""
    t: Any
    """float32, where it meets the part."""
    hits: Any
    """A `SolidHit` of arrays of float32."""
    out: Any
    """`Radiance`."""


@kernel
def empty_part_rays(some):
    """Return `PartRays` without values; if not some, without any room."""
    size = CHUNK + LANES if some else 0
    a = np.empty((10, size), np.float32)
    hits = SolidHit(a[2], a[3], a[4], a[5], a[6])
    return PartRays(np.empty(size, np.int32), a[0], a[1], hits, Radiance(a[7], a[8], a[9]))


@kernel(inlined=True, allocates=False)
def put_hit(hits, i, hit):
    """Store a `SolidHit` as hit i of one of arrays."""
    hits.cover[i], hits.t[i] = hit.cover, hit.t
    hits.nx[i], hits.ny[i], hits.nz[i] = hit.nx, hit.ny, hit.nz


@kernel(inlined=True, allocates=False)
def hit_of(hits, i):
    """Return hit i of a `SolidHit` of arrays."""
    return SolidHit(hits.cover[i], hits.t[i], hits.nx[i], hits.ny[i], hits.nz[i])


@kernel(inlined=True, allocates=False)
def any_at_least(values, first, least):
    """Return whether any of `LANES` values from `first` on, none of which is negative, is at least so much."""
    # From zero on, so that there are as many steps as lanes and the loop becomes one vector.
    most = f32(0)
    for k in range(LANES):
        most = max(most, values[uint64(first + k)])
    return most >= least
