"""Corrupted masks: water where there is none, and land where there is water, as a segmentation makes of real video."""

import numpy as np

MOST_PATCHES = 6
"""Greatest number of rectangles of a corrupted mask."""
LARGEST_SHARE = 0.35
"""Greatest height and width of a rectangle, as a share of the image."""
DROPPED = 0.25
"""Share of the steps of a corrupted sequence whose masks show no water at all."""


def corrupt(images: np.ndarray, observation: str, share: float, rng: np.random.Generator) -> None:
    """Corrupt the masks of a share of sequences of images [L, C, H, W, K] uint8 in place.

    In these, a step has up to `MOST_PATCHES` rectangles of water or land that are not there, or no water at all. The
    mask is the last channel; `observation` rgb has none.
    """
    if observation == "rgb" or share <= 0.0:
        return
    length, count, height, width, _ = images.shape
    for column in np.flatnonzero(rng.random(count) < share):
        for step in range(length):
            mask = images[step, column, :, :, -1]
            if rng.random() < DROPPED:
                mask[:] = 0
                continue
            for _ in range(int(rng.integers(MOST_PATCHES + 1))):
                top, left = int(rng.integers(height)), int(rng.integers(width))
                bottom = top + 1 + int(rng.integers(int(LARGEST_SHARE * height)))
                right = left + 1 + int(rng.integers(int(LARGEST_SHARE * width)))
                mask[top:bottom, left:right] = 255 * int(rng.integers(2))
