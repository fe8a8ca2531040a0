"""The cache folder, and the hashes that name what is stored in it.

The cache never holds the only copy of anything: deleting it costs time, not data.
"""

import ast
import contextlib
import hashlib
import os
import re
import shutil
import time
from collections.abc import Iterable
from pathlib import Path

import platformdirs

from thalweg.core.atomic_io import is_temporary, without_temporaries, write_atomic

PACKAGE = Path(__file__).resolve().parent.parent
DIGEST = re.compile(r"[0-9a-f]{16}")
"""A hash of this module."""
UNUSED_DAYS = 30
"""Days without use after which files in the cache are removed."""
TEMPORARY_FILE_AGE_S = 86400.0
"""Age after which a temporary file is taken to be left by a killed process."""


def cache_dir() -> Path:
    """Return the cache folder: `$THALWEG_CACHE` if set, else the platform's user cache folder."""
    chosen = os.environ.get("THALWEG_CACHE")
    return Path(chosen).expanduser() if chosen else Path(platformdirs.user_cache_dir("thalweg", appauthor=False))


def code_hash(files: Iterable[Path]) -> str:
    """Return a hash of the code of Python files that ignores comments, docstrings, layout and file names.

    Parsing takes tenths of a second, so the result is stored in the cache folder under a hash of the files' bytes. A
    file there that holds no hash is replaced.
    """
    contents = [file.read_bytes() for file in sorted(files)]
    stored = cache_dir() / "code" / _digest(*(hashlib.sha256(content).digest() for content in contents))
    with contextlib.suppress(OSError, UnicodeDecodeError):
        if DIGEST.fullmatch(found := stored.read_text(encoding="ascii")):
            return found
    result = _digest(*(ast.dump(_without_docstrings(ast.parse(content))).encode() for content in contents))
    with contextlib.suppress(OSError):
        write_atomic(stored, result)
    remove_leftovers(stored.parent)
    return result


def is_stored(path: Path) -> bool:
    """Return whether a file is in the cache; in a folder that may not be entered there is none."""
    return os.path.isfile(path)  # `Path.is_file` raises


def remove_leftovers(folder: Path) -> None:
    """Remove the temporary files of killed processes from a folder of the cache.

    Files that another process removes or holds at the same time are skipped.
    """
    newest = time.time() - TEMPORARY_FILE_AGE_S
    with contextlib.suppress(OSError):
        for temporary in filter(is_temporary, folder.iterdir()):
            with contextlib.suppress(OSError):
                if temporary.stat().st_mtime < newest:
                    temporary.unlink(missing_ok=True)


def keep_in_use(entry: Path, pattern: str) -> None:
    """Mark a file or folder of the cache as used, and remove those beside it that were not for `UNUSED_DAYS`.

    pattern: matches the names of what may be removed; old temporary files go too. Files that another process removes
        at the same time are skipped.
    """
    oldest = time.time() - UNUSED_DAYS * 86400
    with contextlib.suppress(OSError):
        os.utime(entry)
        for other in entry.parent.glob(pattern):
            with contextlib.suppress(OSError):
                if other.stat().st_mtime < oldest:
                    _remove(other)
        remove_leftovers(entry.parent)


def _remove(path: Path) -> None:
    """Remove a file or folder at once, so that no process finds a part of it.

    Raises `OSError` if another process was faster.
    """
    # The new name has the same pattern: what a killed process leaves is removed by the next one.
    doomed = path.rename(path.with_name(f"{path.stem}.removed{path.suffix}"))
    if doomed.is_dir():
        shutil.rmtree(doomed, ignore_errors=True)  # what another process removed from it is gone already
    else:
        doomed.unlink()


def file_hash(path: Path) -> str:
    """Return a hash of the content of a file: 16 hexadecimal digits."""
    return _digest(path.read_bytes())


def _digest(*chunks: bytes) -> str:
    digest = hashlib.sha256()
    for chunk in chunks:
        digest.update(chunk)
    return digest.hexdigest()[:16]


def _without_docstrings(tree: ast.Module) -> ast.Module:
    """Remove all string statements from a tree: docstrings, and those that describe a field or a constant."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            body[:] = [statement for statement in body if not _is_string_statement(statement)]
    return tree


def _is_string_statement(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def keep_most_recent(folder: Path, most_bytes: int) -> None:
    """Remove the least recently used `.npz` files of a folder beyond a size in bytes, and old temporary files.

    Files that another process removes at the same time are skipped.
    """
    remove_leftovers(folder)
    found = []
    for file in without_temporaries(folder.glob("*.npz")):
        with contextlib.suppress(OSError):
            status = file.stat()
            found.append((status.st_mtime, status.st_size, file))
    total = 0
    for _, size, file in sorted(found, reverse=True):
        total += size
        if total > most_bytes:
            with contextlib.suppress(OSError):
                file.unlink(missing_ok=True)
