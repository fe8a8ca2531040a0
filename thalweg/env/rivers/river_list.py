"""`RiverList`: rivers by level and seed, of which none is built before it is needed."""

import hashlib
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from thalweg.core import versions
from thalweg.core.seeds import parse_seeds
from thalweg.env.config import ConfigError, integer_at_least
from thalweg.env.rivers.bare_river import load_or_plan
from thalweg.env.rivers.sounded_river import load_or_sound
from thalweg.env.task.course_arrays import fingerprint
from thalweg.world import Level, load_or_build
from thalweg.world.generate.build import resolve_level
from thalweg.world.record import World

Entry = tuple[Level, int] | World
"""A level and a seed, or a world that is there already."""


class RiverList:
    """Rivers of which each episode is flown on a random one; see `RiverVectorEnv`."""

    def __init__(self, entries: Iterable[Entry], in_memory: int | None = None) -> None:
        """`in_memory`: greatest number of rivers held in memory at a time; None derives it from the free memory.

        Raises `ConfigError` for an empty list, an entry of another type, and a number that is not whole or below 1.
        """
        self.entries = tuple(map(_checked, entries))
        if not self.entries:
            raise ConfigError("a list of rivers needs at least one")
        self.in_memory = None if in_memory is None else integer_at_least("in_memory", in_memory, 1)

    @classmethod
    def of_levels(cls, levels: Sequence[tuple[Level | str, Any]], in_memory: int | None = None) -> "RiverList":
        """Return the rivers of pairs of a level and seeds, which `thalweg.core.seeds.parse_seeds` reads.

        Raises `WorldError` for an unknown level and `ConfigError` for seeds that cannot be read.
        """
        return cls(
            [
                resolve_level(level, seed)
                for level, seeds in levels
                for seed in parse_seeds(seeds, "seeds of rivers", ConfigError)
            ],
            in_memory,
        )

    def __len__(self) -> int:
        return len(self.entries)

    @property
    def names(self) -> list[str]:
        """Name and seed of each river, such as Medium-1000."""
        return [self.name(index) for index in range(len(self))]

    def name(self, index: int) -> str:
        """Return the name and seed of a river, such as Medium-1000."""
        entry = self.entries[index]
        return entry.label if isinstance(entry, World) else f"{entry[0].name}-{entry[1]}"

    @property
    def firsts(self) -> list[int]:
        """Index of the first river of each level, and of the first world that is there already."""
        levels = [None if isinstance(entry, World) else entry[0] for entry in self.entries]
        return [levels.index(level) for level in dict.fromkeys(levels)]

    @property
    def most_segments(self) -> int:
        """Greatest number of segments of a river."""
        return max(entry.river.segments if isinstance(entry, World) else entry[0].samples for entry in self.entries)

    def world(self, index: int) -> World:
        """Return a river, from the cache folder if it was built before."""
        entry = self.entries[index]
        return entry if isinstance(entry, World) else load_or_build(*entry)

    def course(self, index: int) -> World:
        """Return a river without its land: its course, islands and bridges, which are all that the rules need.

        That takes a fraction of the time and of the memory of a whole river.
        """
        entry = self.entries[index]
        return entry if isinstance(entry, World) else load_or_plan(*entry)

    def sounded(self, index: int) -> World:
        """Return a river with its bed, which the rules of a boat need, and without light; in half the time of a whole
        one."""
        entry = self.entries[index]
        return entry if isinstance(entry, World) else load_or_sound(*entry)

    def identity(self) -> np.ndarray:
        """Return a hash [1] uint64 of all rivers in order, by which the state of another list is refused."""
        digest = hashlib.sha256()
        for entry in self.entries:
            words = fingerprint(entry) if isinstance(entry, World) else (entry[0].key, entry[0].name, entry[1])
            if not isinstance(entry, World) and entry[0].banks:
                words = words, versions.BANKS
            digest.update(repr((words, versions.WORLD)).encode())
        return np.frombuffer(digest.digest()[:8], dtype=np.uint64).copy()


def _checked(entry: Any) -> Entry:
    """Return an entry of a list with its seed as Python's integer; raises `ConfigError` for anything else."""
    if isinstance(entry, World):
        return entry
    if not isinstance(entry, tuple) or len(entry) != 2 or not isinstance(entry[0], Level):
        raise ConfigError(
            f"an entry of a list of rivers must be a World, or a Level and a seed, not {entry!r:.60}: give names of"
            " levels and seeds to RiverList.of_levels"
        )
    return entry[0], integer_at_least("the seed of a river", entry[1], 0)
