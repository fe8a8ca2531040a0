"""What shape has a river of this level? A closed line from random bends that is made to close on itself.

A course is a sequence of bends and reaches between them. Each bend turns the heading by its angle θᵢ as a smoothstep
of arc length, so that its curvature is a parabola with a known peak; small wiggles are added all along. Random angles
don't close, so the angles and places of the bends are moved as little as possible until the line does (three
constraints: total turning 2π, and the end on the start, as Langbein and Leopold, 1966, describe a meander by its
heading along the arc). Shapes that don't serve are rejected and drawn anew.
"""

from dataclasses import dataclass

import numpy as np

from thalweg.world import geometry
from thalweg.world.levels import Level

LEAST_RADIUS_M = 8.5
"""Radius at the tightest place of a designed bend; wiggles may tighten it a little further."""
LEAST_REACH_M = 5.0
"""Nearly straight water between two designed bends."""
LEAST_BEND = np.radians(38.0)
"""A designed bend turns at least so far, so that the counter sees it."""
WIGGLE_WAVES_M = (18.0, 55.0)
"""Wave lengths of the wiggles."""
STEPS = 1024
"""Steps of the integration along the line."""


@dataclass(frozen=True)
class Bends:
    """A course before it is closed: one entry per bend, in order along the line."""

    angle: np.ndarray
    """[n] float64 radians, positive to the left."""
    centre: np.ndarray
    """[n] float64, the place of the bend's middle as a share of the loop."""
    extent: np.ndarray
    """[n] float64, its length as a share of the loop."""
    wiggle: np.ndarray
    """[STEPS] float64 radians, small heading changes along the line."""


def draw_angles(level: Level, rng: np.random.Generator) -> np.ndarray:
    """Signed angles [n] in radians that sum to 2π: the bends to the right stand singly among those to the left."""
    count = int(rng.integers(level.bends[0], min(level.bends[1], level.bends[0] + 2) + 1))
    if count <= 3:
        rights = int(rng.integers(0, 2))
    else:
        rights = int(rng.integers(max(1, round(0.25 * count)), max(1, round(0.38 * count)) + 1))
    right = rng.uniform(np.radians(50), np.radians(80 if count <= 3 else 135), rights)
    lefts = count - rights
    share = rng.dirichlet(np.full(lefts, 6.0))
    spare = 2 * np.pi + right.sum() - lefts * LEAST_BEND
    left = LEAST_BEND + spare * share
    slots = rng.permutation(lefts)[:rights]
    angles: list[float] = []
    for i in range(lefts):
        angles.append(left[i])
        if i in slots:
            angles.append(-right[list(slots).index(i)])
    return np.roll(np.array(angles), int(rng.integers(count)))


def draw_bends(level: Level, rng: np.random.Generator) -> Bends | None:
    """A random course that does not close yet; None if its bends don't fit in the length."""
    angle = draw_angles(level, rng)
    roomy = 2.2 if len(angle) <= 3 else 1.0
    radius = LEAST_RADIUS_M + rng.gamma(1.6, 2.0 * roomy, len(angle)) + 6.0 * (roomy - 1.0)
    extent = 1.5 * np.abs(angle) * radius / level.length_m
    free = 1.0 - extent.sum() - len(angle) * LEAST_REACH_M / level.length_m
    if free < 0.02:
        return None
    reach = LEAST_REACH_M / level.length_m + free * rng.dirichlet(np.full(len(angle), 1.5))
    centre = np.cumsum(extent + reach) - 0.5 * extent
    return Bends(angle, centre, extent, draw_wiggle(level, rng))


def draw_wiggle(level: Level, rng: np.random.Generator) -> np.ndarray:
    """[STEPS] radians: a few periodic waves whose strength itself changes along the line."""
    s = 2 * np.pi * (np.arange(STEPS) + 0.5) / STEPS
    short, long = level.length_m / WIGGLE_WAVES_M[0], level.length_m / WIGGLE_WAVES_M[1]
    heading = np.zeros(STEPS)
    for wave in np.unique(rng.integers(int(long), int(short) + 1, 6)):
        amplitude = rng.uniform(0.015, 0.045) * np.sqrt(2 * long / wave)
        heading += amplitude * np.sin(wave * s + rng.uniform(0, 2 * np.pi))
    strength = 1 + 0.6 * np.sin(s * rng.integers(1, 3) + rng.uniform(0, 2 * np.pi))
    return heading * strength


def headings(bends: Bends) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Heading [STEPS], and per bend [n, STEPS] the share of its angle turned so far and that share's slope."""
    s = (np.arange(STEPS) + 0.5) / STEPS
    start = bends.centre - 0.5 * bends.extent
    t = np.clip((s[None, :] - start[:, None]) / bends.extent[:, None], 0.0, 1.0)
    turned = t * t * (3 - 2 * t)
    slope = 6 * t * (1 - t) / bends.extent[:, None]
    return bends.angle @ turned + bends.wiggle, turned, slope


def close(bends: Bends) -> Bends | None:
    """The same bends, moved and turned as little as possible so that the line ends where and as it began.

    Newton's method with steps of least norm on the angles and places; None if that does not settle, or only with
    bends that overlap or turn too little.
    """
    weight = np.concatenate([np.full(len(bends.angle), 0.5), np.full(len(bends.angle), 0.05)])
    for _ in range(12):
        heading, turned, slope = headings(bends)
        cos, sin = np.cos(heading), np.sin(heading)
        miss = np.array([cos.mean(), sin.mean(), bends.angle.sum() - 2 * np.pi])
        if np.abs(miss).max() < 1e-6:
            break
        by_angle = np.stack([-(turned * sin).mean(1), (turned * cos).mean(1), np.ones(len(bends.angle))])
        shift = -bends.angle[:, None] * slope
        by_place = np.stack([-(shift * sin).mean(1), (shift * cos).mean(1), np.zeros(len(bends.angle))])
        jacobian = np.concatenate([by_angle, by_place], axis=1) * weight
        square = jacobian @ jacobian.T + 1e-9 * np.eye(3)
        step = -weight * (jacobian.T @ np.linalg.solve(square, miss))
        step *= min(1.0, 0.5 / np.abs(step / weight).max())
        n = len(bends.angle)
        bends = Bends(bends.angle + step[:n], bends.centre + step[n:], bends.extent, bends.wiggle)
    else:
        return None
    start, end = bends.centre - 0.5 * bends.extent, bends.centre + 0.5 * bends.extent
    if np.any(start[1:] < end[:-1]) or start[0] < 0 or end[-1] > 1 or np.any(np.abs(bends.angle) < LEAST_BEND):
        return None
    return bends


def line_of(bends: Bends, length_m: float, samples: int) -> np.ndarray:
    """[samples, 2] metres: the closed line with that heading, evenly sampled and centred on its bounding box."""
    heading = headings(bends)[0]
    step = np.stack([np.cos(heading), np.sin(heading)], axis=1) * (length_m / STEPS)
    step -= step.mean(axis=0)
    fine = np.concatenate([np.zeros((1, 2)), np.cumsum(step, axis=0)])
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*step.T))])
    at = np.arange(samples) / samples * arc[-1]
    line = np.stack([np.interp(at, arc, fine[:, 0]), np.interp(at, arc, fine[:, 1])], axis=1)
    return line - 0.5 * (line.min(axis=0) + line.max(axis=0))


def draw_line(level: Level, rng: np.random.Generator) -> np.ndarray | None:
    """A closed line [samples, 2] in metres with the level's number of bends; None if this draw gave none.

    The line may start anywhere along the course, head anywhere, and run either way round.
    """
    drawn = draw_bends(level, rng)
    bends = close(drawn) if drawn is not None else None
    if bends is None:
        return None
    line = line_of(bends, level.length_m * rng.uniform(0.99, 1.004), level.samples)
    if not level.bends[0] <= geometry.bend_count(line, True) <= level.bends[1]:
        return None
    turn = rng.uniform(0, 2 * np.pi)
    line = line @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    if rng.random() < 0.5:
        line = line[::-1]
    line = np.roll(line, int(rng.integers(level.samples)), axis=0)
    return line - 0.5 * (line.min(axis=0) + line.max(axis=0))
