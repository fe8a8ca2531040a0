"""Where Thalweg keeps what it can make again: compiled kernels and built worlds.

Nothing in this folder is ever the only copy of anything; deleting it costs time, not data.
"""

import hashlib
import os
from functools import cache
from pathlib import Path

import platformdirs

PACKAGE = Path(__file__).resolve().parent.parent


def cache_dir() -> Path:
    """The cache folder: `$THALWEG_CACHE` if set, else the platform's own place for caches."""
    chosen = os.environ.get("THALWEG_CACHE")
    return Path(chosen) if chosen else Path(platformdirs.user_cache_dir("thalweg", appauthor=False))


@cache
def source_hash(*parts: str) -> str:
    """A hash of the Python sources under the named parts of the package, such as `"world"` or `"kernel.py"`.

    Whatever was made by those sources is stale once the hash changes.
    """
    digest = hashlib.sha256()
    for part in sorted(parts):
        path = PACKAGE / part
        files = [path] if path.is_file() else sorted(path.rglob("*.py"))
        for file in files:
            digest.update(file.relative_to(PACKAGE).as_posix().encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def file_mark(path: Path) -> str:
    """What tells a file from every other: a hash of its content."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]
