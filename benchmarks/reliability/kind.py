"""A kind of file that is fuzzed, and what a right answer is: one without a number that is not finite."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

OLDER = ("end_x", "end_y", "end_z", "ahead")
"""Numbers that are NaN or None in a right answer: results of before they were recorded, and on loops."""


class UnsoundError(Exception):
    """An answer that holds a number that is not finite, or text that cannot be written."""


@dataclass(frozen=True)
class Kind:
    """A kind of file."""

    file: str
    """Name under which it is read."""
    samples: Callable[[Path], list[bytes]]
    """Valid contents; the folder is for files that must be written first."""
    mutate: Callable[[bytes, Random], bytes]
    read: Callable[[Path], Any]
    errors: tuple[type[Exception], ...]
    """The project's own errors that a bad file may raise."""
    wanted: int = 100_000
    """Files that the whole has; a multiple of a thousand."""


def check_sound(value: Any, where: str = "it") -> None:
    """Raise `UnsoundError` for a value that holds a number that is not finite, or text that is not Unicode."""
    for place, each in _leaves(value, where):
        if isinstance(each, np.ndarray):
            if each.dtype.kind in "fc" and not np.isfinite(each).all():
                raise UnsoundError(f"{place} holds a number that is not finite")
        elif isinstance(each, float | np.floating):
            if not np.isfinite(each):
                raise UnsoundError(f"{place} is {each}")
        elif isinstance(each, str):
            try:
                each.encode()
            except UnicodeEncodeError:
                raise UnsoundError(f"{place} is text that cannot be written: {each!r}") from None


def _leaves(value: Any, where: str) -> Iterator[tuple[str, Any]]:
    rest = [(where, value)]
    while rest:
        place, each = rest.pop()
        if isinstance(each, dict):
            rest.extend((f"{place}.{key!s:.40}", part) for key, part in each.items())
        elif isinstance(each, list | tuple):
            rest.extend((f"{place}[{index}]", part) for index, part in enumerate(each))
        elif is_dataclass(each) and not isinstance(each, type):
            rest.extend(
                (f"{place}.{field.name}", getattr(each, field.name))
                for field in fields(each)
                if field.name not in OLDER
            )
        else:
            yield place, each


def written(folder: Path, file: str, write: Callable[[Path], object]) -> bytes:
    write(folder / file)
    content = (folder / file).read_bytes()
    (folder / file).unlink()
    return content
