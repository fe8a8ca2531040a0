"""Worths that the teachers of an imitation, pilots that know the map, give to all moves."""

import numpy as np

from thalweg.algos.imitation.config import Teacher
from thalweg.env import RiverVectorEnv
from thalweg.env.moves import MOVE_OPTIONS

OTHER_MOVE = -1.0
"""Worth of each move that a teacher did not choose, where only its choice is known; the chosen one has the worth 0."""


def teacher_worths(env: RiverVectorEnv, teacher: Teacher) -> np.ndarray:
    """Return the worths [N, M] float64 of all moves in the current state, in segments of the course; of a
    teacher of which only the choice is known, those of `choice_worths`."""
    return env.move_worths() if teacher == "steady" else choice_worths(env.pilot_actions(teacher))


def choice_worths(actions: np.ndarray) -> np.ndarray:
    """Return worths [N, M] float64 by which the moves with the options [N, 4] are best, and all others equally bad.

    Raises `ValueError` for options that are those of no move.
    """
    chosen = (MOVE_OPTIONS[None] == actions[:, None]).all(-1)
    if not chosen.any(axis=1).all():
        raise ValueError(f"{actions[~chosen.any(axis=1)][0].tolist()} are the options of no move")
    return np.where(chosen, 0.0, OTHER_MOVE)
