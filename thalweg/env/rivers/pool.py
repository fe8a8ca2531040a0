"""`RiverPool`: the rivers of a list that are in memory, of which the next ones are prepared in the background.

Which rivers are in memory, and when they arrive, changes the time that a step takes and nothing else.
"""

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple, Protocol
from weakref import WeakMethod, finalize

from thalweg.core.compute.threads import get_num_threads
from thalweg.env.config import EnvConfig
from thalweg.env.rivers.build_ahead import BackgroundBuilder
from thalweg.env.rivers.courses import join_courses
from thalweg.env.rivers.memory import slots_in_memory
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.rivers.worker import Worker
from thalweg.env.task.course_arrays import CourseArrays, pack_courses
from thalweg.world.generate.memory import free_bytes
from thalweg.world.record import World


class Prepared(NamedTuple):
    """What is kept of a river."""

    course: CourseArrays
    """That of one world."""
    tables: Any
    """What the renderer needs, as `SceneSlots.bake` returns it; None where nothing is drawn."""

    @property
    def nbytes(self) -> int:
        """Bytes of a slot for both."""
        return sum(array.nbytes for array in self.course) + (0 if self.tables is None else self.tables.nbytes)


class SceneSlots(Protocol):
    """Tables of the renderer for K worlds, each of which can be replaced."""

    def reserve(self, slots: int) -> None:
        """Set K, before the first `put`."""
        ...

    def bake(self, world: World) -> Any:
        """Return the tables of a world, with the size of a slot for them in `nbytes`; called in another thread."""
        ...

    def put(self, slot: int, tables: Any) -> None:
        """Replace the tables of a slot."""
        ...


class RiverPool:
    """Up to K rivers in slots, and those that are being prepared."""

    def __init__(self, rivers: RiverList, config: EnvConfig, num_envs: int, tables: SceneSlots | None = None) -> None:
        """`tables` bakes and holds what a renderer needs; None keeps courses alone. The first river of each level is
        prepared at once. Raises `ConfigError` for more rivers than fit into the memory."""
        self.rivers, self._config, self._tables = rivers, config, tables
        self._parts: list[CourseArrays] = []
        self.river: list[int] = []
        """River of each slot that is filled."""
        self._slot_of: dict[int, int] = {}
        self._uses: list[int] = []
        self._used_at: list[int] = []
        self._clock = 0
        self._expected: set[int] = set()
        self._coming: dict[int, Future[Prepared]] = {}
        self._worker: Worker[Prepared] | None = None
        self.most_loaded = 0
        """Greatest number of rivers that were in memory at a time, those being prepared included."""
        firsts = {river: self._prepare(river) for river in rivers.firsts}
        self.bytes_each = max(each.nbytes for each in firsts.values())
        """Bytes of a slot, about: those of the largest among the first rivers of each level."""
        self.slots = slots_in_memory(len(rivers), rivers.in_memory, num_envs, self.bytes_each, free_bytes())
        """K."""
        if tables is not None:
            tables.reserve(self.slots)
        self._builder = None if tables is None else BackgroundBuilder(rivers.entries)
        if self._builder is not None:  # also for who drops an environment without closing it
            finalize(self, self._builder.close)
        for river in list(firsts)[: self.slots]:
            self._place(river, firsts[river])

    @property
    def loaded(self) -> int:
        """Number of rivers in memory, those being prepared included."""
        return len(self.river) + len(self._coming)

    @property
    def description(self) -> str:
        """A sentence about how many rivers there are, and how many of them are in memory."""
        count, most = len(self.rivers), min(self.slots, len(self.rivers))
        if count == 1:
            return f"1 river, {self.bytes_each / 1e6:,.1f} MB in memory"
        held = "all" if most == count else f"{most:,}"
        return (
            f"{count:,} rivers, another one in each episode; {held} of them in memory,"
            f" {most * self.bytes_each / 1e6:,.1f} MB"
        )

    def take(self, river: int) -> int:
        """Return the slot of a river, which stays there until `leave`; waits for it if it is not in memory yet."""
        return self._take(river, None)

    def take_all(self, rivers: Sequence[int]) -> Iterator[int]:
        """Yield what `take` returns for each river; if all rivers of the list may be in memory, those that are not yet
        are prepared in all threads."""
        together = 2 * get_num_threads() if self.slots >= len(self.rivers) else 1
        for first in range(0, len(rivers), together):
            some = rivers[first : first + together]
            new = (river for river in some if river not in self._slot_of and river not in self._coming)
            missing = list(dict.fromkeys(new))  # several environments may begin in the same river
            ready: dict[int, Prepared] = {}
            if len(missing) > 1:
                with ThreadPoolExecutor(get_num_threads(), "thalweg-rivers") as threads:
                    ready = dict(zip(missing, threads.map(self._prepare, missing), strict=True))
            for river in some:
                yield self._take(river, ready.pop(river, None))

    def _take(self, river: int, ready: Prepared | None) -> int:
        """As `take`; `ready` is what was prepared of the river."""
        slot = self._slot_of.get(river)
        if slot is None:
            self._forget_in_fork()
            coming = self._coming.pop(river, None)
            # A future that has not begun is as far away as none: the thread may still have others before it.
            if ready is None and coming is not None and not coming.cancel():
                ready = coming.result()
            slot = self._place(river, self._prepare(river) if ready is None else ready)
        self._uses[slot] += 1
        self._clock += 1
        self._used_at[slot] = self._clock
        return slot

    def leave(self, slot: int) -> None:
        """Give back a slot that `take` returned."""
        self._uses[slot] -= 1

    def segments(self, river: int) -> int:
        """Return the number of segments of a river, which is loaded for that."""
        slot = self.take(river)
        self.leave(slot)
        return int(self._parts[slot].segments[0])

    def expect(self, rivers: Iterable[int]) -> None:
        """Prepare these rivers in the background, as far as they are not in memory, and forget others that were."""
        if len(self.river) == len(self.rivers):
            return
        self._forget_in_fork()
        self._expected = {int(river) for river in rivers}
        for river in set(self._coming) - self._expected:
            self._coming.pop(river).cancel()
        for river in self._expected:
            if river not in self._slot_of and river not in self._coming:
                if self._worker is None:
                    self._worker = Worker(WeakMethod(self._prepare_later), "thalweg-rivers")
                    finalize(self, self._worker.end).atexit = False
                self._coming[river] = self._worker.submit(river)
        self.most_loaded = max(self.most_loaded, self.loaded)

    def close(self) -> None:
        """Stop preparing and building."""
        if self._builder is not None:
            self._builder.close()
        for future in self._coming.values():
            future.cancel()
        self._coming.clear()
        worker, self._worker = self._worker, None
        if worker is not None and worker.alive:
            worker.close()

    def _forget_in_fork(self) -> None:
        """Forget what is being prepared in a process that was forked, which has none of its parent's threads."""
        if self._worker is not None and not self._worker.alive:
            self._worker = None
            self._coming.clear()

    def part(self, slot: int) -> CourseArrays:
        """Return the course arrays of the river in a slot alone."""
        return self._parts[slot]

    def _prepare_later(self, river: int) -> Prepared:
        """As `_prepare`, in the background: a river that was never built is left to another process."""
        if self._builder is not None:
            self._builder.wait(self.rivers.entries[river])
        return self._prepare(river)

    def _prepare(self, river: int) -> Prepared:
        """Return what is kept of a river."""
        if self._tables is None:
            bare = self.rivers.course if self._config.vehicle == "uav" else self.rivers.sounded
            return Prepared(pack_courses([bare(river)], self._config), None)
        world = self.rivers.world(river)
        return Prepared(pack_courses([world], self._config), self._tables.bake(world))

    def _place(self, river: int, prepared: Prepared) -> int:
        """Put a river into a free slot, or into that of the river that was not used for longest; returns the slot."""
        if len(self.river) < self.slots:
            slot = len(self.river)
            self.river.append(river)
            self._parts.append(prepared.course)
            self._uses.append(0)
            self._used_at.append(0)
        else:
            slot = self._oldest()
            self._slot_of.pop(self.river[slot], None)  # None if an error ended the call that placed it
            self.river[slot], self._parts[slot] = river, prepared.course
        if self._tables is not None:
            self._tables.put(slot, prepared.tables)
        self.courses = join_courses(self._parts)
        self.most_loaded = max(self.most_loaded, self.loaded)
        self._slot_of[river] = slot  # last, so that a river which an error left half placed is placed again
        return slot

    def _oldest(self) -> int:
        """Return the slot that is not in use and was not used for longest, if possible of a river that nobody waits
        for."""
        free = [slot for slot in range(self.slots) if self._uses[slot] == 0]
        return min(free, key=lambda slot: (self.river[slot] in self._expected, self._used_at[slot]))
