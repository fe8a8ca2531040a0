"""Lines whose length, bends and crossings are known by hand calculation."""

import numpy as np


def circle(radius_m: float, samples: int) -> np.ndarray:
    """[samples, 2] counter-clockwise round the origin."""
    t = 2 * np.pi * np.arange(samples) / samples
    return radius_m * np.stack([np.cos(t), np.sin(t)], axis=1)


def stadium(straight_m: float, radius_m: float, spacing_m: float = 1.0) -> np.ndarray:
    """[S, 2] closed, counter-clockwise: two straights joined by half circles."""
    ahead = np.arange(0, straight_m, spacing_m)
    turn = np.arange(0, np.pi, spacing_m / radius_m)
    lower = np.stack([ahead, np.full_like(ahead, -radius_m)], axis=1)
    right = np.stack([straight_m + radius_m * np.sin(turn), -radius_m * np.cos(turn)], axis=1)
    return np.concatenate([lower, right, np.array([straight_m, 0.0]) - lower, np.array([straight_m, 0.0]) - right])


def figure_eight(size_m: float, samples: int) -> np.ndarray:
    """[samples, 2] closed: (sin t, sin 2t / 2), which crosses itself once, at the origin."""
    t = 2 * np.pi * (np.arange(samples) + 0.5) / samples
    return size_m * np.stack([np.sin(t), np.sin(2 * t) / 2], axis=1)


def course(line: np.ndarray, width_m: float = 6.0, level_m: float = 0.0) -> np.ndarray:
    """[K, 4] points for `World.from_centerline` of even width and level."""
    return np.concatenate([line, np.full((len(line), 1), level_m), np.full((len(line), 1), width_m)], axis=1)
