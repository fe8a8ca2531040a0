"""Small detail: one tile of water ripples and ground grain, with mip levels.

A tile holds four channels: the two slopes of the water's ripples, the share of their mean square slope that filtering
has removed (which makes far water rougher instead of flatter), and a grain that breaks up the ground near the camera.
Slopes are filtered together with their squares: Olano, Baker: LEAN Mapping, I3D 2010.
"""

from functools import cache

import numpy as np

SIZE = 256
LEVELS = 8
SLOPE_RANGE = 0.5
"""Slopes are stored from minus to plus this."""
VARIANCE_RANGE = 0.04
GRAIN_SPREAD = 0.18
"""Standard deviation of the grain on the finest level."""


def _spectrum_noise(rng: np.random.Generator, low: float, high: float, power: float, wind: float) -> np.ndarray:
    """Return a periodic random field [SIZE, SIZE] of unit variance between two frequencies.

    Its amplitude falls as frequency**-power. `wind` in 0..1 stretches its crests along the second axis.
    """
    frequency = np.fft.fftfreq(SIZE) * SIZE
    fy, fx = np.meshgrid(frequency, frequency, indexing="ij")
    radius = np.hypot(fx, fy)
    band = (radius >= low) & (radius <= high)
    amplitude = np.where(band, np.maximum(radius, 1.0) ** -power, 0.0)
    amplitude *= (1 - wind) + wind * (np.abs(fy) / np.maximum(radius, 1.0)) ** 2
    field = np.fft.ifft2(np.fft.fft2(rng.standard_normal((SIZE, SIZE))) * amplitude).real
    return (field - field.mean()) / field.std()


def tile(seed: int = 0) -> list[np.ndarray]:
    """Return the levels [SIZE >> k, SIZE >> k, 4] float64: slope x, slope y, lost variance, grain (0..1)."""
    rng = np.random.default_rng(np.random.SeedSequence([0x717, seed]))
    height = _spectrum_noise(rng, 3, 90, 2.2, 0.55)
    slope_x = np.roll(height, -1, 1) - np.roll(height, 1, 1)
    slope_y = np.roll(height, -1, 0) - np.roll(height, 1, 0)
    scale = 0.085 / np.sqrt((slope_x**2 + slope_y**2).mean() / 2)
    slope_x, slope_y = slope_x * scale, slope_y * scale
    grain = _spectrum_noise(rng, 2, 128, 1.0, 0.0)
    grain = np.clip(0.5 + GRAIN_SPREAD * grain, 0.0, 1.0)

    levels = []
    square = slope_x**2 + slope_y**2
    for _ in range(LEVELS):
        lost = np.maximum(square - slope_x**2 - slope_y**2, 0.0)
        levels.append(np.stack([slope_x, slope_y, lost, grain], axis=-1))
        slope_x, slope_y, square, grain = (_halve(a) for a in (slope_x, slope_y, square, grain))
    return levels


def _halve(a: np.ndarray) -> np.ndarray:
    return a.reshape(a.shape[0] // 2, 2, a.shape[1] // 2, 2).mean(axis=(1, 3))


@cache
def packed_tile() -> np.ndarray:
    """Return all levels of `tile()` as one flat uint32 array, as `packed` does; read-only."""
    found = packed(tile())
    found.setflags(write=False)
    return found


def packed(levels: list[np.ndarray]) -> np.ndarray:
    """Return all levels as one flat uint32 array, eight bits per channel."""
    flat = []
    for level in levels:
        coded = np.stack(
            [
                level[..., 0] / SLOPE_RANGE * 127.5 + 127.5,
                level[..., 1] / SLOPE_RANGE * 127.5 + 127.5,
                level[..., 2] / VARIANCE_RANGE * 255,
                level[..., 3] * 255,
            ],
            axis=-1,
        )
        flat.append(np.clip(np.rint(coded), 0, 255).astype(np.uint8).reshape(-1, 4).view(np.uint32).ravel())
    return np.concatenate(flat)
