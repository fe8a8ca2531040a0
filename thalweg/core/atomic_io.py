"""Atomic file writes: a file is written to a temporary path in its folder and renamed when it is complete.

Every file that Thalweg writes at once goes through this module. Tables that grow by rows do not, nor do checkpoints,
which are folders; like these files, they name themselves in the errors of a full disk (`disk_errors_name`).
"""

import errno
import io
import os
import re
import secrets
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

ON_WINDOWS = os.name == "nt"
PAUSES_S = (0.05,) * 40
"""Pauses between attempts to replace a file on Windows, in seconds."""
DISK_ERRORS = {errno.ENOSPC, errno.EFBIG, errno.EIO, getattr(errno, "EDQUOT", errno.ENOSPC)}
"""Numbers of the system's errors about a disk that takes no more: no space left, too large, broken, or over a quota."""
TEMPORARY = re.compile(r"\..*\.[0-9a-f]{16}\.part(\.[^.]*)?", re.DOTALL)
"""Names of the temporary files of `atomic_path`."""


def is_disk_error(error: BaseException) -> bool:
    """Return whether an error is the system's about a disk that takes no more."""
    return isinstance(error, OSError) and error.errno in DISK_ERRORS


@contextmanager
def disk_errors_name(path: str | Path, temporary: str | Path | None = None) -> Iterator[None]:
    """Raise the system's errors in the block that name no file, or the temporary one, with the name of `path`.

    The system names the file that cannot be opened, but none when a write fails, such as on a full disk.
    """
    try:
        yield
    except OSError as error:
        nameless = error.filename is None and is_disk_error(error)
        if nameless or (temporary is not None and error.filename == str(temporary)):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path to write to; when the block ends without an error, it replaces `path`.

    Readers of `path` see the old file or the new one, never a part of it, also after the process was killed. An error
    in the block leaves the old file and removes the temporary one; the error of a full disk names `path`. The folder of
    `path` is created if it is missing. The temporary name is hidden and random, so that files left by killed processes
    disturb nobody; its suffix is that of `path`, because many writers choose the file format by it.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    # Not `tempfile`: its files are readable by their owner alone, whatever the umask.
    temporary = path.with_name(f".{path.stem}.{secrets.token_hex(8)}.part{path.suffix}")
    try:
        with disk_errors_name(path, temporary):
            yield temporary
            # Without fsync, a power failure could leave the new name with no content behind it.
            with temporary.open("r+b") as file:
                os.fsync(file.fileno())
            _replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def is_temporary(path: str | Path) -> bool:
    """Return whether a path has the name of a temporary file of `atomic_path`, which a killed process may leave."""
    return TEMPORARY.fullmatch(Path(path).name) is not None


def without_temporaries(paths: Iterable[Path]) -> list[Path]:
    """Return the paths, sorted, except for temporary files, which `Path.glob` also finds."""
    return sorted(path for path in paths if not is_temporary(path))


def _replace(temporary: Path, path: Path) -> None:
    """Give a file its name; on Windows, where a file that somebody reads can't be replaced, after up to two seconds."""
    for pause in PAUSES_S if ON_WINDOWS else ():
        try:
            os.replace(temporary, path)
        except PermissionError:
            time.sleep(pause)
        else:
            return
    os.replace(temporary, path)


def write_atomic(path: str | Path, content: bytes | str) -> None:
    """Write `content` to a file atomically; text is encoded as UTF-8 and its line ends are kept."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


def write_picture(path: str | Path, picture: Any) -> None:
    """Write a `PIL.Image` atomically, in the format of the path's ending if Pillow writes it, or else as PNG.

    It is encoded in memory first, because the encoders of some formats take no notice of a disk that is full.
    """
    from PIL import Image

    content = io.BytesIO()
    named = Image.registered_extensions().get(Path(path).suffix.lower())
    picture.save(content, format=named if named in Image.SAVE else "PNG")
    write_atomic(path, content.getvalue())
