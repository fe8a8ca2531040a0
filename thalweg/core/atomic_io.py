"""How does a file reach the disk? Whole or not at all: written beside its place, then put there in one move.

Every file that Thalweg writes in one go is written by this; tables that grow by rows, and checkpoints, which are
folders, are not.
"""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def whole(path: str | Path) -> Iterator[Path]:
    """A new path beside `path` to write to; what stands there when the block ends takes the place of `path`.

    Whoever reads `path` meanwhile, and whoever comes after a kill at any moment, finds the old file or the new one.
    An error in the block leaves the old one and nothing else. The folder of `path` is made if missing. The new path is
    hidden and never used twice, so that what a killed process leaves is in nobody's way; it ends as `path` does, since
    many writers choose a format by that.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    # Not `tempfile`: its files are the owner's alone, whatever the umask says.
    draft = path.with_name(f".{path.stem}.{secrets.token_hex(8)}.part{path.suffix}")
    try:
        yield draft
        with draft.open("r+b") as file:
            os.fsync(file.fileno())
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def write_whole(path: str | Path, content: bytes | str) -> None:
    """Write a file whole or not at all; text in UTF-8, its line ends as they are."""
    with whole(path) as draft:
        draft.write_bytes(content.encode() if isinstance(content, str) else content)
