"""The rules of the boat, slow and obvious, from the maps of a world; it shares no code with the kernels."""

import math

import numpy as np
import scipy

from tests.env.vehicle.polygons import distance, gap, rectangle
from thalweg.env import EnvConfig
from thalweg.world.bridges import Bridge
from thalweg.world.record import World
from thalweg.world.species import KINDS


class ReferenceBoat:
    """What a hull hits in a world, and what the water under it costs."""

    def __init__(self, world: World, config: EnvConfig) -> None:
        self.boat, self.grid = config.boat, world.grid
        self.depth = world.water_m.astype(float) - world.ground_m
        self.rocks = [
            self._rock(world, row) for row, kind in enumerate(world.plants.kind) if KINDS[kind].group == "rock"
        ]
        self.rocks = [rock for rock in self.rocks if rock[2] > 0]
        self.arches = [self._arch(Bridge(*row), world) for row in world.bridges]

    def hits(self, x: float, y: float, yaw: float) -> str:
        """`solid`, `aground` or an empty string, for a hull that lies still; `unsure` within a millionth."""
        hull = rectangle(x, y, yaw, self.boat.length_m / 2, self.boat.beam_m / 2)
        near = [distance(hull, rock[:2]) - rock[2] for rock in self.rocks if np.hypot(*(rock[:2] - [x, y])) < 8]
        near += [gap(hull, polygon) for piers, *_ in self.arches for polygon in piers]
        if any(abs(apart) < 1e-6 and apart != 0.0 for apart in near):
            return "unsure"
        if any(apart <= 0 for apart in near) or any(self._mast(arch, x, y) for arch in self.arches):
            return "solid"
        spare = self.least_depth(x, y, yaw) - self.boat.draught_m
        if abs(spare) < 1e-6:
            return "unsure"
        return "aground" if spare < 0 else ""

    def least_depth(self, x: float, y: float, yaw: float) -> float:
        """The least depth at the points under the hull, in metres."""
        ahead, left = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 5))
        ahead, left = ahead.ravel() * self.boat.length_m / 2, left.ravel() * self.boat.beam_m / 2
        px = x + ahead * math.cos(yaw) - left * math.sin(yaw)
        py = y + ahead * math.sin(yaw) + left * math.cos(yaw)
        column, row = (px - self.grid.origin_x_m) / self.grid.cell_m, (py - self.grid.origin_y_m) / self.grid.cell_m
        return float(scipy.ndimage.map_coordinates(self.depth, [row, column], order=1).min())

    def cost(self, x: float, y: float, yaw: float) -> float:
        """The cost of the water under a hull."""
        spare = self.least_depth(x, y, yaw) - self.boat.draught_m
        return min(max(1.0 - spare / self.boat.keel_margin_m, 0.0), 1.0)

    def _level(self, world: World, point: np.ndarray) -> float:
        return float(world.river.level_m[np.linalg.norm(world.river.position_m - point, axis=1).argmin()])

    def _rock(self, world: World, row: int) -> np.ndarray:
        """x, y, and the greatest radius at a thousand heights between keels and deck."""
        plants, kind = world.plants, KINDS[world.plants.kind[row]]
        x, y, foot = (float(value) for value in plants.position_m[row])
        level = self._level(world, np.array([x, y]))
        heights = np.linspace(level - self.boat.draught_m, level + self.boat.hull_height_m, 20001)
        share = (heights - foot) / float(plants.height_m[row])
        radius = np.where((share >= 0) & (share <= 1), kind.crown_radius(np.clip(share, 0, 1)), 0.0).max()
        return np.array([x, y, radius * float(plants.width_m[row]) / 2])

    def _arch(self, bridge: Bridge, world: World) -> tuple:
        """Two piers as polygons, the bridge, and half of the opening at the top of the mast."""
        level = self._level(world, np.array([bridge.x, bridge.y]))
        hull, mast = (
            bridge.span / 2 * math.sqrt(max(1 - (max(level + top - bridge.spring_z, 0) / bridge.rise) ** 2, 0))
            for top in (self.boat.hull_height_m, self.boat.camera_height_m)
        )
        middle, half = (bridge.length / 2 + hull) / 2, (bridge.length / 2 - hull) / 2
        along = np.array([math.cos(bridge.angle), math.sin(bridge.angle)])
        ends = [np.array([bridge.x, bridge.y]) + side * middle * along for side in (1, -1)]
        return [rectangle(x, y, bridge.angle, half, bridge.width / 2) for x, y in ends], bridge, mast

    def _mast(self, arch: tuple, x: float, y: float) -> bool:
        _, bridge, mast = arch
        cos, sin = math.cos(bridge.angle), math.sin(bridge.angle)
        u, v = cos * (x - bridge.x) + sin * (y - bridge.y), cos * (y - bridge.y) - sin * (x - bridge.x)
        return abs(v) <= bridge.width / 2 and mast <= abs(u) <= bridge.length / 2
