"""The cache folder, and the hashes that name what lies in it.

Nothing in this folder is ever the only copy of anything; deleting it costs time, not data.
"""

import ast
import contextlib
import hashlib
import os
from collections.abc import Iterable
from pathlib import Path

import platformdirs

from thalweg.core.atomic_io import write_whole

PACKAGE = Path(__file__).resolve().parent.parent


def cache_dir() -> Path:
    """The cache folder: `$THALWEG_CACHE` if set, else the platform's own place for caches."""
    chosen = os.environ.get("THALWEG_CACHE")
    return Path(chosen) if chosen else Path(platformdirs.user_cache_dir("thalweg", appauthor=False))


def code_hash(files: Iterable[Path]) -> str:
    """A hash of the code of Python files: comments, docstrings, layout and file names do not change it.

    Parsing takes tenths of a second, so the result is remembered in the cache folder under a hash of the bytes.
    """
    contents = [file.read_bytes() for file in sorted(files)]
    known = cache_dir() / "code" / _digest(*(hashlib.sha256(content).digest() for content in contents))
    with contextlib.suppress(OSError):
        return known.read_text(encoding="ascii")
    found = _digest(*(ast.dump(_without_docstrings(ast.parse(content))).encode() for content in contents))
    with contextlib.suppress(OSError):
        write_whole(known, found)
    return found


def file_hash(path: Path) -> str:
    """A hash of the content of a file, 16 hexadecimal digits."""
    return _digest(path.read_bytes())


def _digest(*parts: bytes) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part)
    return digest.hexdigest()[:16]


def _without_docstrings(tree: ast.Module) -> ast.Module:
    """The tree without its string statements: docstrings, and those that describe a field or a constant."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            body[:] = [each for each in body if not _is_text(each)]
    return tree


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
