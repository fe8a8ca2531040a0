"""Random closed centre lines with a given number of bends.

A course is a sequence of bends and reaches between them. Each bend turns the heading by its angle θᵢ as a smoothstep of
arc length, so that its curvature is a parabola with a known peak; small wiggles are added everywhere. Random angles do
not close the line, so the angles and positions of the bends are moved as little as possible until it closes. There are
three constraints: a total turning of 2π, and equal x and y at start and end. (Langbein and Leopold, 1966, also describe
a meander by its heading along the arc.) Shapes that violate a limit are rejected and drawn again.
"""

from dataclasses import dataclass

import numpy as np

from thalweg.world import geometry
from thalweg.world.levels import Level

MIN_RADIUS_M = 8.5
"""Minimum radius of a bend without its wiggles, which may tighten it a little further."""
MIN_REACH_M = 5.0
"""Minimum length of nearly straight water between two bends."""
MIN_BEND = np.radians(38.0)
"""Minimum angle of a bend, so that `geometry.bend_count` counts it."""
WIGGLE_WAVES_M = (18.0, 55.0)
"""Minimum and maximum wavelength of the wiggles."""
STEPS = 1024
"""Steps of the integration along the line."""


@dataclass(frozen=True)
class Bends:
    """A course before it is closed: one entry per bend, in order along the line."""

    angle: np.ndarray
    """[n] float64 radians, positive to the left."""
    centre: np.ndarray
    """[n] float64, position of the bend's middle as a share of the loop."""
    extent: np.ndarray
    """[n] float64, length of the bend as a share of the loop."""
    wiggle: np.ndarray
    """[STEPS] float64 radians, small heading changes along the line."""


def draw_angles(level: Level, rng: np.random.Generator) -> np.ndarray:
    """Return random signed angles [n] in radians that sum to 2π; no two bends to the right are neighbours."""
    count = int(rng.integers(level.bends[0], min(level.bends[1], level.bends[0] + 2) + 1))
    if count <= 3:
        rights = int(rng.integers(0, 2))
    else:
        rights = int(rng.integers(max(1, round(0.25 * count)), max(1, round(0.38 * count)) + 1))
    right = rng.uniform(np.radians(50), np.radians(80 if count <= 3 else 135), rights)
    lefts = count - rights
    share = rng.dirichlet(np.full(lefts, 6.0))
    spare = 2 * np.pi + right.sum() - lefts * MIN_BEND
    left_bends = MIN_BEND + spare * share
    # Each bend to the right follows a different bend to the left, so that no two are neighbours.
    slots = rng.permutation(lefts)[:rights]
    angles: list[float] = []
    for i in range(lefts):
        angles.append(left_bends[i])
        if i in slots:
            angles.append(-right[list(slots).index(i)])
    return np.roll(np.array(angles), int(rng.integers(count)))


def draw_bends(level: Level, rng: np.random.Generator) -> Bends | None:
    """Return a random course that is not closed yet, or None if its bends do not fit in the length."""
    angle = draw_angles(level, rng)
    roomy = 2.2 if len(angle) <= 3 else 1.0
    radius = MIN_RADIUS_M + rng.gamma(1.6, 2.0 * roomy, len(angle)) + 6.0 * (roomy - 1.0)
    extent = 1.5 * np.abs(angle) * radius / level.length_m
    free = 1.0 - extent.sum() - len(angle) * MIN_REACH_M / level.length_m
    if free < 0.02:
        return None
    reach = MIN_REACH_M / level.length_m + free * rng.dirichlet(np.full(len(angle), 1.5))
    centre = np.cumsum(extent + reach) - 0.5 * extent
    return Bends(angle, centre, extent, draw_wiggle(level, rng))


def draw_wiggle(level: Level, rng: np.random.Generator) -> np.ndarray:
    """Return [STEPS] radians: a few periodic waves whose amplitude varies along the line."""
    s = 2 * np.pi * (np.arange(STEPS) + 0.5) / STEPS
    short, long = level.length_m / WIGGLE_WAVES_M[0], level.length_m / WIGGLE_WAVES_M[1]
    heading = np.zeros(STEPS)
    for wave in np.unique(rng.integers(int(long), int(short) + 1, 6)):
        amplitude = rng.uniform(0.015, 0.045) * np.sqrt(2 * long / wave)
        heading += amplitude * np.sin(wave * s + rng.uniform(0, 2 * np.pi))
    strength = 1 + 0.6 * np.sin(s * rng.integers(1, 3) + rng.uniform(0, 2 * np.pi))
    return heading * strength


def headings(bends: Bends) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the heading [STEPS], and per bend the share of its angle turned so far and its slope, [n, STEPS]."""
    s = (np.arange(STEPS) + 0.5) / STEPS
    start = bends.centre - 0.5 * bends.extent
    t = np.clip((s[None, :] - start[:, None]) / bends.extent[:, None], 0.0, 1.0)
    turned = t * t * (3 - 2 * t)
    slope = 6 * t * (1 - t) / bends.extent[:, None]
    return bends.angle @ turned + bends.wiggle, turned, slope


def close(bends: Bends) -> Bends | None:
    """Return the bends moved and turned as little as possible so that the line closes.

    Newton's method with minimum-norm steps on the angles and positions. Returns None if it does not converge, or if
    bends overlap or turn too little afterwards.
    """
    # Angles may change ten times as much as positions.
    weight = np.concatenate([np.full(len(bends.angle), 0.5), np.full(len(bends.angle), 0.05)])
    for _ in range(12):
        heading, turned, slope = headings(bends)
        cos, sin = np.cos(heading), np.sin(heading)
        miss = np.array([cos.mean(), sin.mean(), bends.angle.sum() - 2 * np.pi])
        if np.abs(miss).max() < 1e-6:
            break
        by_angle = np.stack([-(turned * sin).mean(1), (turned * cos).mean(1), np.ones(len(bends.angle))])
        shift = -bends.angle[:, None] * slope
        by_position = np.stack([-(shift * sin).mean(1), (shift * cos).mean(1), np.zeros(len(bends.angle))])
        jacobian = np.concatenate([by_angle, by_position], axis=1) * weight
        # The small diagonal keeps the normal equations solvable when the constraints are nearly dependent.
        square = jacobian @ jacobian.T + 1e-9 * np.eye(3)
        step = -weight * (jacobian.T @ np.linalg.solve(square, miss))
        step *= min(1.0, 0.5 / np.abs(step / weight).max())
        n = len(bends.angle)
        bends = Bends(bends.angle + step[:n], bends.centre + step[n:], bends.extent, bends.wiggle)
    else:
        return None
    start, end = bends.centre - 0.5 * bends.extent, bends.centre + 0.5 * bends.extent
    if np.any(start[1:] < end[:-1]) or start[0] < 0 or end[-1] > 1 or np.any(np.abs(bends.angle) < MIN_BEND):
        return None
    return bends


def line_of(bends: Bends, length_m: float, samples: int) -> np.ndarray:
    """Return [samples, 2] the closed line of the bends in metres, evenly sampled and centred on its bounding box."""
    heading = headings(bends)[0]
    step = np.stack([np.cos(heading), np.sin(heading)], axis=1) * (length_m / STEPS)
    step -= step.mean(axis=0)  # removes what is left of the gap after Newton's method
    fine = np.concatenate([np.zeros((1, 2)), np.cumsum(step, axis=0)])
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*step.T))])
    at = np.arange(samples) / samples * arc[-1]
    line = np.stack([np.interp(at, arc, fine[:, 0]), np.interp(at, arc, fine[:, 1])], axis=1)
    return line - 0.5 * (line.min(axis=0) + line.max(axis=0))


def draw_line(level: Level, rng: np.random.Generator) -> np.ndarray | None:
    """Return a random closed line [samples, 2] in metres with the level's number of bends, or None if the draw failed.

    The start, the orientation and the direction of the line are random.
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
