"""The reference renderer, which defines a frame: plain NumPy in float64, many samples a pixel, no prefiltering.

When a kernel and this file differ, this file is checked first. Rays are marched in small steps over the world's
own heights, and instead of choosing a level of a texture by the pixel's footprint it averages samples of the finest.
What is baked before any ray is drawn is shared with the kernels and tested by itself: the ground's radiance, the map of
canopies, the sky, the tile of ripples, the billboards of plants, and all constants. It is slow on purpose: a 32x32
frame with 16 samples a pixel takes a few seconds.
"""

from dataclasses import dataclass, replace

import numpy as np

from thalweg.render.bake import impostors, ripples, sky
from thalweg.render.bake.scene_tables import (
    autumn,
    canopy_map,
    ground_radiance,
    plant_ranks,
    sun_vector,
)
from thalweg.render.kernels import bridges, heightfield_march, plants
from thalweg.render.kernels.shading import ground, tone, water, water_optics
from thalweg.render.records import appearance, classes, layout
from thalweg.render.records.appearance import Look, look_rows, look_values
from thalweg.render.records.camera import Camera
from thalweg.render.reference import bridge as reference_bridge
from thalweg.world.record import World


@dataclass(frozen=True)
class ReferenceFrame:
    """One frame of the reference renderer."""

    rgb: np.ndarray
    """[H, W, 3] uint8."""
    mask: np.ndarray
    """[H, W] bool, by the ray through each pixel's centre."""
    depth_m: np.ndarray
    """[H, W] float64 along the optical axis, by the centre ray; -1 for the sky."""
    class_id: np.ndarray
    """[H, W] uint8, by the centre ray."""


def draw(
    world: World,
    pose: np.ndarray,
    camera: Camera,
    *,
    samples: int = 4,
    time_s: float = 0.0,
    look: Look | None = None,
) -> ReferenceFrame:
    """The frame of a pose [4] (x, y, z, yaw) with samples x samples rays a pixel, without the sensor's noise."""
    seen = look or Look()
    row = look_rows(look_values(seen, 1), camera)[0].astype(np.float64)
    camera = replace(camera, pitch_deg=camera.pitch_deg + seen.pitch_deg, fov_deg=camera.fov_deg + seen.fov_deg)
    scene = _Valley(world, row)
    radiance, _, _ = scene.trace(pose, camera, samples, time_s)
    height, width = camera.height_px, camera.width_px
    radiance = radiance.reshape(height, samples, width, samples, 3).mean(axis=(1, 3))
    luma = np.minimum(radiance @ np.array(tone.LUMA), tone.BRIGHTEST).mean()
    grey = (radiance @ np.array(tone.LUMA))[..., None]
    vivid = np.maximum(grey + (radiance - grey) * tone.SATURATION, 0.0)
    exposed = vivid * (tone.KEY / max(luma, 1e-4)) ** tone.ADAPTATION * row[appearance.GAIN_R : appearance.GAIN_B + 1]
    rgb = np.rint(tone.encode(tone.curve(exposed)) * 255).astype(np.uint8)
    _, depth, kind = scene.trace(pose, camera, 1, time_s)
    return ReferenceFrame(rgb, kind == classes.WATER, np.where(np.isinf(depth), -1.0, depth), kind)


def bilinear(table_2d: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Values [...] or [..., C] of a map [R, C] or [R, C, channels] at node coordinates, its border continued."""
    x = np.clip(x, 0, table_2d.shape[1] - 1.001)
    y = np.clip(y, 0, table_2d.shape[0] - 1.001)
    column, row = x.astype(int), y.astype(int)
    u, v = x - column, y - row
    if table_2d.ndim == 3:
        u, v = u[..., None], v[..., None]
    low = table_2d[row, column] * (1 - u) + table_2d[row, column + 1] * u
    high = table_2d[row + 1, column] * (1 - u) + table_2d[row + 1, column + 1] * u
    return low * (1 - v) + high * v


def repeating(tile: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Values [..., C] of a tile [R, R, C] that repeats, at its own texel coordinates."""
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    u, v = (x - column)[..., None], (y - row)[..., None]
    size = len(tile)
    c0, c1, r0, r1 = column % size, (column + 1) % size, row % size, (row + 1) % size
    low = tile[r0, c0] * (1 - u) + tile[r0, c1] * u
    high = tile[r1, c0] * (1 - u) + tile[r1, c1] * u
    return low * (1 - v) + high * v


class _Valley:
    """A world's maps, in float64, as the definition reads them."""

    def __init__(self, world: World, row: np.ndarray) -> None:
        self.world = world
        self.look = row
        self.ground = world.ground_m.astype(np.float64)
        self.surface = np.maximum(self.ground, world.water_m)
        self.wet = world.water_m.astype(np.float64) - self.ground
        self.sun = sun_vector(world)
        self.lit = ground_radiance(world, self.sun)
        self.share = world.sun / 255.0
        self.tile = ripples.tile()[0]
        self.sky_map = sky.sky_map(self.sun, world.seed)
        self.fog = sky.haze(self.sun)
        self.canopy, packed = canopy_map(world, self.lit)
        coded = np.stack([packed >> shift & 255 for shift in (0, 8, 16)], axis=-1) / 255.0
        self.canopy_colour = coded**2 * layout.PAINT_RANGE
        self.atlas = impostors.atlas(world.sun_elevation)

    def node(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        grid = self.world.grid
        return (x - grid.origin_x_m) / grid.cell_m, (y - grid.origin_y_m) / grid.cell_m

    def trace(
        self, pose: np.ndarray, camera: Camera, samples: int, time_s: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Radiance [R, C, 3], depth [R, C] (inf: sky) and class [R, C] of samples x samples rays a pixel."""
        rows, columns = camera.height_px * samples, camera.width_px * samples
        sy = camera.half_height * (1 - 2 * (np.arange(rows) + 0.5) / rows)
        sx = camera.half_width * (2 * (np.arange(columns) + 0.5) / columns - 1)
        forward, right, up = axes(pose[3], np.radians(camera.pitch_deg))
        ray = forward + sy[:, None, None] * up + sx[None, :, None] * right
        eye = np.asarray(pose[:3], np.float64)

        depth = self.meet_ground(eye, ray, camera.near_m)
        kind = np.where(np.isinf(depth), classes.SKY, classes.GROUND).astype(np.uint8)
        radiance = np.zeros((rows, columns, 3))
        for bridge in self.world.bridges:
            depth_b, normal, local = reference_bridge.meet_bridge(
                bridge, eye, ray, camera.near_m, np.minimum(depth, bridges.FAR_M)
            )
            met = np.isfinite(depth_b)
            depth = np.where(met, depth_b, depth)
            kind[met] = classes.BRIDGE
            radiance[met] = self.stone(bridge, normal[met], local[met])

        point = eye + ray * np.where(np.isinf(depth), 0.0, depth)[..., None]
        far = np.where(np.isinf(depth), 0.0, depth) * np.linalg.norm(ray, axis=-1)
        sight = ray / np.linalg.norm(ray, axis=-1, keepdims=True)
        x, y = self.node(point[..., 0], point[..., 1])
        kind[(kind == classes.GROUND) & (bilinear(self.wet, x, y) > 0)] = classes.WATER
        sky_seen = kind == classes.SKY
        radiance[sky_seen] = self.sky(sight[sky_seen])
        dry = kind == classes.GROUND
        radiance[dry] = self.dry(x[dry], y[dry])
        wet = kind == classes.WATER
        radiance[wet] = self.water(point[wet], sight[wet], time_s)
        clear = np.exp(-far * self.look[appearance.HAZE_PER_M])[..., None]
        radiance = np.where(sky_seen[..., None], radiance, radiance * clear + self.fog * (1 - clear))

        green, light, solid = self.plants(eye, ray, (forward, right, up), camera, depth)
        radiance = green + light[..., None] * radiance
        covered = light <= 0.5
        return radiance, np.where(covered, solid, depth), np.where(covered, classes.PLANT, kind).astype(np.uint8)

    def meet_ground(self, eye: np.ndarray, ray: np.ndarray, near: float) -> np.ndarray:
        """Depth [R, C] at which each ray meets the surface, inf where it leaves."""
        flat = ray.reshape(-1, 3)
        t = np.full(len(flat), near)
        before, found = t.copy(), np.full(len(flat), np.inf)
        live = np.arange(len(flat))
        summit = self.surface.max()
        while len(live):
            p = eye + flat[live] * t[live, None]
            gap = p[:, 2] - bilinear(self.surface, *self.node(p[:, 0], p[:, 1]))
            below = gap <= 0
            hit = live[below]
            low, high = before[hit], t[hit]
            for _ in range(30):
                middle = (low + high) / 2
                p = eye + flat[hit] * middle[:, None]
                inside = p[:, 2] <= bilinear(self.surface, *self.node(p[:, 0], p[:, 1]))
                low, high = np.where(inside, low, middle), np.where(inside, middle, high)
            found[hit] = high
            live, gap = live[~below], gap[~below]
            before[live] = t[live]
            speed = np.linalg.norm(flat[live, :2], axis=1)
            by_height = 0.4 * gap / np.maximum(1.5 * speed - flat[live, 2], 0.05)
            t[live] += np.maximum(np.maximum(0.03, 0.002 * t[live]), by_height)
            gone = (t[live] > heightfield_march.FAR_M) | (
                (flat[live, 2] > 0) & (eye[2] + flat[live, 2] * t[live] > summit)
            )
            live = live[~gone]
        return np.where(found < heightfield_march.FAR_M, found, np.inf).reshape(ray.shape[:2])

    def sky(self, sight: np.ndarray) -> np.ndarray:
        """Radiance [..., 3] of the sky in unit directions [..., 3]."""
        sine = sight[..., 2]
        v = (0.5 + 0.5 * np.sign(sine) * np.sqrt(np.abs(sine))) * sky.ROWS - 0.5
        east = sight[..., 0] / (np.abs(sight[..., 0]) + np.abs(sight[..., 1]) + 1e-12)
        turn = np.where(sight[..., 1] >= 0, 1 - east, 3 + east)
        u = (turn * sky.COLUMNS / 4 - 0.5) % sky.COLUMNS
        wrapped = np.concatenate([self.sky_map, self.sky_map[:, :1]], axis=1)
        column = u.astype(int)
        v = np.clip(v, 0, sky.ROWS - 1.001)
        row = v.astype(int)
        a, b = (u - column)[..., None], (v - row)[..., None]
        low = wrapped[row, column] * (1 - a) + wrapped[row, column + 1] * a
        high = wrapped[row + 1, column] * (1 - a) + wrapped[row + 1, column + 1] * a
        return low * (1 - b) + high * b

    def dry(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Radiance [..., 3] of the ground at node coordinates."""
        cell = self.world.grid.cell_m
        xm, ym = x * cell, y * cell
        small, large = ripples.SIZE / ground.GRAIN_M, ripples.SIZE / ground.PATCH_M
        a = repeating(self.tile, xm * small, ym * small)[..., 3]
        b = repeating(self.tile, (0.8 * xm - 0.6 * ym) * large, (0.6 * xm + 0.8 * ym) * large)[..., 3]
        fine, patch = (a - 0.5) / ripples.GRAIN_SPREAD, (b - 0.5) / ripples.GRAIN_SPREAD
        sun = np.clip(bilinear(self.share, x, y), 0, 1)
        flecks = np.clip(sun + 4 * ground.DAPPLE * sun * (1 - sun) * patch, 0, 1)
        grain = np.maximum((1 + ground.GRAIN_DEPTH * fine) * (1 + ground.PATCH_DEPTH * patch), 0.2)
        grain *= (ground.SKY_SHARE + flecks) / (ground.SKY_SHARE + sun)
        return bilinear(self.lit, x, y) * grain[..., None]

    def water(self, point: np.ndarray, sight: np.ndarray, time_s: float) -> np.ndarray:
        """Radiance [K, 3] of the water at points [K, 3] (world metres) in directions of sight [K, 3]."""
        cell = self.world.grid.cell_m
        x, y = self.node(point[:, 0], point[:, 1])
        slope = self.ripple(x * cell, y * cell, time_s)
        up = np.concatenate([-slope, np.ones((len(slope), 1))], axis=1)
        up /= np.linalg.norm(up, axis=1, keepdims=True)
        facing = np.clip(-(sight * up).sum(1), 0.01, 1.0)
        rough = np.sqrt(water_optics.ROUGHNESS)
        mirror = 0.02 + 0.98 * (1 - facing) ** 5 / (1 + 22.7 * rough**1.5)

        depth = np.maximum(bilinear(self.wet, x, y), 0)
        bent = sight[:, :2] / water_optics.INDEX + 0.25 * slope
        down = np.sqrt(np.maximum(1 - (bent**2).sum(1), 0.1))
        path = depth / down
        bed = x + bent[:, 0] * path / cell, y + bent[:, 1] * path / cell
        sunlit = bilinear(self.share, *bed)[:, None]
        sun_path = 1 / np.sqrt(1 - (1 - self.sun[2] ** 2) / water_optics.INDEX**2)
        size = ripples.SIZE / water.BED_M
        pebbles = (
            repeating(self.tile, bed[0] * cell * size, bed[1] * cell * size)[..., 3] - 0.5
        ) / ripples.GRAIN_SPREAD
        lit = bilinear(self.lit, *bed) * np.maximum(1 + water.BED_DEPTH * pebbles, 0.2)[:, None]
        whole = (path + depth * sun_path) * np.maximum(1 + water.BED_ROUGH * pebbles, 0)
        through = np.exp(-self.look[appearance.ABSORB_R : appearance.ABSORB_B + 1] * whole[:, None])
        glow = water_optics.SHADE_GLOW + (1 - water_optics.SHADE_GLOW) * sunlit
        under = lit * through + self.look[appearance.SCATTER_R : appearance.SCATTER_B + 1] * glow * (1 - through)

        turned = sight + 2 * facing[:, None] * up
        turned[:, 2] = np.maximum(turned[:, 2], 0.02)
        above, passing = self.mirrored(point, turned)

        half = self.sun - sight
        lean = -half[:, :2] / half[:, 2:] - slope
        width = water_optics.ROUGHNESS + water_optics.SUN_WIDTH
        density = np.exp(-(lean**2).sum(1) / (2 * width)) / (2 * np.pi * width)
        glitter = np.minimum(water_optics.GLITTER * density * sunlit[:, 0] * passing, water_optics.GLITTER_MOST)
        return (
            under * (1 - mirror[:, None])
            + above * mirror[:, None]
            + glitter[:, None] * np.array(water_optics.GLITTER_TINT)
        )

    def ripple(self, x: np.ndarray, y: np.ndarray, time_s: float) -> np.ndarray:
        """Slopes [K, 2] of the water at map metres."""
        a_scale, b_scale = ripples.SIZE / water.TILE_A_M, ripples.SIZE / water.TILE_B_M
        a_x, a_y = water.DRIFT_A_M_PER_S
        b_x, b_y = water.DRIFT_B_M_PER_S
        a = repeating(self.tile, (x + a_x * time_s) * a_scale, (y + a_y * time_s) * a_scale)
        turned_x, turned_y = 0.6 * x + 0.8 * y, 0.6 * y - 0.8 * x
        b = repeating(self.tile, (turned_x + b_x * time_s) * b_scale, (turned_y + b_y * time_s) * b_scale)
        slope = a[..., :2] + np.stack([0.6 * b[..., 0] - 0.8 * b[..., 1], 0.8 * b[..., 0] + 0.6 * b[..., 1]], axis=-1)
        return self.look[appearance.RIPPLE] * slope

    def mirrored(self, point: np.ndarray, turned: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What reflected rays see [K, 3], and the share [K] of the sky in it: canopies met in growing steps."""
        x, y = self.node(point[:, 0], point[:, 1])
        cells = self.world.grid.cell_m * layout.CANOPY_CELL
        cx, cy = x / layout.CANOPY_CELL, y / layout.CANOPY_CELL
        passing, wood, met_at = np.ones(len(x)), np.zeros((len(x), 3)), np.zeros(len(x))
        s = water.MIRROR_FIRST_M
        for _ in range(water.MIRROR_STEPS):
            qx = np.clip(cx + turned[:, 0] * s / cells, 0, self.canopy.shape[1] - 1).astype(int)
            qy = np.clip(cy + turned[:, 1] * s / cells, 0, self.canopy.shape[0] - 1).astype(int)
            above = self.canopy[qy, qx] - point[:, 2] - turned[:, 2] * s
            part = passing * np.clip(above / (water.MIRROR_BLUR_M + water.MIRROR_BLUR * s), 0, 1)
            wood += part[:, None] * self.canopy_colour[qy, qx]
            met_at += part * s
            passing = passing - part
            s *= water.MIRROR_GROWTH
        clear = np.exp(-met_at * self.look[appearance.HAZE_PER_M])[:, None]
        haze = (1 - passing)[:, None] * (1 - clear)
        return wood * clear + self.fog * haze + self.sky(turned) * passing[:, None], passing

    def stone(self, bridge: np.ndarray, normal: np.ndarray, local: np.ndarray) -> np.ndarray:
        """Radiance [K, 3] of masonry for normals [K, 3] and points [K, 3] in the bridge's frame (u, v, z)."""
        angle, span, spring, rise = bridge[2], bridge[5] / 2, bridge[6], bridge[7]
        world_normal = np.stack(
            [
                normal[:, 0] * np.cos(angle) - normal[:, 1] * np.sin(angle),
                normal[:, 0] * np.sin(angle) + normal[:, 1] * np.cos(angle),
                normal[:, 2],
            ],
            axis=1,
        )
        facing = np.maximum(world_normal @ self.sun, 0)
        under = (normal[:, 1] == 0) & (normal[:, 2] < 0.5) & (np.abs(local[:, 0]) < span + 0.02)
        open_sky = np.where(under, bridges.SKY_UNDER, 0.55 + 0.45 * np.maximum(normal[:, 2], 0))
        direct = np.where(under, 0.0, facing)
        height = local[:, 2] - spring
        along = np.where(np.abs(normal[:, 0]) < 0.7, local[:, 0], local[:, 1])
        courses = np.where(np.abs(normal[:, 2]) < 0.7, height, local[:, 1])
        ring = np.hypot(local[:, 0] / span, height / (rise + 0.001))
        on_ring = (ring > 0.99) & (ring < 1.16) & (np.abs(normal[:, 1]) > 0.5)
        tone_ = reference_bridge.masonry(along, courses) * np.where(on_ring, 1.18, 1.0)
        tone_ *= 0.55 + 0.45 * np.clip(height * 0.9 + 0.1, 0, 1)
        light = (
            direct[:, None] * layout.SUN_RADIANCE + open_sky[:, None] * layout.SKY_RADIANCE + bridges.BOUNCE
        )  # fmt: skip
        return np.array(bridges.STONE) * tone_[:, None] * light

    def plants(
        self, eye: np.ndarray, ray: np.ndarray, basis: tuple[np.ndarray, ...], camera: Camera, depth: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What plants add [R, C, 3], what they let through [R, C], and the depth [R, C] at which half is stopped."""
        rows, columns = depth.shape
        added, light, solid = np.zeros((rows, columns, 3)), np.ones((rows, columns)), np.full((rows, columns), np.inf)
        trees = self.world.plants
        offset = trees.position_m.astype(np.float64) - eye
        distance = np.hypot(offset[:, 0], offset[:, 1])
        rank = plant_ranks(len(distance))
        season = 1 + self.look[appearance.SEASON] * (autumn().astype(np.float64) - 1)
        for m in np.argsort(distance, kind="stable"):
            far = distance[m]
            if far < plants.NEAR_M or far > plants.FAR_M or rank[m] >= self.look[appearance.DENSITY]:
                continue
            tall, half = float(trees.height_m[m]), float(trees.width_m[m]) / 2
            box = window(offset[m], tall, half, basis, camera, rows, columns)
            if box is None:
                continue
            part = ray[box]
            look = offset[m, :2] / far
            towards = part[..., :2] @ look
            t = far / np.maximum(towards, 1e-4)
            v = (part[..., 2] * t - offset[m, 2]) / tall
            u = (part[..., 1] * look[0] - part[..., 0] * look[1]) * t / half
            inside = (towards > 1e-3) & (t > camera.near_m) & (t < depth[box])
            inside &= (v >= 0) & (v < 1) & (np.abs(u) < 1)
            if not inside.any():
                continue
            view = impostors.view_of(float(np.arctan2(look[1], look[0])), self.world.sun_azimuth)
            kind = int(trees.kind[m])
            picture = self.atlas.picture(kind, view).astype(np.float64)
            weighted = np.concatenate([picture[..., :3] * picture[..., 3:], picture[..., 3:]], axis=-1)
            texel = bilinear(weighted, (1 - u) / 2 * impostors.COLS - 0.5, v * impostors.ROWS - 0.5)
            cover = np.where(inside, texel[..., 3] / 255, 0.0)
            colour = (texel[..., :3] / np.maximum(texel[..., 3:], 1e-3) / 255) ** 2
            low, high = trees.light[m].astype(np.float64)
            sun = np.clip(low + (high - low) * v, 0, 1)[..., None]
            dark = self.atlas.shade[kind, view].astype(np.float64)
            colour = colour * trees.tint[m] * season[kind] * (dark + (1 - dark) * sun)
            clear = np.exp(-far * self.look[appearance.HAZE_PER_M])
            passing = light[box]
            added[box] += (passing * cover)[..., None] * (colour * clear + self.fog * (1 - clear))
            light[box] = passing * (1 - cover)
            solid[box] = np.where((passing > 0.5) & (light[box] <= 0.5), t, solid[box])
        return added, light, solid


def axes(yaw: float, pitch: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Forward, right and up unit vectors of a camera."""
    level = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    forward = level * np.cos(pitch) - up * np.sin(pitch)
    return forward, np.array([np.sin(yaw), -np.cos(yaw), 0.0]), level * np.sin(pitch) + up * np.cos(pitch)


def window(
    offset: np.ndarray, tall: float, half: float, basis: tuple[np.ndarray, ...], camera: Camera, rows: int, columns: int
) -> tuple[slice, slice] | None:
    """The rows and columns that the upright picture of a plant at `offset` [3] may touch, or None."""
    forward, right, up = basis
    look = offset[:2] / np.hypot(offset[0], offset[1])
    aside = np.array([-look[1], look[0], 0.0]) * half
    corners = np.array([offset + s * aside + [0, 0, h] for s in (-1, 1) for h in (0.0, tall)])
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
