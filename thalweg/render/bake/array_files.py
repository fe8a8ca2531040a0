"""Files of arrays in the cache folder, each named by a hash of all that it was computed from."""

import contextlib
import hashlib
import os
from collections.abc import Iterable, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from thalweg.core.atomic_io import atomic_path
from thalweg.core.cache import keep_most_recent


def digest_of(*values: Any) -> str:
    """Return a hash of records, arrays and numbers, of all that they consist of: 32 hexadecimal digits."""
    digest = hashlib.sha256()
    for value in values:
        for chunk in _chunks(value):
            digest.update(chunk)
    return digest.hexdigest()[:32]


def _chunks(value: Any) -> Iterator[Any]:
    """Yield the bytes of a record's fields, each field after its type and shape."""
    if is_dataclass(value):
        for field in fields(value):
            yield from _chunks(getattr(value, field.name))
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype.str}{value.shape}".encode()
        yield np.ascontiguousarray(value).data.cast("B") if value.size else b""
    else:
        yield f"{value!r};".encode()


def store(arrays: NamedTuple, path: Path, most_bytes: int) -> None:
    """Write a named tuple of arrays atomically, and remove the least recently used files beyond a size of the folder.

    If the folder is not writable, nothing is stored.
    """
    with contextlib.suppress(OSError):
        with atomic_path(path) as draft, draft.open("wb") as file:
            # Not compressed, which would take longer to read.
            np.savez(file, **arrays._asdict())
        keep_most_recent(path.parent, most_bytes)


def stored(path: Path, names: Iterable[str]) -> list[np.ndarray] | None:
    """Return the named arrays in a file, or None if it is missing or damaged."""
    try:
        with np.load(path) as file:
            arrays = [file[name] for name in names]
    except Exception:  # a damaged archive raises nearly anything
        return None
    with contextlib.suppress(OSError):
        os.utime(path)
    return arrays
