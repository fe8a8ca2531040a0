"""The cache of built worlds: one folder for each version of the code that builds them, and kind of machine.

Worlds have the same bits on machines of one kind only. Worlds of other versions cannot be used; their folders are
removed after they have not been used for a while.
"""

import contextlib
import hashlib
import os
import re
import time
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from pathlib import Path

from thalweg.core.cache import PACKAGE, cache_dir, code_hash, is_stored, keep_most_recent, remove_leftovers
from thalweg.core.compute.jit import machine_hash
from thalweg.world.banks import text_of
from thalweg.world.errors import WorldFileError
from thalweg.world.generate.build import build, resolve_level
from thalweg.world.levels import Level
from thalweg.world.record import World

SOURCES = (
    *(PACKAGE / "core" / "compute" / name for name in ("jit.py", "kernel_compiler.py")),
    *(path for path in (PACKAGE / "world").rglob("*.py") if path.stem not in ("map_image", "__init__")),
)
"""All code that can change a world or its file; the drawing of maps cannot."""
LIBRARIES = ("numpy", "scipy", "numba")
"""Libraries whose other versions may round differently."""


def generator_hash() -> str:
    """Return a hash of the code that builds worlds, of its libraries, and of the machine, see `machine_hash`."""
    components = [code_hash(SOURCES), *(version(library) for library in LIBRARIES), machine_hash()]
    return hashlib.sha256(" ".join(components).encode()).hexdigest()[:16]


GENERATOR_HASH = generator_hash()
"""Computed on import: a process older than the sources on the disk must not store its worlds under their hash."""
MOST_BYTES = 16_000_000_000
"""Size of the worlds of a version that are kept: some 1,000 rivers of Hard."""
UNUSED_FOLDER_AGE_S = 14 * 86400.0
"""Age after which an unused folder of another version is removed."""
FOLDER = re.compile(r"[0-9a-f]{16}")
"""Names of the folders of versions; anything else is left alone."""


def load_or_build(level: Level | str, seed: int | None = None) -> World:
    """Return the world of a level and a seed as `build` does, but from the cache folder if it was built before.

    A damaged file in the cache is replaced. A cache folder that cannot be written costs time, not the world.
    """
    level, seed = resolve_level(level, seed)
    return load_or_make(cache_path(level, seed), lambda: build(level, seed))


def load_or_make(path: Path, make: Callable[[], World]) -> World:
    """Return the world at a path in the cache, or one that is made and stored there, as `load_or_build` does.

    A file that cannot be read is replaced, not removed: what is wrong may be this process, which lacks memory. The
    least recently used files beyond `MOST_BYTES` of a version are removed.
    """
    if is_stored(path):
        with contextlib.suppress(WorldFileError):
            world = World.load(path)
            with contextlib.suppress(OSError):
                os.utime(path)
                os.utime(path.parent)
            return world
    world = make()
    with contextlib.suppress(OSError):
        world.save(path)
        os.utime(path.parent)
        keep_most_recent(path.parent, MOST_BYTES)
        remove_stale_once(path.parent.parent)
    return world


def cache_path(level: Level, seed: int) -> Path:
    """Return the path of a cached world: a readable name with a hash of level and seed."""
    banks = f"-{text_of(level.banks)}" if level.banks else ""
    return named_path(level.name, seed, f"{level.key}-{seed}{banks}")


def named_path(name: str, seed: int, key: str) -> Path:
    """Return the path of a world in the cache: a readable name with a hash of its key."""
    slug = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")[:40] or "level"
    digest = hashlib.sha256(key.encode()).hexdigest()[:12]
    return cache_dir() / "worlds" / GENERATOR_HASH / f"{slug}-{str(seed)[:12]}-{digest}.npz"


@cache
def remove_stale_once(worlds: Path) -> None:
    """Call `remove_stale` the first time this process asks for it."""
    remove_stale(worlds, time.time())


def remove_stale(worlds: Path, now_s: float) -> None:
    """Remove unused worlds of other versions, and temporary files of killed processes.

    `now_s` is the time in seconds since 1970. Files that another process removes or holds at the same time are skipped.
    """
    for folder in worlds.iterdir():
        if not FOLDER.fullmatch(folder.name) or folder.is_symlink() or not folder.is_dir():
            continue
        with contextlib.suppress(OSError):
            unused = folder.name != GENERATOR_HASH and now_s - folder.stat().st_mtime > UNUSED_FOLDER_AGE_S
            for file in folder.glob("*.npz") if unused else ():
                file.unlink(missing_ok=True)
            remove_leftovers(folder)
            if unused:
                folder.rmdir()
