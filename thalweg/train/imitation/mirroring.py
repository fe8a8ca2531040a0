"""Sequences as in a mirror: rivers that bend, and flights that turn, to the other side.

The memory of a flight has no mirror image, so that a mirrored sequence begins as an episode does, without any. Letters:
L steps of a sequence, C sequences, M moves.
"""

import numpy as np

from thalweg.algos.policy.vision import NO_OPTION
from thalweg.env.moves import MOVE_OPTIONS, MOVES
from thalweg.env.task.bird_eye import COLUMNS, ROWS
from thalweg.env.task.ideal_eye import mirrored
from thalweg.train.flip import flipped
from thalweg.train.imitation.sequences import Sequences

SIDEWAYS = [1, 3]
"""Branches of an action that have sides: turns, and steps aside."""
SIGNS = np.where(np.isin(np.arange(MOVES.shape[1]), SIDEWAYS), -1, 1)
ORDER = (MOVES[:, None] == (MOVES * SIGNS)[None]).all(-1).argmax(axis=0)
"""[M] the move that each one is in a mirror."""
GREATEST_OPTION = MOVE_OPTIONS.max()
"""Greatest option of a branch; in a mirror, option k becomes `GREATEST_OPTION` - k."""


def mirror(images: np.ndarray, sequences: Sequences, share: float, rng: np.random.Generator) -> None:
    """Mirror a share of the sequences, and their images [L, C, H, W, K], in place."""
    chosen = np.flatnonzero(rng.random(images.shape[1]) < share)
    if chosen.size:
        images[:, chosen] = flipped(images[:, chosen])
        mirror_numbers(sequences, chosen)


def mirror_numbers(sequences: Sequences, chosen: np.ndarray) -> None:
    """Mirror all but the images of the sequences `chosen`, in place."""
    length, count = len(sequences.last), len(chosen)
    last = sequences.last[:, chosen]
    last[..., SIDEWAYS] = np.where(last[..., SIDEWAYS] >= 0, GREATEST_OPTION - last[..., SIDEWAYS], NO_OPTION)
    last[0] = NO_OPTION
    sequences.last[:, chosen] = last
    sequences.fresh[0, chosen] = True
    sequences.start[chosen] = 0.0
    sequences.worths[:, chosen] = sequences.worths[:, chosen][..., ORDER]
    sequences.privileged[:, chosen] = mirrored(sequences.privileged[:, chosen])
    maps = np.unpackbits(sequences.maps[:, chosen], axis=-1).reshape(length, count, ROWS, COLUMNS)
    sequences.maps[:, chosen] = np.packbits(maps[..., ::-1].reshape(length, count, -1), axis=-1)
