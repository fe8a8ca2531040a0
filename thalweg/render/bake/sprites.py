"""The light on a grown plant and its picture from one side, drawn as ellipses.

Light falls through the plant's own crown; then its ellipses are drawn, the nearest in front. In the plant's frame the
sun stands in the direction +x. Radiance 1 is that of a white surface that faces the full sun under an open sky; sun and
sky differ in colour and add up to that white.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import float32

from thalweg.core.compute.jit import kernel
from thalweg.render.bake.trees import Model

SUN_LIGHT = np.array([0.87, 0.82, 0.72])
"""Radiance of a white surface that faces the full sun, in red, green and blue."""
SKY_LIGHT = np.array([0.18, 0.235, 0.36])
"""Radiance of a level white surface under the whole open sky."""
GROUND = np.array([0.26, 0.22, 0.14])
"""Mean reflectance of the ground around a plant; sand and grass reflect light up into the crown."""
FILTERED = np.array([1.0, 0.95, 1.4])
"""Exponents on the share of sky in red, green and blue: leaves absorb blue, so less of it gets into a crown."""
WRAP = 0.18
"""How far around its edge the sun lights a clump of leaves, because leaves bend; 0 is not at all."""
CELLS = 96
"""Number of cells of the density volume along a plant's height."""
LEAF_SHADE = 0.95
"""Share of the leaf area that counts as shade: leaves scatter some light onward and overlap within a clump."""
STAND = 0.35
"""Share of the sky that neighbouring trees hide from the foot of a tree; they hide none from its top."""


class Ellipses(NamedTuple):
    """The ellipses of a plant, arrays [L, 3] float32, in units of the plant's height."""

    centre: Any
    along: Any
    """One semi-axis, as the next."""
    across: Any
    normal: Any
    """Unit vector."""


class Projection(NamedTuple):
    """How a plant is projected onto a picture."""

    look: Any
    """[2] float32, horizontal unit vector of the line of sight."""
    tilt: Any
    """Tangent of the angle by which the camera looks down."""
    columns_per_unit: Any
    """Columns, and rows, per unit of length."""
    rows_per_unit: Any
    rows: Any
    """Size of the picture."""
    columns: Any
    samples: Any
    """Samples along each side of a texel."""


def light(model: Model, sun_elevation: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the shares of direct sun [L] and of sky [L] that reach each ellipse through the crown."""
    low = model.centre.min(0) - np.float32(1 / CELLS)
    shape = np.ceil((model.centre.max(0) - low) * CELLS).astype(np.int64) + 2
    cell = np.minimum(((model.centre - low) * CELLS).astype(np.int64), shape - 1)
    flat = (cell[:, 0] * shape[1] + cell[:, 1]) * shape[2] + cell[:, 2]
    area = np.pi * np.linalg.norm(np.cross(model.along, model.across), axis=1)
    # Optical depth per step of one cell: leaves have random orientations, so they show half their area.
    density = np.bincount(flat, 0.5 * LEAF_SHADE * area * CELLS**2, minlength=int(shape.prod())).reshape(shape)
    volume = np.minimum(density, 3.0).astype(np.float32)
    sun = np.array([[math.cos(sun_elevation), 0.0, math.sin(sun_elevation)]], np.float32)
    azimuth = np.arange(9) * 2.4
    # Cosine-weighted directions, so that each stands for the same share of the light on a level surface.
    height = np.sqrt((np.arange(9) + 0.5) / 9)
    flat_part = np.sqrt(1 - height**2)
    sky = np.column_stack([flat_part * np.cos(azimuth), flat_part * np.sin(azimuth), height]).astype(np.float32)
    # Rays start a little off the ellipse, so that it does not shade itself.
    start = (model.centre - low) * np.float32(CELLS) + model.normal * np.float32(0.8)
    return transmitted(volume, start, sun), transmitted(volume, start, sky)


@kernel(fastmath=False)
def transmitted(volume, start, directions):
    """Return the mean share of light [L] that reaches points `start` [L, 3], in cells, from directions [D, 3]."""
    result = np.empty(len(start), np.float32)
    size_x, size_y, size_z = volume.shape
    for point in range(len(start)):
        total = float32(0.0)
        for d in range(len(directions)):
            dx, dy, dz = directions[d, 0], directions[d, 1], directions[d, 2]
            x = start[point, 0] + float32(1.2) * dx
            y = start[point, 1] + float32(1.2) * dy
            z = start[point, 2] + float32(1.2) * dz
            depth = float32(0.0)
            # Beyond an optical depth of 6 less than 0.3 % of the light is left.
            while x >= 0 and y >= 0 and z >= 0 and x < size_x and y < size_y and z < size_z and depth < float32(6.0):
                depth += volume[int(x), int(y), int(z)]
                x += dx
                y += dy
                z += dz
            total += math.exp(-depth)
        result[point] = total / float32(len(directions))
    return result


def radiance(model: Model, sun_elevation: float, sun_share: np.ndarray, sky_share: np.ndarray) -> tuple:
    """Return the radiance of each ellipse from its normal's side and from the other side; each [L, 3] float32."""
    sun = np.array([math.cos(sun_elevation), 0.0, math.sin(sun_elevation)])
    cosine = (model.normal @ sun)[:, None]
    up = model.normal[:, 2:3]
    direct = SUN_LIGHT * sun_share[:, None]
    sky = SKY_LIGHT * sky_share[:, None] ** FILTERED
    bounced = GROUND * (SUN_LIGHT * math.sin(sun_elevation) * 0.6 + SKY_LIGHT)
    seen = []
    for side in (1.0, -1.0):
        lit = np.maximum((side * cosine + WRAP) / (1 + WRAP), 0)
        behind = np.maximum(-side * cosine, 0)
        ambient = sky * (0.6 + 0.4 * side * up)
        ambient = ambient + bounced * (sky_share[:, None] * (0.4 - 0.4 * side * up))
        seen.append(
            model.reflectance * (direct * lit + ambient) + model.transmittance * (direct * behind + 0.5 * ambient)
        )
    # Bark and stone are solid: only their outer side can be seen.
    solid = model.transmittance.max(1, keepdims=True) <= 0
    return seen[0].astype(np.float32), np.where(solid, seen[0], seen[1]).astype(np.float32)


@kernel(fastmath=False)
def draw(ellipses, front, back, projection):
    """Return a plant's picture [rows, columns, C + 1] float32: C colours times coverage, and coverage.

    Row 0 is the foot. front, back [L, C]: the colours of each of the `Ellipses` seen from its normal's side and from
    the other side; projection: a `Projection`.
    """
    fine = projection.samples
    which = nearest_ellipses(ellipses, projection)
    look_x, look_y = projection.look[0], projection.look[1]
    colours = front.shape[1]
    picture = np.zeros((projection.rows, projection.columns, colours + 1), np.float32)
    share = float32(1.0) / float32(fine * fine)
    for row in range(projection.rows * fine):
        for col in range(projection.columns * fine):
            i = which[row, col]
            if i >= 0:
                normal = ellipses.normal[i]
                away = normal[0] * look_x + normal[1] * look_y - normal[2] * projection.tilt > float32(0.0)
                for channel in range(colours):
                    colour = back[i, channel] if away else front[i, channel]
                    picture[row // fine, col // fine, channel] += colour * share
                picture[row // fine, col // fine, colours] += share
    return picture


@kernel(fastmath=False)
def nearest_ellipses(ellipses, projection):
    """Return the index of the nearest ellipse at each sample [rows * samples, columns * samples] int32; -1 for none."""
    centre, along, across, _ = ellipses
    fine, tilt = projection.samples, projection.tilt
    height, width = projection.rows * fine, projection.columns * fine
    nearest = np.full((height, width), float32(1e9), np.float32)
    which = np.full((height, width), -1, np.int32)
    cx, cy = projection.look[0], projection.look[1]
    su, sv = projection.columns_per_unit * float32(fine), projection.rows_per_unit * float32(fine)
    for i in range(len(centre)):
        # Depth, column and row of the centre (0) and of the two semi-axes (a, b). The projection is parallel: the tilt
        # shifts a point up the picture by its depth, so that the camera looks down on the plant.
        d0 = centre[i, 0] * cx + centre[i, 1] * cy
        u0 = (centre[i, 0] * cy - centre[i, 1] * cx) * su + float32(width) * float32(0.5)
        v0 = (centre[i, 2] + d0 * tilt) * sv
        da = along[i, 0] * cx + along[i, 1] * cy
        ua = (along[i, 0] * cy - along[i, 1] * cx) * su
        va = (along[i, 2] + da * tilt) * sv
        db = across[i, 0] * cx + across[i, 1] * cy
        ub = (across[i, 0] * cy - across[i, 1] * cx) * su
        vb = (across[i, 2] + db * tilt) * sv
        area = ua * vb - ub * va
        # An ellipse seen edge on covers no sample, and the division below would overflow.
        if abs(area) < float32(0.05):
            continue
        reach_u = math.sqrt(ua * ua + ub * ub)
        reach_v = math.sqrt(va * va + vb * vb)
        left, right = max(int(u0 - reach_u), 0), min(int(u0 + reach_u) + 1, width)
        low, high = max(int(v0 - reach_v), 0), min(int(v0 + reach_v) + 1, height)
        inverse = float32(1.0) / area
        for row in range(low, high):
            v = float32(row) + float32(0.5) - v0
            for col in range(left, right):
                u = float32(col) + float32(0.5) - u0
                # Coordinates along the semi-axes (Cramer's rule): the ellipse is their unit disc.
                s = (u * vb - v * ub) * inverse
                t = (v * ua - u * va) * inverse
                depth = d0 + s * da + t * db
                if s * s + t * t <= float32(1.0) and depth < nearest[row, col]:
                    nearest[row, col] = depth
                    which[row, col] = i
    return which
