"""Ownership of folders: a folder belongs to the run, suite or study whose record lies in it.

All kinds of folders in which an interrupted command resumes use this module. While a command writes to a folder it
holds the folder's lock, so that a second one, such as the same command started twice, is refused: both would write to
the same files.
"""

import errno
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from thalweg.core.atomic_io import without_temporaries, write_atomic
from thalweg.core.notices import notice

MAX_NAMED = 4
"""Maximum number of differences, or of files, that a message names."""
CHECKPOINT = "checkpoint.safetensors"
"""File from which the training of an encoder, or of a finder of water, resumes."""
DEVICE, CPU = "device", "cpu"
"""Key of a record for the kind of device that is learnt on, and the kind that a record without it stands for."""
LOCK = ".lock"
"""File of a folder that a command holds; the system frees it when the process ends, however it ends."""
WAIT_S = 0.5
"""Time in which a command that is just ending may free its folder, in seconds."""
NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP)
"""Errors of file systems without locks, such as network drives that are mounted without them."""


def nearest_existing(path: Path) -> Path:
    """Return the path, or the nearest of the folders above it that exists."""
    return next(each for each in (path, *path.absolute().parents) if each.exists())


@dataclass(frozen=True)
class FolderKind:
    """A kind of folder, and the error that is raised for folders of another kind."""

    owner: str
    """Name of the owner in messages: `run`, `suite`, ..."""
    record: str
    """Name of the file that describes the owner."""
    error: type[ValueError]
    ignores_hidden: bool = False
    """Whether a folder with nothing but hidden files counts as empty."""

    def is_new(self, folder: Path) -> bool:
        """Return whether a new owner can start in the folder: it does not exist yet, or is empty.

        What a command that was killed in its first write left, a temporary file, does not count. Raises the kind's
        error for a path that is not a folder, and for a folder with other files but no record.
        """
        if (folder / self.record).exists():
            return False
        existing = nearest_existing(folder)
        if not existing.is_dir():
            raise self.error(f"{existing} is not a folder; give a new folder for the {self.owner}")
        found = without_temporaries(folder.glob("[!.]*" if self.ignores_hidden else "*"))
        names = [path.name for path in found if path.name != LOCK]
        if names:
            raise self.error(
                f"{folder} holds {', '.join(names[:MAX_NAMED])}{_more(names, ' and {} more')}, but no {self.record}:"
                f" it is not the folder of a {self.owner}. Give a new or empty one, such as {folder / 'NAME'}"
            )
        return True

    def require_same(self, folder: Path, recorded: Mapping[str, Any], requested: Mapping[str, Any]) -> None:
        """Raise the kind's error, naming the first differences, unless the folder's owner is the requested one."""
        found = list(differences(recorded, requested))
        if found:
            named = "; ".join(found[:MAX_NAMED])
            raise self.error(
                f"{folder} belongs to another {self.owner}: {named}{_more(found, '; and {} more')}."
                " Choose another folder."
            )

    def require_same_file(self, folder: Path, recorded: Mapping[str, Any], requested: Mapping[str, Any]) -> None:
        """Raise the kind's error if the input file of the folder's owner has changed since then.

        Both records have the keys `file`, its name, and `content`, the hash of its content, or neither.
        """
        if recorded.get("file") == requested.get("file") and recorded.get("content") != requested.get("content"):
            raise self.error(
                f"{requested['file']} has changed since the {self.owner} in {folder} was started: its content was"
                f" {recorded.get('content')} and is {requested['content']} now. Restore the old file to resume, or"
                " choose another folder."
            )

    @contextmanager
    def locked(self, folder: Path) -> Iterator[None]:
        """Hold the folder, which is created if it does not exist, while the block writes to it.

        Raises the kind's error if another command holds it. Where the file system has no locks, a notice says so, and
        nothing is refused.
        """
        from filelock import FileLock, Timeout  # not in an installation that only flies

        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / LOCK, timeout=WAIT_S)
        try:
            lock.acquire()
        except Timeout:
            raise self.error(
                f"another command is writing to {folder}: wait until it has ended, or give another folder for the"
                f" {self.owner}"
            ) from None
        except OSError as error:
            if error.errno not in NO_LOCKS:
                raise
            notice(f"{folder} is on a file system without locks: start no second command in it")
        try:
            yield
        finally:
            with suppress(OSError):  # Windows removes it when it is freed
                (folder / LOCK).unlink()
            lock.release()

    def write_json(self, folder: Path, record: Mapping[str, Any]) -> None:
        """Write the record as JSON, atomically."""
        write_atomic(folder / self.record, json.dumps(record, indent=2) + "\n")


def differences(recorded: Mapping[str, Any], requested: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """Yield each key whose value differs, with both values; keys of nested mappings are joined by dots."""
    for key in {**recorded, **requested}:
        name = f"{prefix}{key}"
        there, here = recorded.get(key), requested.get(key)
        if isinstance(there, Mapping) and isinstance(here, Mapping):
            yield from differences(there, here, f"{name}.")
        elif key not in requested or key not in recorded:
            there, here = (_shown(key, record) for record in (recorded, requested))
            yield f"{name} is {there} there and {here} here"
        elif there != here:
            yield f"{name} is {there!r} there and {here!r} here"


def _shown(key: str, record: Mapping[str, Any]) -> str:
    """Return a record's value as text for a message, for a mapping only that it is present."""
    if key not in record:
        return "absent"
    return "present" if isinstance(record[key], Mapping) else repr(record[key])


def _more(items: list[str], words: str) -> str:
    return words.format(len(items) - MAX_NAMED) if len(items) > MAX_NAMED else ""
