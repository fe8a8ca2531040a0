"""How is a grown plant lit, and how does it look from one side?

Light falls through its own crown; then its ellipses are drawn, the nearest in front.

In the plant's frame the sun stands in the direction +x. Radiance 1 is that of a white surface that faces the full sun
under an open sky; sun and sky differ in colour and add up to that white.
"""

import math

import numpy as np
from numba import float32

from thalweg.core.jit import kernel
from thalweg.render.bake.trees import Model

SUN_LIGHT = np.array([0.87, 0.82, 0.72])
"""What the full sun, head on, gives to a white surface, in red, green, blue."""
SKY_LIGHT = np.array([0.18, 0.235, 0.36])
"""What the whole open sky gives to a white surface that looks up."""
GROUND = np.array([0.26, 0.22, 0.14])
"""Mean reflectance of the ground around: sand and grass send light up into the crowns."""
FILTERED = np.array([1.0, 0.95, 1.4])
"""Power on the share of sky in red, green, blue: what reaches the inside of a crown has lost its blue to the leaves."""
WRAP = 0.18
"""How far round its edge the sun lights a clump of leaves (a leaf bends): 0 = not at all."""
CELLS = 96
"""Cells of the density volume in a plant's height."""
LEAF_SHADE = 0.95
"""Share of the true leaf area that counts as shade: leaves scatter light on, and overlap within a clump."""
STAND = 0.35
"""Share of the sky that its neighbours in the stand hide from the foot of a tree; they hide none from its top."""


def light(model: Model, sun_elevation: float) -> tuple[np.ndarray, np.ndarray]:
    """Share of the direct sun [L] and of the sky [L] that comes through the crown to each ellipse."""
    low = model.centre.min(0) - np.float32(1 / CELLS)
    shape = np.ceil((model.centre.max(0) - low) * CELLS).astype(np.int64) + 2
    cell = np.minimum(((model.centre - low) * CELLS).astype(np.int64), shape - 1)
    flat = (cell[:, 0] * shape[1] + cell[:, 1]) * shape[2] + cell[:, 2]
    area = np.pi * np.linalg.norm(np.cross(model.along, model.across), axis=1)
    # Shade per step of one cell: leaves turn any way, so they show half their area.
    density = np.bincount(flat, 0.5 * LEAF_SHADE * area * CELLS**2, minlength=int(shape.prod())).reshape(shape)
    volume = np.minimum(density, 3.0).astype(np.float32)
    sun = np.array([[math.cos(sun_elevation), 0.0, math.sin(sun_elevation)]], np.float32)
    azimuth = np.arange(9) * 2.4
    height = np.sqrt(
        (np.arange(9) + 0.5) / 9
    )  # cosine-weighted directions: each stands for the same share of the light
    flat_part = np.sqrt(1 - height**2)
    sky = np.column_stack([flat_part * np.cos(azimuth), flat_part * np.sin(azimuth), height]).astype(np.float32)
    start = (model.centre - low) * np.float32(CELLS) + model.normal * np.float32(0.8)
    return through(volume, start, sun), through(volume, start, sky)


@kernel(fastmath=False)
def through(volume, start, directions):
    """Mean share of light [L] that comes from directions [D, 3] to points `start` [L, 3], in cells of the volume."""
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
            while x >= 0 and y >= 0 and z >= 0 and x < size_x and y < size_y and z < size_z and depth < float32(6.0):
                depth += volume[int(x), int(y), int(z)]
                x += dx
                y += dy
                z += dz
            total += math.exp(-depth)
        result[point] = total / float32(len(directions))
    return result


def radiance(model: Model, sun_elevation: float, sun_share: np.ndarray, sky_share: np.ndarray) -> tuple:
    """Radiance of each ellipse seen from its normal's side, and from the other side; each [L, 3] float32."""
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
    solid = model.transmittance.max(1, keepdims=True) <= 0  # bark and stone have no other side to be seen
    return seen[0].astype(np.float32), np.where(solid, seen[0], seen[1]).astype(np.float32)


@kernel(fastmath=False)
def draw(centre, along, across, normal, front, back, look, tilt, scale_u, scale_v, rows, cols, fine):
    """A plant [rows, cols, C + 1] float32 from one side: C colours times coverage, and coverage. Row 0 is the foot.

    `front`, `back` [L, C]: the colours of each ellipse seen from its normal's side and from the other.
    `look` [2]: horizontal direction of view; `tilt`: tangent of the angle by which the camera looks down; `scale_u`,
    `scale_v`: columns and rows per unit of length; `fine`: samples along each side of a texel.
    """
    height, width = rows * fine, cols * fine
    nearest = np.full((height, width), float32(1e9), np.float32)
    which = np.full((height, width), -1, np.int32)
    cx, cy = look[0], look[1]
    su, sv = scale_u * float32(fine), scale_v * float32(fine)
    for i in range(len(centre)):
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
        if abs(area) < float32(0.05):  # seen edge on
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
                s = (u * vb - v * ub) * inverse
                t = (v * ua - u * va) * inverse
                depth = d0 + s * da + t * db
                if s * s + t * t <= float32(1.0) and depth < nearest[row, col]:
                    nearest[row, col] = depth
                    which[row, col] = i
    colours = front.shape[1]
    picture = np.zeros((rows, cols, colours + 1), np.float32)
    share = float32(1.0) / float32(fine * fine)
    for row in range(height):
        for col in range(width):
            i = which[row, col]
            if i >= 0:
                away = normal[i, 0] * cx + normal[i, 1] * cy - normal[i, 2] * tilt > float32(0.0)
                for channel in range(colours):
                    colour = back[i, channel] if away else front[i, channel]
                    picture[row // fine, col // fine, channel] += colour * share
                picture[row // fine, col // fine, colours] += share
    return picture
