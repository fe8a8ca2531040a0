"""Materials of the reference renderer: the radiance of sky, ground, water and stone at points, without filtering."""

from typing import Any

import numpy as np

from thalweg.render.bake import clouds, impostors, ripples, sky
from thalweg.render.bake.canopy import canopy_map
from thalweg.render.bake.quay_mask import quay_share
from thalweg.render.bake.scene_tables import ground_radiance, sun_vector
from thalweg.render.kernels import bridge_stone
from thalweg.render.kernels.shading import clouds as cloud_shading
from thalweg.render.kernels.shading import ground, mirror, water, water_optics
from thalweg.render.records import appearance, layout
from thalweg.render.reference import bridge as reference_bridge
from thalweg.render.reference import quay
from thalweg.world.banks import has_kind
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
        self.cloud_map = clouds.cloud_map(self.sun, world.seed).astype(np.float64)
        self.fog = sky.haze(self.sun)
        self.atlas = impostors.atlas(world.sun_elevation)
        four, packed = canopy_map(world, self.lit, self.atlas, self.sun)
        self.canopy_code = (four & 255).astype(np.float64)
        self.canopy_paint = np.stack([packed >> shift & 255 for shift in (0, 8, 16, 24)], axis=-1).astype(np.float64)
        self.of_quay = quay_share(world) if has_kind(world.banks, "quay") else None
        """How far each node is ground of a quay, [GY, GX]; None in a world without any."""
        self.props: Any = None
        """`thalweg.render.reference.props.Props` whose waves and mirror images the water shows, or None."""

    def node(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return node coordinates of points in metres."""
        grid = self.world.grid
        return (x - grid.origin_x_m) / grid.cell_m, (y - grid.origin_y_m) / grid.cell_m

    def sky(self, sight: np.ndarray) -> np.ndarray:
        """Return the radiance [..., 3] of the sky and its clouds in unit directions [..., 3]."""
        return self.clouded(sight, self.clear_sky(sight))

    def clouded(self, sight: np.ndarray, behind: np.ndarray) -> np.ndarray:
        """Return the radiance [..., 3] of clouds before a sky [..., 3] in unit directions [..., 3]."""
        scale = clouds.SIDE / 2 / (1 + np.maximum(sight[..., 2], 0))
        texel = bilinear(
            self.cloud_map,
            sight[..., 0] * scale + clouds.SIDE / 2 - 0.5,
            sight[..., 1] * scale + clouds.SIDE / 2 - 0.5,
        )
        excess, light, veil, shown = np.moveaxis(texel * (sight[..., 2:] > 0), -1, 0)
        cover = self.look[appearance.CLOUDS]
        part = (veil * cloud_shading.CIRRUS * min(3 * cover, 1))[..., None]
        behind = behind * (1 - part) + np.array(cloud_shading.CIRRUS_RADIANCE) * part
        part = np.clip((excess - (1 - cover)) / cloud_shading.SOFTNESS, 0, 1)
        part = (part * part * (3 - 2 * part) * shown)[..., None]
        dark, bright = np.array(cloud_shading.DARK), np.array(cloud_shading.BRIGHT)
        return behind * (1 - part) + (dark + (bright - dark) * light[..., None]) * part

    def clear_sky(self, sight: np.ndarray) -> np.ndarray:
        """Return the radiance [..., 3] of the sky without clouds in unit directions [..., 3]."""
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
        radiance = bilinear(self.lit, x, y) * grain[..., None]
        return radiance if self.of_quay is None else quay.over_ground(self, radiance, x, y)

    def grain(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the grain [K] of unit deviation about 0 at texel coordinates of its tile."""
        return (repeating(self.tile, x, y)[..., 3] - 0.5) / ripples.GRAIN_SPREAD

    def sunlit(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the share [K] of the sun at node coordinates."""
        return bilinear(self.share, x, y)

    def quayed(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return how far the ground [K] is that of a quay at node coordinates, in a world with quays."""
        assert self.of_quay is not None
        return bilinear(self.of_quay, x, y)

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
        silt = np.maximum(1 + water.SILT * pebbles, 0)[:, None]
        scatter = self.look[appearance.SCATTER_R : appearance.SCATTER_B + 1] * silt
        under = lit * through + scatter * glow * (1 - through)

        mirror_ray = sight + 2 * facing[:, None] * up
        mirror_ray[:, 2] = np.maximum(mirror_ray[:, 2], 0.02)
        above, passing = self.mirrored(point, mirror_ray)

        half = self.sun - sight
        lean = -half[:, :2] / half[:, 2:] - slope
        variance = water_optics.ROUGHNESS + water_optics.SUN_WIDTH
        density = np.exp(-(lean**2).sum(1) / (2 * variance)) / (2 * np.pi * variance)
        glitter = np.minimum(water_optics.GLITTER * density * sunlit[:, 0] * passing, water_optics.GLITTER_MOST)
        return (
            under * (1 - mirror[:, None])
            + above * mirror[:, None]
            + glitter[:, None] * np.array(water_optics.GLITTER_TINT)
        )

    def ripple(self, x: np.ndarray, y: np.ndarray, time_s: float) -> np.ndarray:
        """Return the slopes [K, 2] of the water at map metres."""
        a_scale, b_scale = ripples.SIZE / water.TILE_A_M, ripples.SIZE / water.TILE_B_M
        a_x, a_y, b_x, b_y = self.look[appearance.DRIFT_A_X : appearance.DRIFT_B_Y + 1]
        a = repeating(self.tile, (x + a_x * time_s) * a_scale, (y + a_y * time_s) * a_scale)
        turned_x, turned_y = 0.6 * x + 0.8 * y, 0.6 * y - 0.8 * x
        b = repeating(self.tile, (turned_x + b_x * time_s) * b_scale, (turned_y + b_y * time_s) * b_scale)
        slope = a[..., :2] + np.stack([0.6 * b[..., 0] - 0.8 * b[..., 1], 0.8 * b[..., 0] + 0.6 * b[..., 1]], axis=-1)
        waves = 0.0 if self.props is None else self.props.slopes(x, y)
        return self.look[appearance.RIPPLE] * slope + waves

    def mirrored(self, point: np.ndarray, mirror_ray: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what reflected rays see [K, 3], and the share [K] of sky in it: canopies are met in growing steps."""
        near, far = np.zeros(len(point)), np.full(len(point), -1.0)
        near_at, far_at = np.full(len(point), mirror.FIRST_M), np.full(len(point), mirror.FIRST_M)
        # Twice as many steps as the kernel takes.
        s = mirror.FIRST_M
        for _ in range(2 * mirror.STEPS):
            above, height = self.canopy_above(point, mirror_ray, s)
            soft = np.minimum(mirror.BLUR_M + mirror.BLUR * s, 2 * height) + 1e-3
            share = np.clip(0.5 + above / soft, 0, 1)
            # The first canopy ends where the ray leaves it again.
            first = far < 0
            to_near = first & (share > near)
            to_far = np.where(first, share < near, share > far)
            near, near_at = np.where(to_near, share, near), np.where(to_near, s, near_at)
            far, far_at = np.where(to_far, share, far), np.where(to_far, s, far_at)
            s *= mirror.GROWTH**0.5
        above, passing = np.zeros((len(point), 3)), np.ones(len(point))
        if self.props is not None:
            above, passing = self.props.mirrored(point, mirror_ray)
        for share, met_at in ((near, near_at), (np.maximum(far, 0), far_at)):
            before = np.where(share >= 0.5, met_at / mirror.GROWTH**0.5, met_at)
            for _ in range(8):
                middle = (before + met_at) / 2
                inside = self.canopy_above(point, mirror_ray, middle)[0] >= 0
                before, met_at = np.where(inside, before, middle), np.where(inside, middle, met_at)
            clear = np.exp(-met_at * self.look[appearance.HAZE_PER_M])[:, None]
            seen = self.canopy_radiance(point + mirror_ray * met_at[:, None], mirror_ray[:, 2] * met_at, met_at)
            above += (passing * share)[:, None] * (seen * clear + self.fog * (1 - clear))
            passing *= 1 - share
        return above + self.sky(mirror_ray) * passing[:, None], passing

    def canopy_above(
        self, point: np.ndarray, mirror_ray: np.ndarray, s: np.ndarray | float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the height [K] of the canopy above reflected rays at the distance s, and that above the water."""
        cell = layout.CANOPY_CELL
        x, y = self.node(point[:, 0] + mirror_ray[:, 0] * s, point[:, 1] + mirror_ray[:, 1] * s)
        code = bilinear(self.canopy_code, (x + 0.5) / cell - 0.5, (y + 0.5) / cell - 0.5) / 255
        height = code**2 * layout.CANOPY_RANGE_M
        return height - mirror_ray[:, 2] * s, height

    def canopy_radiance(self, met: np.ndarray, z: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Return the radiance [K, 3] of the canopy at points [K, 3], z [K] above the water and s [K] from it."""
        cell = layout.CANOPY_CELL
        x, y = self.node(met[:, 0], met[:, 1])
        texel = bilinear(self.canopy_paint, (x + 0.5) / cell - 0.5, (y + 0.5) / cell - 0.5)
        tall = (texel[:, 3] / 255) ** 2 * layout.CANOPY_RANGE_M
        size = ripples.SIZE / mirror.LEAVES_M
        across, along = x * self.world.grid.cell_m + 0.5 * z, y * self.world.grid.cell_m + 0.8 * z
        grain = (repeating(self.tile, across * size, along * size)[..., 3] - 0.5) / ripples.GRAIN_SPREAD
        contrast = mirror.LEAVES * np.minimum(texel[:, 3] * mirror.LEAFY, 1) / (1 + s / mirror.LEAVES_FADE_M)
        rise = np.minimum((z + 1e-3) / (tall + 1e-3), 1)
        light = np.maximum(1 + contrast * grain, 0.2) * (mirror.FOOT_LIGHT + (1 - mirror.FOOT_LIGHT) * rise)
        return (texel[:, :3] / 255) ** 2 * layout.PAINT_RANGE * light[:, None]

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
        open_sky = np.where(under, bridge_stone.SKY_UNDER, 0.55 + 0.45 * np.maximum(normal[:, 2], 0))
        direct = np.where(under, 0.0, facing)
        height = local[:, 2] - spring
        along = np.where(np.abs(normal[:, 0]) < 0.7, local[:, 0], local[:, 1])
        courses = np.where(np.abs(normal[:, 2]) < 0.7, height, local[:, 1])
        ring = np.hypot(local[:, 0] / span, height / (rise + 0.001))
        on_ring = (ring > 0.99) & (ring < 1.16) & (np.abs(normal[:, 1]) > 0.5)
        tone_ = reference_bridge.masonry(along, courses) * np.where(on_ring, 1.18, 1.0)
        tone_ *= 0.55 + 0.45 * np.clip(height * 0.9 + 0.1, 0, 1)
        light = (
            direct[:, None] * layout.SUN_RADIANCE + open_sky[:, None] * layout.SKY_RADIANCE + bridge_stone.BOUNCE
        )  # fmt: skip
        return np.array(bridge_stone.STONE) * tone_[:, None] * light


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
