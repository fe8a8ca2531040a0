"""Stored sequences of flights: poses, times and what the teacher knows, but no frames; they are drawn when needed.

Letters: L steps of a sequence, C sequences, M moves, P numbers of the privileged state, G cells of a map.
"""

from typing import Any, NamedTuple

import numpy as np


class Sequences(NamedTuple):
    """C sequences of L steps."""

    river: np.ndarray
    """[L, C] int64, index of the river in the list of rivers."""
    pose: np.ndarray
    """[L, C, 4] float64: x, y and z in metres, yaw in radians."""
    time_s: np.ndarray
    """[L, C] float64, clock of the water in seconds."""
    segment: np.ndarray
    """[L, C] int64, of the course; see `thalweg.env.task.rules.State`."""
    travel: np.ndarray
    """[L, C] int64, 1 or -1, the direction of travel along the course."""
    last: np.ndarray
    """[L, C, A] int8, the options taken before, -1 at the beginning of an episode."""
    fresh: np.ndarray
    """[L, C] bool, whether the step begins an episode."""
    start: np.ndarray
    """[C, H] float32, the student's recurrent state before the first step, when it was flown."""
    worths: np.ndarray
    """[L, C, M] float32, worth of each move in segments of the course."""
    privileged: np.ndarray
    """[L, C, P] float32, in metres and radians; see `thalweg.env.task.ideal_eye.FEATURES`."""
    maps: np.ndarray
    """[L, C, G / 8] uint8, packed bits."""


COLUMN = {name: 0 if name == "start" else 1 for name in Sequences._fields}
"""Axis of the sequences in each array."""


class SequenceStore:
    """The latest sequences, up to a number of steps; older ones are overwritten."""

    def __init__(self, capacity: int, length: int) -> None:
        """Hold up to `capacity` steps in sequences of `length`."""
        self.most = max(capacity // length, 1)
        """Greatest number of sequences."""
        self._held: Sequences | None = None
        self._next = 0
        self.count = 0
        """Number of sequences."""

    def add(self, new: Sequences) -> None:
        """Add sequences."""
        if self._held is None:
            self._held = Sequences(*(_room(array, COLUMN[name], self.most) for name, array in new._asdict().items()))
        added = new.start.shape[0]
        places = (self._next + np.arange(added)) % self.most
        for name, held, array in zip(Sequences._fields, self._held, new, strict=True):
            if COLUMN[name]:
                held[:, places] = array
            else:
                held[places] = array
        self._next = int((self._next + added) % self.most)
        self.count = min(self.count + added, self.most)

    def take(self, columns: np.ndarray) -> Sequences:
        """Return copies of the sequences with these indices [C]."""
        assert self._held is not None
        return Sequences(
            *(array[:, columns] if COLUMN[name] else array[columns] for name, array in self._held._asdict().items())
        )

    def state(self) -> dict[str, Any]:
        """Return what `load_state` needs: the sequences that are held."""
        if self._held is None:
            return {"count": 0, "next": 0}
        return {"count": self.count, "next": self._next, **self.take(np.arange(self.count))._asdict()}

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        self._held, self._next, self.count = None, 0, 0
        if state["count"]:
            self.add(Sequences(*(np.array(state[name]) for name in Sequences._fields)))
        self._next, self.count = int(state["next"]), int(state["count"])


def _room(array: np.ndarray, axis: int, most: int) -> np.ndarray:
    """Return zeros of an array's shape and type, with `most` along an axis."""
    shape = list(array.shape)
    shape[axis] = most
    return np.zeros(shape, array.dtype)
