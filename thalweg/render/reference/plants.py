"""Plants of the reference renderer: billboards from the finest texels of the atlas, composited from near to far."""

import numpy as np

from thalweg.render.bake import impostors
from thalweg.render.bake.scene_tables import (
    autumn,
    plant_ranks,
)
from thalweg.render.kernels.plants import billboard, draw
from thalweg.render.records import appearance
from thalweg.render.records.camera import Camera
from thalweg.render.reference.materials import Materials, bilinear


def blend_plants(
    materials: Materials,
    origin: np.ndarray,
    ray: np.ndarray,
    basis: tuple[np.ndarray, ...],
    camera: Camera,
    depth: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the light [R, C, 3] that plants add, the share [R, C] that they let through, and the depth [R, C] at which
    half is stopped.
    """
    rows, columns = depth.shape
    added, light, solid = np.zeros((rows, columns, 3)), np.ones((rows, columns)), np.full((rows, columns), np.inf)
    trees = materials.world.plants
    offset = trees.position_m.astype(np.float64) - origin
    distance = np.hypot(offset[:, 0], offset[:, 1])
    rank = plant_ranks(len(distance))
    season = 1 + materials.look[appearance.SEASON] * (autumn().astype(np.float64) - 1)
    for m in np.argsort(distance, kind="stable"):
        far = distance[m]
        if far < draw.NEAR_M or far > draw.FAR_M or rank[m] >= materials.look[appearance.DENSITY]:
            continue
        tall, half = float(trees.height_m[m]), float(trees.width_m[m]) / 2
        box = window(offset[m], tall, half, basis, camera, rows, columns)
        if box is None:
            continue
        part = ray[box]
        sight = offset[m, :2] / far
        towards = part[..., :2] @ sight
        t = far / np.maximum(towards, 1e-4)
        v = (part[..., 2] * t - offset[m, 2]) / tall
        u = (part[..., 1] * sight[0] - part[..., 0] * sight[1]) * t / half
        inside = (towards > 1e-3) & (t > camera.near_m) & (t < depth[box])
        inside &= (v >= 0) & (v < 1) & (np.abs(u) < 1)
        if not inside.any():
            continue
        view = impostors.view_of(float(np.arctan2(sight[1], sight[0])), materials.world.sun_azimuth)
        kind = int(trees.kind[m])
        picture, dark, share = views_of(materials, kind, view, sight, float(far), tall)
        texel = bilinear(picture, (1 - u) / 2 * impostors.COLS - 0.5, v * impostors.ROWS - 0.5)
        # A texel that is larger than a pixel has edges as sharp as a pixel.
        ahead = offset[m] @ basis[0] + tall / 2 * basis[0][2]
        texel_px = tall / max(ahead, camera.near_m) / (2 * camera.half_height / camera.height_px) / impostors.ROWS
        sharp = np.clip(texel_px, 1.0, billboard.MOST_SHARP) * (1 + billboard.BLEND_SHARP * share)
        cover = np.where(inside, np.clip((texel[..., 3] / 255 - 0.5) * sharp + 0.5, 0.0, 1.0), 0.0)
        colour = (texel[..., :3] / np.maximum(texel[..., 3:], 1e-3) / 255) ** 2
        low, high = trees.light[m].astype(np.float64)
        sun = np.clip(low + (high - low) * v, 0, 1)[..., None]
        colour = colour * trees.tint[m] * season[kind] * (dark + (1 - dark) * sun)
        clear = np.exp(-far * materials.look[appearance.HAZE_PER_M])
        passing = light[box]
        added[box] += (passing * cover)[..., None] * (colour * clear + materials.fog * (1 - clear))
        light[box] = passing * (1 - cover)
        solid[box] = np.where((passing > 0.5) & (light[box] <= 0.5), t, solid[box])
    return added, light, solid


def views_of(
    materials: Materials, kind: int, view: int, sight: np.ndarray, far: float, tall: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the picture [rows, columns, 4] (RGB times coverage, and coverage) and the shade [3] of a plant, and the
    share of the neighbouring view in both.

    A low plant near by shows its nearest view and the neighbouring one, half of each in the middle between them.
    """
    turn = (np.arctan2(sight[1], sight[0]) - materials.world.sun_azimuth) * impostors.VIEWS / (2 * np.pi)
    aside = (turn - view + impostors.VIEWS / 2) % impostors.VIEWS - impostors.VIEWS / 2
    part = np.clip((abs(aside) - 0.5 + billboard.BLEND_ZONE) / billboard.BLEND_ZONE, 0, 1)
    fade = np.clip((billboard.BLEND_M - far) / billboard.BLEND_FADE_M, 0, 1)
    share = float(0.5 * part**2 * fade * (tall < billboard.BLEND_HEIGHT_M))
    result = []
    for number in (view, (view + (1 if aside > 0 else -1)) % impostors.VIEWS):
        picture = materials.atlas.picture(kind, number).astype(np.float64)
        weighted = np.concatenate([picture[..., :3] * picture[..., 3:], picture[..., 3:]], axis=-1)
        result.append((weighted, materials.atlas.shade[kind, number].astype(np.float64)))
    (picture, shade), (other, other_shade) = result
    return picture + (other - picture) * share, shade + (other_shade - shade) * share, share


def window(
    offset: np.ndarray, tall: float, half: float, basis: tuple[np.ndarray, ...], camera: Camera, rows: int, columns: int
) -> tuple[slice, slice] | None:
    """Return the rows and columns that the upright picture of a plant at `offset` [3] may touch, or None."""
    forward, right, up = basis
    look = offset[:2] / np.hypot(offset[0], offset[1])
    across = np.array([-look[1], look[0], 0.0]) * half
    corners = np.array([offset + s * across + [0, 0, h] for s in (-1, 1) for h in (0.0, tall)])
    ahead = corners @ forward
    if ahead.max() < camera.near_m:
        return None
    if ahead.min() < camera.near_m:
        return slice(0, rows), slice(0, columns)
    c = ((corners @ right) / ahead / camera.half_width + 1) / 2 * columns
    r = (1 - (corners @ up) / ahead / camera.half_height) / 2 * rows
    c0, c1 = max(int(c.min()) - 1, 0), min(int(c.max()) + 2, columns)
    r0, r1 = max(int(r.min()) - 1, 0), min(int(r.max()) + 2, rows)
    return None if c0 >= c1 or r0 >= r1 else (slice(r0, r1), slice(c0, c1))
