"""Drafts of data sets: folders that take their name when all flights are written, and from which an interrupted
command resumes.

A draft is a hidden folder beside the data set. Each finished flight has a record in it, which is written last and at
once, so that a command that was killed at any moment has lost no flight that it had finished.
"""

import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from thalweg.core.atomic_io import ON_WINDOWS, disk_errors_name, is_temporary, without_temporaries, write_atomic
from thalweg.core.plugins.source import text_hash
from thalweg.core.run_folder import LOCK, MAX_NAMED, FolderKind, differences
from thalweg.datasets.errors import DatasetError

RECORDING = FolderKind("recording", "recording.json", DatasetError, ignores_hidden=True)
JOURNAL = "journal"
"""Folder of a draft, of the records of finished flights, and of files that the data set does not need."""
FLIGHT, CONTENT = "flight", "content"
"""Keys of a finished flight's file: what was noted of the flight, and the hash of that as JSON."""


class Draft:
    """The folder in which a data set is written, and its journal."""

    def __init__(self, folder: Path, name: Path) -> None:
        """`name` is the folder that errors name, which `folder` becomes."""
        self.folder, self.name = folder, name
        self.records: list[dict[str, Any]] = finished_flights(name)
        """What was noted of each finished flight, in their order."""

    def note(self, record: dict[str, Any]) -> None:
        """Count a flight, all files of which are written, as finished; `record` is plain data."""
        noted = json.dumps({FLIGHT: record, CONTENT: text_hash(json.dumps(record))})
        write_atomic(self.folder / JOURNAL / f"{len(self.records):06d}.json", noted)
        self.records.append(record)


def draft_folder(path: Path) -> Path:
    """Return the folder in which the data set of `path` is written."""
    whole = path.absolute()  # `.` has no name
    return whole.with_name(f".{whole.name}.part")


def finished_flights(path: Path) -> list[dict[str, Any]]:
    """Return what was noted of the flights that an interrupted recording of `path` has finished.

    Raises `DatasetError` for a damaged note.
    """
    journal = draft_folder(path) / JOURNAL
    notes = [(file, _read(file)) for file in without_temporaries(journal.glob("*.json"))]
    for file, note in notes:
        flight = note.get(FLIGHT)
        if not isinstance(flight, dict) or text_hash(json.dumps(flight)) != note.get(CONTENT):
            why = "is damaged, or of an earlier version: it lacks the hash of its content"
            raise DatasetError(f"{file} {why}{_advice_on_damage(file)}")
    return [note[FLIGHT] for _, note in notes]


def check_new(path: Path) -> None:
    """Raise `DatasetError` unless `path` is free or an empty folder that can be replaced."""
    if not path.absolute().name:
        raise DatasetError(f"{path} is no folder for recordings: name a new one")
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise DatasetError(f"{path} is there already: name a new folder for the recordings")
    if os.path.ismount(path.absolute()):
        raise DatasetError(f"{path} is a mount point, which no finished recording can replace: name a folder in it")


@contextmanager
def draft_of(path: Path, about: Mapping[str, Any]) -> Iterator[Draft]:
    """Yield the draft of a data set, with the flights that an interrupted recording of the same finished.

    When the block ends without an error, the draft becomes `path`. Otherwise it stays if a flight is finished, and is
    removed if none is. `about` is plain data that says what is recorded.

    Raises `DatasetError` unless `path` is free or an empty folder, and for a draft of another recording or one to
    which another command writes; `OSError`, with the name of `path`, for a disk that takes no more.
    """
    check_new(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    folder = draft_folder(path)
    try:
        with RECORDING.locked(folder), disk_errors_name(path):
            check_new(path)  # the command that held the lock until now may have finished
            _begin(folder, json.loads(json.dumps(about)))
            try:
                yield Draft(folder, path)
            except BaseException:
                if not finished_flights(path):
                    _remove_all_but_lock(folder)
                raise
            if not ON_WINDOWS:
                _take_name(folder, path)
    except BaseException as error:
        with suppress(OSError):  # where flights are finished, it is not empty
            folder.rmdir()
        if isinstance(error, FileNotFoundError):  # its draft took its name while this command waited for the lock
            check_new(path)
        raise
    if ON_WINDOWS:  # which renames no folder with an open file, such as a lock that is held
        _take_name(folder, path)


def _take_name(folder: Path, path: Path) -> None:
    """Rename a draft that is finished, and remove what is no part of the data set."""
    path = path.absolute()  # `.` can be neither removed nor replaced
    if path.exists():
        path.rmdir()
    os.replace(folder, path)
    shutil.rmtree(path / JOURNAL, ignore_errors=True)  # not before: a command that is killed here has lost nothing
    for name in (RECORDING.record, LOCK):
        (path / name).unlink(missing_ok=True)


def _begin(folder: Path, about: dict[str, Any]) -> None:
    """Write the record of a new draft, or check that an interrupted one is the same; remove unfinished files."""
    if RECORDING.is_new(folder):
        RECORDING.write_json(folder, about)
    else:
        _require_same(folder, about)
    for unfinished in filter(is_temporary, folder.rglob(".*")):
        unfinished.unlink(missing_ok=True)


def _require_same(folder: Path, about: dict[str, Any]) -> None:
    """Raise `DatasetError` unless the draft of an interrupted recording is of the same recording."""
    recorded = _read(folder / RECORDING.record)
    before = recorded.get("files")
    for what, now in about.get("files", {}).items():
        if isinstance(before, dict) and isinstance(then := before.get(what), dict):
            RECORDING.require_same_file(folder, then, now)
    found = list(differences(recorded, about))
    if found:
        raise DatasetError(
            f"{folder} has flights of an interrupted recording with other options: {'; '.join(found[:MAX_NAMED])}."
            " Give those options to resume it, remove that folder, or name another one for the recordings"
        )


def _read(file: Path) -> dict[str, Any]:
    """Return the plain data of a file of a draft; raises `DatasetError` for a damaged one."""
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:  # also for bytes that are no text
        raise DatasetError(f"{file} is damaged ({error}){_advice_on_damage(file)}") from error
    if not isinstance(data, dict):
        raise DatasetError(
            f"{file} is damaged: it holds a {type(data).__name__}, not a mapping{_advice_on_damage(file)}"
        )
    return data


def _advice_on_damage(file: Path) -> str:
    """Return what to do about a damaged file of a draft."""
    draft = next(folder for folder in file.parents if folder.name != JOURNAL)
    return f": remove the folder {draft}, which an interrupted recording left, to record anew, or name another --out"


def _remove_all_but_lock(folder: Path) -> None:
    """Remove what a draft without flights holds."""
    for entry in folder.iterdir():
        if entry.is_dir():
            shutil.rmtree(entry, ignore_errors=True)
        elif entry.name != LOCK:
            entry.unlink(missing_ok=True)
