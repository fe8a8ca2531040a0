"""Materials of the reference renderer: the radiance of sky, ground, water and stone at points, without filtering."""

import numpy as np

from thalweg.render.bake import impostors, ripples, sky
from thalweg.render.bake.scene_tables import (
    canopy_map,
    ground_radiance,
    sun_vector,
)
from thalweg.render.kernels import bridges
from thalweg.render.kernels.shading import ground, water, water_optics
from thalweg.render.records import appearance, layout
from thalweg.render.reference import bridge as reference_bridge
from thalweg.world.record import World


class Materials:
    """A world's maps in float64, and the radiance of what they describe under a look."""

    def __init__(self, world: World, row: np.ndarray) -> None:
        self.world = world
        self.look = row
        ground_m = world.ground_m.astype(np.float64)
        self.surface = np.maximum(ground_m, world.water_m)
        self.wet = world.water_m.astype(np.float64) - ground_m
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
        """Return node coordinates of points in metres."""
        grid = self.world.grid
        return (x - grid.origin_x_m) / grid.cell_m, (y - grid.origin_y_m) / grid.cell_m

    def sky(self, sight: np.ndarray) -> np.ndarray:
        """Return the radiance [..., 3] of the sky in unit directions [..., 3]."""
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

    def ground(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the radiance [..., 3] of the ground at node coordinates."""
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
        """Return the radiance [K, 3] of the water at points [K, 3] (world metres) in directions of sight [K, 3]."""
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
        path = (path + depth * sun_path) * np.maximum(1 + water.BED_ROUGH * pebbles, 0)
        through = np.exp(-self.look[appearance.ABSORB_R : appearance.ABSORB_B + 1] * path[:, None])
        glow = water_optics.SHADE_GLOW + (1 - water_optics.SHADE_GLOW) * sunlit
        under = lit * through + self.look[appearance.SCATTER_R : appearance.SCATTER_B + 1] * glow * (1 - through)

        mirror_ray = sight + 2 * facing[:, None] * up
        mirror_ray[:, 2] = np.maximum(mirror_ray[:, 2], 0.02)
        above, passing = self.mirrored(point, mirror_ray)

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
        """Return the slopes [K, 2] of the water at map metres."""
        a_scale, b_scale = ripples.SIZE / water.TILE_A_M, ripples.SIZE / water.TILE_B_M
        a_x, a_y = water.DRIFT_A_M_PER_S
        b_x, b_y = water.DRIFT_B_M_PER_S
        a = repeating(self.tile, (x + a_x * time_s) * a_scale, (y + a_y * time_s) * a_scale)
        turned_x, turned_y = 0.6 * x + 0.8 * y, 0.6 * y - 0.8 * x
        b = repeating(self.tile, (turned_x + b_x * time_s) * b_scale, (turned_y + b_y * time_s) * b_scale)
        slope = a[..., :2] + np.stack([0.6 * b[..., 0] - 0.8 * b[..., 1], 0.8 * b[..., 0] + 0.6 * b[..., 1]], axis=-1)
        return self.look[appearance.RIPPLE] * slope

    def mirrored(self, point: np.ndarray, mirror_ray: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what reflected rays see [K, 3], and the share [K] of sky in it: canopies are met in growing steps."""
        x, y = self.node(point[:, 0], point[:, 1])
        canopy_cell_m = self.world.grid.cell_m * layout.CANOPY_CELL
        cx, cy = x / layout.CANOPY_CELL, y / layout.CANOPY_CELL
        passing, wood, met_at = np.ones(len(x)), np.zeros((len(x), 3)), np.zeros(len(x))
        s = water.MIRROR_FIRST_M
        for _ in range(water.MIRROR_STEPS):
            qx = np.clip(cx + mirror_ray[:, 0] * s / canopy_cell_m, 0, self.canopy.shape[1] - 1).astype(int)
            qy = np.clip(cy + mirror_ray[:, 1] * s / canopy_cell_m, 0, self.canopy.shape[0] - 1).astype(int)
            above = self.canopy[qy, qx] - point[:, 2] - mirror_ray[:, 2] * s
            part = passing * np.clip(above / (water.MIRROR_BLUR_M + water.MIRROR_BLUR * s), 0, 1)
            wood += part[:, None] * self.canopy_colour[qy, qx]
            met_at += part * s
            passing = passing - part
            s *= water.MIRROR_GROWTH
        clear = np.exp(-met_at * self.look[appearance.HAZE_PER_M])[:, None]
        haze = (1 - passing)[:, None] * (1 - clear)
        return wood * clear + self.fog * haze + self.sky(mirror_ray) * passing[:, None], passing

    def stone(self, bridge: np.ndarray, normal: np.ndarray, local: np.ndarray) -> np.ndarray:
        """Return the radiance [K, 3] of masonry for normals and points [K, 3] in the bridge's frame (u, v, z)."""
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


def bilinear(table_2d: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the values [...] or [..., C] of a map [R, C] or [R, C, channels] at node coordinates, its border
    continued.
    """
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
    """Return the values [..., C] of a tile [R, R, C] that repeats, at its own texel coordinates."""
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    u, v = (x - column)[..., None], (y - row)[..., None]
    size = len(tile)
    c0, c1, r0, r1 = column % size, (column + 1) % size, row % size, (row + 1) % size
    low = tile[r0, c0] * (1 - u) + tile[r0, c1] * u
    high = tile[r1, c0] * (1 - u) + tile[r1, c1] * u
    return low * (1 - v) + high * v
