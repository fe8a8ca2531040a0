"""Rivers that encoders learn from and are judged on: those of levels, or a real one under several plants and hills."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from thalweg.core.seeds import refuse_unseen
from thalweg.encoder import EncoderInputError
from thalweg.env.rivers.memory import check_all_fit, drawn_bytes
from thalweg.env.rivers.river_list import RiverList
from thalweg.train.river import RiverTraining, announce_build, banks_version
from thalweg.world import Reach, World, level_named, load_or_build
from thalweg.world.generate.memory import free_bytes

REACH_SEEDS = {"world_seeds": tuple(range(1000, 1006)), "held_out_seeds": tuple(range(3000, 3002))}
"""Seeds of a real river where none are given: each is a whole valley around the same course, and all are in memory."""
JUDGED_APART = 1_000_003
"""Added to the seed of the poses at which a network is judged: on a real river, whose other seeds have the same course,
the same random numbers would give the poses of training again."""


@dataclass(frozen=True)
class Grounds:
    """Levels, or a real river in their place."""

    levels: tuple[str, ...]
    river: Reach | None = None

    def check(self) -> None:
        """Raise `EncoderInputError` for no level or one that is named twice, and `WorldError` for an unknown one, and
        for a file from which no river can be made."""
        if self.river is not None:
            self.river.check()
            return
        names = self.names
        if not names or len(set(names)) < len(names):
            raise EncoderInputError(f"levels must be at least one, each once, not {', '.join(names) or 'none'}")

    def check_seeds(self, seeds: Sequence[int], judged: Sequence[int]) -> None:
        """Raise `EncoderInputError` for no seeds of rivers to learn from or to judge on, and for unseen rivers of
        levels to learn from."""
        for name, given in (("world_seeds", seeds), ("held_out_seeds", judged)):
            if not given:
                raise EncoderInputError(f"{name} needs at least one seed")
        if self.river is None:
            refuse_unseen(seeds, "world_seeds", EncoderInputError)

    @property
    def names(self) -> list[str]:
        """Names of the levels as they are usually written; raises `WorldError` for an unknown one."""
        return [level_named(level).name for level in self.levels]

    def as_data(self) -> dict[str, Any]:
        """Return what distinguishes the rivers from others, besides their seeds, as plain data: a file counts by name,
        content and options."""
        if self.river is not None:
            return {"river": self.river.as_data(), **banks_version([self.river])}
        return {"levels": self.names, **banks_version(map(level_named, self.levels))}

    def worlds(self, seeds: Sequence[int]) -> list[World]:
        """Return the river of each level and seed, or the real river with the plants and hills of each seed; raises
        `ConfigError` for more of these than fit into the memory."""
        if self.river is not None:
            return RiverTraining(self.river, len(seeds), tuple(seeds)).worlds()
        return [load_or_build(level, seed) for level in self.levels for seed in seeds]

    def listed(self, seeds: Sequence[int], in_memory: int | None) -> RiverList:
        """Return the same rivers as a list, of which those of levels are built when they are needed."""
        if self.river is not None:
            return RiverList(self.worlds(seeds))
        return RiverList.of_levels([(level, seeds) for level in self.levels], in_memory)

    def check_all_fit(self, *lists: Sequence[int]) -> None:
        """Raise `ConfigError` if the valleys of a real river with the seeds of all lists do not fit into the memory
        together; one of them is built. To be called before any of the lists is loaded."""
        if self.river is None:
            return
        seed = lists[0][0]
        announce_build(self.river, seed)
        check_all_fit(sum(map(len, lists)), drawn_bytes(self.river.build(seed)), free_bytes())

    def check_limit(self, in_memory: int | None) -> None:
        """Raise `EncoderInputError` for a limit of rivers in memory, `in_memory`, where there is none to set, and for
        one below 1."""
        if in_memory is not None and (type(in_memory) is not int or in_memory < 1):
            raise EncoderInputError(f"rivers_in_memory must be a whole number of at least 1, not {in_memory}")
        if self.river is not None and in_memory is not None:
            raise EncoderInputError(
                f"rivers_in_memory is for levels; all valleys of {self.river.name} are in memory: give fewer seeds"
            )
