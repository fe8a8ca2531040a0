"""Synthetic frames that resemble a river, drawn without world or renderer: a winding strip of water, sand and woods.

Each depends on eight random numbers (height, heading, lateral offset, bends, width, tree line, light), about as many
as a real view of the river, so that a code of 16 numbers can represent it.
"""

import numpy as np

SKY, WOOD, GRASS, SAND, WATER = np.array(
    [[0.75, 0.82, 0.86], [0.22, 0.29, 0.16], [0.42, 0.44, 0.24], [0.80, 0.74, 0.60], [0.25, 0.38, 0.50]], np.float32
)


def synthetic_frames(count: int, size_px: int, seed: int = 0) -> np.ndarray:
    """Frames uint8 [count, size_px, size_px, 4], colour and water mask, from a camera that looks 20 degrees down."""
    random = np.random.default_rng(seed)
    return np.stack([_frame(random, size_px) for _ in range(count)])


def _frame(random: np.random.Generator, size_px: int) -> np.ndarray:
    height_m, heading, across_m = random.uniform(0.5, 15), random.uniform(-1.2, 1.2), random.uniform(-3, 3)
    bend_m, wave, phase = random.uniform(0, 12), random.uniform(0.02, 0.06), random.uniform(0, 2 * np.pi)
    half_m, tree_m, light = random.uniform(2, 8), random.uniform(8, 14), random.uniform(0.85, 1.1)
    axis = (np.arange(size_px, dtype=np.float32) + 0.5) / size_px * 2 - 1
    right, down = np.meshgrid(axis * np.tan(np.pi / 6), axis * np.tan(np.pi / 6))
    pitch = np.radians(20)
    forward, fall = np.cos(pitch) - down * np.sin(pitch), np.sin(pitch) + down * np.cos(pitch)
    along, side = (
        forward * np.cos(heading) + right * np.sin(heading),
        right * np.cos(heading) - forward * np.sin(heading),
    )
    distance = height_m / np.maximum(fall, 1e-3)
    x, y = along * distance, side * distance + across_m
    offset = np.abs(y - bend_m * (np.sin(wave * x + phase) - np.sin(phase))) - half_m
    water = (offset < 0) & (fall > 0.002)
    ripples = 0.04 * np.sin(x * 2 + 3 * np.sin(y)) / (1 + distance / 10)
    colour = np.where((offset < 2)[..., None], SAND, GRASS)
    colour = np.where(water[..., None], WATER + ripples[..., None], colour)
    # Trees stand 6 m behind the bank: a ray that passes there below their tops sees wood.
    behind = np.clip((half_m + 6 + bend_m * 0.3) / np.maximum(np.abs(side), 1e-3), 0, 200)
    wood = (height_m - fall * behind > 0) & (height_m - fall * behind < tree_m + np.sin(9 * right + phase)) & ~water
    wood &= offset > 6
    colour = np.where(wood[..., None], WOOD, colour)
    colour = np.where((fall <= 0.002)[..., None] & ~wood[..., None], SKY, colour)
    noise = random.normal(0, 0.02, (size_px, size_px, 1))
    rgb = np.clip((colour * light + noise) * 255, 0, 255).astype(np.uint8)
    return np.concatenate([rgb, (water * np.uint8(255))[..., None]], axis=-1)
