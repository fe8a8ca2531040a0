"""Lock of a file that several processes change: each reads it, adds to it and writes it anew.

Folders that belong to one command are held by `thalweg.core.run_folder` instead, which refuses a second one.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from thalweg.core.run_folder import NO_LOCKS


@contextmanager
def held(path: Path) -> Iterator[None]:
    """Hold a file while the block changes it; others that hold it are waited for.

    The lock is a hidden file beside it, which stays: one that is removed could be held twice. Where the file system has
    no locks, or `filelock` is not installed, the block runs without one.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    lock = None
    with suppress(ImportError):
        from filelock import FileLock  # not in an installation that only flies

        lock = FileLock(path.with_name(f".{path.name}.lock"))
        try:
            lock.acquire()
        except OSError as error:
            if error.errno not in NO_LOCKS:
                raise
    try:
        yield
    finally:
        if lock is not None:
            lock.release()
