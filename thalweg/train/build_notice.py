"""What takes long before anything moves? One line before it begins, so that nobody takes it for hung."""

import sys
from functools import cache

from thalweg.render import compilation
from thalweg.world import Level, Reach
from thalweg.world.store.world_cache import cache_path


def announce(level: Level | Reach, seed: int) -> None:
    """Say it if the river of a level or a file and a seed has to be built; meanwhile the frames' kernel is compiled."""
    compilation.begin()
    if isinstance(level, Reach) or not cache_path(level, seed).is_file():
        _say(f"building the river {level.name}, seed {seed}: a few seconds")


@cache
def _say(line: str) -> None:
    """Each line once, where progress goes: what a program reads stays free of it."""
    print(line, file=sys.stderr, flush=True)
