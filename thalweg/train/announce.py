"""What takes long before anything moves? One line before it begins, so that nobody takes it for hung."""

import sys
from functools import cache

from thalweg.kernel import kernel_folder
from thalweg.render import compilation
from thalweg.world import Level
from thalweg.world.store import place_of


def announce(level: Level, seed: int) -> None:
    """Say what has to be made before the river of a level and a seed can be flown: kernels, and the river itself."""
    compilation.begin()
    folder = kernel_folder()
    if folder is None or next(folder.rglob("*.nbi"), None) is None:
        _say("compiling kernels: first start only, about a minute")
    if not place_of(level, seed).is_file():
        _say(f"building the river {level.name}, seed {seed}: a few seconds, then it is kept")


@cache
def _say(line: str) -> None:
    """Each line once, where progress goes: what a program reads stays free of it."""
    print(line, file=sys.stderr, flush=True)
