"""A slow nearest-point search over all segments: the reference for maps and rivers."""

import numpy as np

from thalweg.world.geometry import edges


def nearest(line: np.ndarray, closed: bool, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The nearest place on the line for each of `points` [P, 2].

    Returns the segment [P] int, the place along it [P] in 0..1, and the lateral distance [P] in metres, positive to
    the left of the segment. The foot of the perpendicular is clamped to the segment's ends.
    """
    start = line if closed else line[:-1]
    step = edges(line, closed)
    to_point = points[:, None, :] - start[None, :, :]
    share = np.clip((to_point * step).sum(-1) / np.maximum((step * step).sum(-1), 1e-18), 0.0, 1.0)
    off = to_point - share[..., None] * step
    distance = np.hypot(off[..., 0], off[..., 1])
    segment = np.argmin(distance, axis=1)
    rows = np.arange(len(points))
    left = step[segment, 0] * to_point[rows, segment, 1] - step[segment, 1] * to_point[rows, segment, 0] >= 0
    return segment, share[rows, segment], np.where(left, 1.0, -1.0) * distance[rows, segment]


def along(values: np.ndarray, segment: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Values [S] given at the vertices, linearly between them at `share` of `segment`."""
    following = (segment + 1) % len(values)
    return values[segment] * (1 - share) + values[following] * share
