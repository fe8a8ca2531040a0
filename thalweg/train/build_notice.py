"""Notice on the terminal before a world is built, which takes a few seconds."""

import sys
from functools import cache

from thalweg.render import compilation
from thalweg.world import Level, Reach
from thalweg.world.store.world_cache import cache_path


def announce_build(level: Level | Reach, seed: int) -> None:
    """Print a line if the river of a level or a file and a seed is not cached, and start compiling the renderer."""
    compilation.begin()
    if isinstance(level, Reach) or not cache_path(level, seed).is_file():
        _print_once(f"building the river {level.name}, seed {seed}: a few seconds")


@cache
def _print_once(line: str) -> None:
    """Print each line once, to stderr: stdout is for results."""
    print(line, file=sys.stderr, flush=True)
