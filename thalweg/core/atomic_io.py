"""Atomic file writes: a file is written to a temporary path in its folder and renamed when it is complete.

Every file that Thalweg writes at once goes through this module. Tables that grow by rows do not, nor do checkpoints,
which are folders.
"""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path to write to; when the block ends without an error, it replaces `path`.

    Readers of `path` see the old file or the new one, never a part of it, also after the process was killed. An error
    in the block leaves the old file and removes the temporary one. The folder of `path` is created if it is missing.
    The temporary name is hidden and random, so that files left by killed processes disturb nobody; its suffix is that
    of `path`, because many writers choose the file format by it.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    # Not `tempfile`: its files are readable by their owner alone, whatever the umask.
    temporary = path.with_name(f".{path.stem}.{secrets.token_hex(8)}.part{path.suffix}")
    try:
        yield temporary
        # Without fsync, a power failure could leave the new name with no content behind it.
        with temporary.open("r+b") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_atomic(path: str | Path, content: bytes | str) -> None:
    """Write `content` to a file atomically; text is encoded as UTF-8 and its line ends are kept."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)
