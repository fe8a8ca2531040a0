"""Reference implementation of the rules, slow and obvious, written from the table of the task.

One episode in plain Python and NumPy. It shares no code with the kernels but the record of a world and the planes of
bridges grown by the body, which have tests of their own.
"""

import math

import numpy as np

from thalweg.env import EnvConfig
from thalweg.env.task.course_arrays import grown_hull, step_limit
from thalweg.world.record import World

TOLERANCE = 1e-9


def wrap_angle(angle: float) -> float:
    return (angle + math.pi) % (2 * math.pi) - math.pi


class ReferenceEpisode:
    """One episode that starts at a pose [4]."""

    def __init__(self, world: World, config: EnvConfig, pose: np.ndarray) -> None:
        self.world, self.config, self.river = world, config, world.river
        self.x, self.y, self.z, self.yaw = (float(value) for value in pose)
        self.max_steps = step_limit(world, config)
        self.hulls = [grown_hull(row, config.body_m)[0] for row in world.bridges]
        self.visited: set[int] = set()
        self.steps = self.idle = 0
        everywhere = [self.nearest(k) for k in range(self.river.segments)]
        depth = [d - self.linear(k, t, self.river.width_m) / 2 for k, (d, t) in enumerate(everywhere)]
        self.segment = self.follow(int(np.argmin(depth)))[0]
        self.travel = 1
        self.travel = 1 if self.deviation(*self.follow(self.segment)[:2]) <= math.pi / 2 else -1

    def ends(self, k: int) -> tuple[int, int]:
        return k, (k + 1) % len(self.river.arc_m)

    def nearest(self, k: int) -> tuple[float, float]:
        a, b = (self.river.position_m[i] for i in self.ends(k))
        p = np.array([self.x, self.y])
        t = float(np.clip(np.dot(p - a, b - a) / np.dot(b - a, b - a), 0, 1))
        return float(np.linalg.norm(a + t * (b - a) - p)), t

    def linear(self, k: int, t: float, values: np.ndarray) -> float:
        a, b = self.ends(k)
        return float((1 - t) * values[a] + t * values[b])

    def follow(self, start: int) -> tuple[int, float, float, list[int]]:
        """Return (segment, fraction, distance, passed segments with both ends)."""
        count, closed = self.river.segments, self.river.closed
        best = (self.nearest(start)[0], 0)
        for way in (1, -1):
            previous = self.nearest(start)[0]
            for shift in range(1, (count - 1) // 2 + 1 if closed else count + 1):
                k = start + way * shift
                if not closed and not 0 <= k < count:
                    break
                distance = self.nearest(k % count)[0]
                if distance**2 < best[0] ** 2 - 1e-9:
                    best = (distance, way * shift)
                if shift >= 2 and distance >= previous:
                    break
                previous = distance
        shift = best[1]
        passed = [(start + math.copysign(i, shift)) % count for i in range(abs(shift) + 1)]
        segment = (start + shift) % count
        return segment, self.nearest(segment)[1], best[0], [int(k) for k in passed]

    def deviation(self, k: int, t: float) -> float:
        tx, ty = (self.linear(k, t, self.river.tangent[:, axis]) for axis in (0, 1))
        return abs(wrap_angle(self.yaw - math.atan2(self.travel * ty, self.travel * tx)))

    def collides(self, before: np.ndarray) -> bool:
        after = np.array([self.x, self.y, self.z])
        for planes in self.hulls:
            start, end = planes[:, :3] @ before - planes[:, 3], planes[:, :3] @ after - planes[:, 3]
            if np.any((start > 0) & (end > 0)):
                continue
            with np.errstate(divide="ignore", invalid="ignore"):
                crossing = start / (start - end)
            enters = np.max(np.where(start > 0, crossing, 0.0))
            leaves = np.min(np.where((start <= 0) & (end > 0), crossing, 1.0))
            if enters <= leaves:
                return True
        return False

    def ashore(self, k: int, t: float, distance: float) -> bool:
        if distance > self.linear(k, t, self.river.width_m) / 2 + TOLERANCE:
            return True
        for cx, cy, along, across, angle in self.world.islands:
            dx, dy = self.x - cx, self.y - cy
            u = (dx * math.cos(angle) + dy * math.sin(angle)) / along
            v = (dy * math.cos(angle) - dx * math.sin(angle)) / across
            if u * u + v * v <= 1:
                return True
        return False

    def step(self, action: np.ndarray) -> tuple[float, float, float, int]:
        """Return (reward, tight cost, loose cost, done reason) of an action [4] in 0..2."""
        config, (up, left, forward, leftward) = self.config, (1 - int(branch) for branch in action)
        before = np.array([self.x, self.y, self.z])
        self.z += up * config.vertical_step_m
        self.yaw = wrap_angle(self.yaw + left * math.radians(config.yaw_step_deg))
        ahead = (forward if config.allow_backward else max(forward, 0)) * config.forward_step_m
        aside = leftward * config.lateral_step_m
        self.x += ahead * math.cos(self.yaw) - aside * math.sin(self.yaw)
        self.y += ahead * math.sin(self.yaw) + aside * math.cos(self.yaw)

        self.segment, t, distance, passed = self.follow(self.segment)
        new = set(passed) - self.visited
        self.visited |= new
        self.steps += 1
        self.idle = 0 if new else self.idle + 1
        height = self.z - self.linear(self.segment, t, self.river.level_m)
        last = self.river.segments - 1 if self.travel > 0 else 0
        completed = len(self.visited) == self.river.segments if self.river.closed else self.segment == last
        checks = (
            self.collides(before),
            self.ashore(self.segment, t, distance),
            not config.min_height_m - TOLERANCE <= height <= config.max_height_m + TOLERANCE,
            self.deviation(self.segment, t) > math.radians(config.max_yaw_deviation_deg) + TOLERANCE,
            self.idle >= config.max_idle_steps,
            self.steps >= self.max_steps,
            completed,
        )
        reason = checks.index(True) if True in checks else -1
        paper = config.reward_scheme == "paper"
        reward = 10 * len(new) / self.river.segments if paper else float(bool(new))
        loose = 0.2 if paper else 0.5
        return reward, float(reason in (0, 1, 2)), loose * (reason in (3, 4, 5)), reason
