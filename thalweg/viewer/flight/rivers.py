"""Rivers by name and seed; the last ones that were flown stay in memory."""

from collections import OrderedDict
from collections.abc import Callable, Iterable
from threading import Lock

from thalweg.core.suggestion import did_you_mean
from thalweg.env.vehicle.levels import LEVELS_OF
from thalweg.viewer.errors import ViewerError
from thalweg.world import Reach, World, WorldError, level_named, load_or_build

KEPT = 4
"""Rivers in memory, some 100 MB each."""


class Rivers:
    """Builds rivers when they are asked for, one at a time."""

    def __init__(self, reach: Reach | None = None) -> None:
        """`reach`: a real river that can be flown beside the levels."""
        self._build: dict[str, Callable[[int | None], World]] = {
            name: _level(name) for name in dict.fromkeys(name for names in LEVELS_OF.values() for name in names)
        }
        if reach is not None:
            self._build[reach.name] = lambda seed: reach.build(seed or 0)
        self.own: Iterable[str] = () if reach is None else (reach.name,)
        """Names of the rivers that are of no level."""
        self._kept: OrderedDict[tuple[str, int], World] = OrderedDict()
        self._usual_seeds: dict[str, int] = {}
        """Seeds of rivers that were asked for without one."""
        self._lock = Lock()

    def check(self, name: str) -> None:
        """Raise `ViewerError`, which lists the rivers, for a name that is not among them."""
        self._builder(name)

    def world(self, name: str, seed: int | None) -> World:
        """Return a river; the errors are those of `check` and of the river's making."""
        self.check(name)
        with self._lock:
            chosen = self._usual_seeds.get(name) if seed is None else seed
            if chosen is None or (name, chosen) not in self._kept:
                world = self._builder(name)(seed)
                if seed is None:
                    self._usual_seeds[name] = world.seed
                chosen = world.seed
                self._kept[name, chosen] = world
            self._kept.move_to_end((name, chosen))
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
            return self._kept[name, chosen]

    def _builder(self, name: str) -> Callable[[int | None], World]:
        """Return what builds a river; that of a level may have other banks, such as Medium+meadow."""
        level, _, banks = name.partition("+")
        if name in self._build:
            return self._build[name]
        if banks and level in self._build:
            try:
                return _level(name)
            except WorldError as reason:
                raise ViewerError(str(reason)) from None
        raise ViewerError(f"unknown river {name!r}{did_you_mean(name, self._build)}; known: {', '.join(self._build)}")


def _level(name: str) -> Callable[[int | None], World]:
    level = level_named(name)
    return lambda seed: load_or_build(level, level.default_seed if seed is None else seed)
