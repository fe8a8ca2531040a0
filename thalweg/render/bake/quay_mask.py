"""The mask of quays: where the ground is that of one, which slope and height do not tell from other steep banks."""

import numpy as np

from thalweg.render.records.layout import QUAY_LEVEL
from thalweg.world.generate.banks.zones import shares_on
from thalweg.world.record import World

FULL_SHARE = 1 / 3
"""Least share of the kind at which all of the ground is that of a quay: its stone ends where its wall does."""


def quay_share(world: World) -> np.ndarray:
    """Return how far each node of a world with quays is ground of one, [GY, GX] float32 from 0 to 1."""
    shape = world.ground_m.shape
    shares = shares_on(world.grid, shape, world.river, world.banks)
    # Later reaches may cover a quay altogether.
    share = shares.get("quay", np.zeros(shape, np.float32))
    return np.minimum(share / np.float32(FULL_SHARE), np.float32(1))


def quay_mask(world: World, shape: tuple[int, int]) -> np.ndarray:
    """Return the mask [Y, X] uint32 on the `QUAY_LEVEL` of the paint, of this shape: colours whose red is the share."""
    share, side = quay_share(world), 1 << QUAY_LEVEL
    padded = np.pad(share, [(0, side * many - there) for many, there in zip(shape, share.shape, strict=True)], "edge")
    means = padded.reshape(shape[0], side, shape[1], side).mean(axis=(1, 3))
    return np.rint(255 * means).astype(np.uint32)
