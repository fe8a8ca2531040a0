"""Assignment of rivers to environments: the same one always, or another one in each episode."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from thalweg.env.config import EnvConfig
from thalweg.env.rivers.pool import RiverPool
from thalweg.env.snapshot import fingerprints, impossible
from thalweg.env.task.course_arrays import CourseArrays, pack_courses
from thalweg.world.record import World

UNDRAWN = -1
"""Next river of an environment for which none was drawn yet."""


class FixedRivers:
    """Environment i flies in world i % len(worlds) in all episodes."""

    def __init__(self, worlds: Sequence[World], num_envs: int, config: EnvConfig) -> None:
        self.courses = pack_courses(worlds, config)
        self.slot = np.arange(num_envs, dtype=np.int64) % len(worlds)
        """[N] index of the river of each environment in the courses; the array of `State.world`."""
        self.most_segments = int(self.courses.segments.max())
        self._worlds = worlds

    def enter(self, row: int, generator: np.random.Generator) -> None:
        """Do nothing: an episode is flown in the same river as the last one."""

    def name(self, row: int) -> str:
        """Return the name and seed of the river of environment `row`, such as Medium-1000."""
        return self._worlds[self.slot[row]].label

    def forget(self, row: int) -> None:
        """Do nothing: no river was drawn."""

    def settle(self) -> None:
        """Do nothing: no river was left."""

    def fingerprint(self) -> np.ndarray:
        """Return a hash [W] uint64 of each world."""
        return fingerprints(self._worlds)

    def state(self) -> dict[str, np.ndarray]:
        """Return what distinguishes the rivers of the environments, as `get_state` has it."""
        return {"world": self.slot.copy()}

    def segments_in(self, state: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the segments [N] of each environment's river in a state."""
        return self.courses.segments[self.slot]

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Do nothing: a state that fits has the same rivers."""

    def close(self) -> None:
        """Do nothing: nothing runs in the background."""

    def in_use(self) -> tuple[list[CourseArrays], np.ndarray]:
        """Return the courses of all rivers, together, and the index [N] of each environment's among them."""
        return [self.courses], self.slot


class DrawnRivers:
    """Each episode is flown in a river that the environment's own generator draws, one episode ahead.

    So which river it is does not depend on when it was ready, and a river has an episode's time to get ready.
    """

    def __init__(self, pool: RiverPool, num_envs: int) -> None:
        self.pool, self.courses = pool, pool.courses
        self.most_segments = pool.rivers.most_segments
        self.slot = np.zeros(num_envs, dtype=np.int64)
        """[N] index of the river of each environment in the courses; the array of `State.world`."""
        self.river = np.zeros(num_envs, dtype=np.int64)
        """[N] index of the river of each environment in the list."""
        self.next_river = np.full(num_envs, UNDRAWN, dtype=np.int64)
        """[N] index of the river of the next episode, or `UNDRAWN`."""
        self._left: list[int] = []
        """Slots that were left, whose rivers are still needed for the last views of their episodes."""
        for row in range(num_envs):
            self.slot[row] = pool.take(0)

    def enter(self, row: int, generator: np.random.Generator) -> None:
        """Move environment `row` to the river of its next episode, and draw the one after that."""
        count = len(self.pool.rivers)
        drawn = self.next_river[row]
        river = int(generator.integers(count)) if drawn == UNDRAWN else int(drawn)
        slot = self.pool.take(river)  # which may raise an error: until then everything stays as it is
        self._left.append(int(self.slot[row]))
        self.slot[row], self.river[row] = slot, river
        self.next_river[row] = generator.integers(count)
        self.courses = self.pool.courses

    def name(self, row: int) -> str:
        """Return the name and seed of the river of environment `row`, such as Medium-1000."""
        return self.pool.rivers.name(int(self.river[row]))

    def forget(self, row: int) -> None:
        """Forget the river of the next episode, whose generator is replaced."""
        self.next_river[row] = UNDRAWN

    def settle(self) -> None:
        """Give back the rivers that were left since the last call, and prepare the next ones."""
        if self._left:
            while self._left:
                self.pool.leave(self._left.pop())
            self._expect(self.next_river)

    def fingerprint(self) -> np.ndarray:
        """Return a hash [1] uint64 of the list of rivers."""
        return self.pool.rivers.identity()

    def state(self) -> dict[str, np.ndarray]:
        """Return the river [N] of each environment and the next one [N], as `get_state` has them."""
        return {"river": self.river.copy(), "next_river": self.next_river.copy()}

    def segments_in(self, state: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the segments [N] of each environment's river in a state; raises `StateError` for rivers that are not
        in the list."""
        count = len(self.pool.rivers)
        for name, least in (("river", 0), ("next_river", UNDRAWN)):
            values = np.asarray(state[name])
            wrong = (values < least) | (values >= count)
            if wrong.any():
                row = int(np.argmax(wrong))
                raise impossible(name, values[row], f"{least}..{count - 1}", row)
        return np.array([self.pool.segments(int(river)) for river in np.asarray(state["river"])])

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Take the rivers of a checked state."""
        taken: list[int] = []
        try:
            for river in np.asarray(state["river"]):
                taken.append(self.pool.take(int(river)))
        except BaseException:
            for slot in taken:
                self.pool.leave(slot)
            raise
        self._left += self.slot.tolist()
        self.slot[:] = taken
        self.river[:], self.next_river[:] = state["river"], state["next_river"]
        self.courses = self.pool.courses
        self.settle()

    def close(self) -> None:
        """Stop preparing rivers."""
        self.pool.close()

    def in_use(self) -> tuple[list[CourseArrays], np.ndarray]:
        """Return the courses of the rivers that environments fly in now, each alone, and the index [N] of each
        environment's among them."""
        slots, index = np.unique(self.slot, return_inverse=True)
        return [self.pool.part(int(slot)) for slot in slots], index.astype(np.int64)

    def loaded(self, river: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Load rivers [M] of the list, as many at a time as there is room for.

        Yields rows of `river` and the slots of their rivers, which keep them until the next ones are yielded.
        """
        self.settle()  # gives back what a call left that ended with an error
        chosen, index = np.unique(river, return_inverse=True)
        index = index.reshape(-1)
        holds_all = self.pool.slots >= len(self.pool.rivers)
        room = max(len(chosen), 1) if holds_all else self.pool.slots - len(np.unique(self.slot))
        for first in range(0, len(chosen), room):
            slots: list[int] = []
            try:
                for slot in self.pool.take_all(chosen[first : first + room].tolist()):
                    slots.append(slot)
                self.courses = self.pool.courses
                rows = np.flatnonzero((index >= first) & (index < first + room))
                yield rows, np.array(slots, np.int64)[index[rows] - first]
            finally:
                for slot in slots:
                    self.pool.leave(slot)
        self._expect(self.next_river)

    def _expect(self, rivers: Iterable[int]) -> None:
        """Prepare rivers in the background."""
        self.pool.expect(river for river in rivers if river != UNDRAWN)


Rivers = FixedRivers | DrawnRivers
