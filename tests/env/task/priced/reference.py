"""Reference of the costs and rewards of tasks, slow and obvious: computed from poses alone, along the whole course, in
plain NumPy.

It shares no code with the kernels but the planes of bridges grown by the body, which have tests of their own.
"""

import math

import numpy as np

from thalweg.env.task.course_arrays import grown_hull
from thalweg.world.record import River, World

MASK = (1 << 64) - 1


def polyline(river: River) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points [K, 2] of the centre line, its arc lengths [K], widths [K] and levels [K]; a loop returns to its first."""
    columns = river.position_m, river.arc_m, river.width_m, river.level_m
    if not river.closed:
        return columns
    ends = river.position_m[:1], [river.length_m], river.width_m[:1], river.level_m[:1]
    points, arcs, widths, levels = (np.concatenate(pair) for pair in zip(columns, ends, strict=True))
    return points, arcs, widths, levels


def nearest(river: River, x: float, y: float) -> tuple[float, float, float]:
    """(arc, metres past the bank, water level) of the nearest point of the arm between whose banks a point is
    deepest."""
    points, *values = polyline(river)
    begin, along = points[:-1], np.diff(points, axis=0)
    t = np.clip((((x, y) - begin) * along).sum(1) / (along * along).sum(1), 0.0, 1.0)
    distance = np.linalg.norm(begin + t[:, None] * along - (x, y), axis=1)
    arc, width, level = ((1 - t) * each[:-1] + t * each[1:] for each in values)
    deepest, count = int((distance - width / 2).argmin()), len(t)
    arm = [deepest + shift for shift in range(-4, 5)]
    arm = [k % count for k in arm] if river.closed else [k for k in arm if 0 <= k < count]
    k = min(arm, key=lambda k: distance[k])
    return float(arc[k]), float(distance[k] - width[k] / 2), float(level[k])


def on_island(world: World, x: float, y: float) -> bool:
    """Whether a point lies on an island."""
    for cx, cy, along, across, angle in world.islands:
        u = (x - cx) * math.cos(angle) + (y - cy) * math.sin(angle)
        v = (y - cy) * math.cos(angle) - (x - cx) * math.sin(angle)
        if (u / along) ** 2 + (v / across) ** 2 <= 1:
            return True
    return False


def over_land(world: World, x: float, y: float) -> bool:
    """Whether a point is over land."""
    return nearest(world.river, x, y)[1] > 1e-9 or on_island(world, x, y)


def island_distance(row: np.ndarray, x: float, y: float) -> float:
    """Distance from the nearest of many points of an island's edge."""
    t = np.linspace(0, 2 * np.pi, 5_001)
    u, v = row[2] * np.cos(t), row[3] * np.sin(t)
    cos, sin = math.cos(row[4]), math.sin(row[4])
    return float(np.hypot(row[0] + cos * u - sin * v - x, row[1] + sin * u + cos * v - y).min())


def clearance(world: World, pose: np.ndarray, body_m: float) -> float:
    """Least distance from bank, island and stone; 0 on land."""
    x, y, z = pose[:3]
    found = [-nearest(world.river, x, y)[1]]
    found += [0.0 if on_island(world, x, y) else island_distance(row, x, y) for row in world.islands]
    for row in world.bridges:
        planes = grown_hull(row, body_m)[0]
        found.append(float((planes[:, :3] @ (x, y, z) - planes[:, 3]).max()))
    return max(min(found), 0.0)


def _hash(key: int) -> int:
    key = (key + 0x9E3779B97F4A7C15) & MASK
    key = ((key ^ (key >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    key = ((key ^ (key >> 27)) * 0x94D049BB133111EB) & MASK
    return key ^ (key >> 31)


def _uniform(scene: int, index: int, counter: int) -> float:
    return (_hash(_hash(_hash(scene) + index & MASK) + counter & MASK) >> 11) / 2**53


def swimmers(river: River, haunts: np.ndarray, count: int, scene: int, steps: int) -> np.ndarray:
    """Places [M, 2] of the swimmers and kayaks of a scene after so many steps, from the places that they move about."""
    points, arcs, widths, _ = polyline(river)
    tangents = np.concatenate([river.tangent, river.tangent[:1]]) if river.closed else river.tangent
    places = []
    for i in range(count):
        home = haunts[int((i + _uniform(scene, i, 0)) * len(haunts) / count)]
        reach = 10.0 if _uniform(scene, i, 1) < 0.25 else 3.0
        along = 2 * math.pi * (steps / (120 + 120 * _uniform(scene, i, 2)) + _uniform(scene, i, 4))
        across = 2 * math.pi * (steps / (80 + 80 * _uniform(scene, i, 3)) + _uniform(scene, i, 5))
        arc = home + reach * math.sin(along)
        arc = arc % river.length_m if river.closed else arc
        x, y, tx, ty = (np.interp(arc, arcs, values) for values in (*points.T, *tangents.T))
        aside = (np.interp(arc, arcs, widths) / 2 - 0.8) * math.sin(across) / math.hypot(tx, ty)
        places.append((x - aside * ty, y + aside * tx))
    return np.array(places)
