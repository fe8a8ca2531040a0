"""Where are built worlds kept, and for how long? One folder for each version of the sources that make them.

Worlds made by other versions are of no use to this one; their folders go when nobody has used them for a while.
"""

import contextlib
import hashlib
import os
import re
import time
from functools import cache
from importlib.metadata import version
from pathlib import Path

from thalweg.core.cache import PACKAGE, cache_dir, code_hash
from thalweg.world.errors import WorldFileError
from thalweg.world.generate.build import build, resolve
from thalweg.world.levels import Level
from thalweg.world.record import World

SOURCES = (
    PACKAGE / "core" / "jit.py",
    *(path for path in (PACKAGE / "world").rglob("*.py") if path.stem not in ("map_image", "__init__")),
)
"""All code that can change a world or its file; the drawing of maps can't."""
LIBRARIES = ("numpy", "scipy", "numba")
"""Another version of these may round otherwise."""


def stamp() -> str:
    """A hash of the code that makes worlds, and of the versions of the libraries."""
    parts = [code_hash(SOURCES), *(version(library) for library in LIBRARIES)]
    return hashlib.sha256(" ".join(parts).encode()).hexdigest()[:16]


STAMP = stamp()
"""Taken on import: a process older than the sources on the disk must not store its worlds under their name."""
KEEP_S = 14 * 86400.0
"""A folder of another version that was not used for so long is removed."""
DRAFT_S = 86400.0
"""A half-written file of that age belongs to nobody any more."""
FOLDER = re.compile(r"[0-9a-f]{16}")
"""What the folders of versions are called; anything else is left alone."""


def load_or_build(level: Level | str, seed: int | None = None) -> World:
    """As `build`, but taken from the cache folder if it was built before; a damaged file there is replaced.

    A cache folder that cannot be written to costs time, not the world.
    """
    level, seed = resolve(level, seed)
    path = place_of(level, seed)
    if path.is_file():
        try:
            world = World.load(path)
        except WorldFileError:
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)
        else:
            with contextlib.suppress(OSError):
                os.utime(path.parent)
            return world
    world = build(level, seed)
    with contextlib.suppress(OSError):
        world.save(path)
        os.utime(path.parent)
        tidy_once(path.parent.parent)
    return world


def place_of(level: Level, seed: int) -> Path:
    """Where the world of a level and a seed is kept: named for people, told apart by a hash."""
    slug = re.sub(r"[^a-z0-9]+", "-", level.name.lower()).strip("-") or "level"
    key = hashlib.sha256(f"{level.key}-{seed}".encode()).hexdigest()[:12]
    return cache_dir() / "worlds" / STAMP / f"{slug}-{str(seed)[:12]}-{key}.npz"


@cache
def tidy_once(worlds: Path) -> None:
    """`tidy`, the first time that this process asks for it."""
    tidy(worlds, time.time())


def tidy(worlds: Path, now_s: float) -> None:
    """Remove worlds of other versions that were long not used, and what killed processes left half written.

    `now_s` is the time in seconds since 1970. What another process removes or holds at the same time is passed over.
    """
    for folder in worlds.iterdir():
        if not FOLDER.fullmatch(folder.name) or folder.is_symlink() or not folder.is_dir():
            continue
        with contextlib.suppress(OSError):
            unused = folder.name != STAMP and now_s - folder.stat().st_mtime > KEEP_S
            for file in folder.glob("*.npz") if unused else ():
                file.unlink(missing_ok=True)
            for draft in folder.glob(".*.part*"):
                if now_s - draft.stat().st_mtime > DRAFT_S:
                    draft.unlink(missing_ok=True)
            if unused:
                folder.rmdir()
