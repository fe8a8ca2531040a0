"""Tests that a file is always the old one or the new one, whatever happens while it is written."""

import errno
import io
import os
import signal
import stat
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import thalweg
from thalweg.core import atomic_io
from thalweg.core.atomic_io import (
    atomic_path,
    disk_errors_name,
    is_disk_error,
    is_temporary,
    without_temporaries,
    write_atomic,
    write_picture,
)

FOLDERS = {
    "datasets/draft.py",
    "train/folder/checkpoint.py",
    "bench/execute/cluster/run_archive.py",
    "bench/report/report.py",
    "bench/results/outdated.py",
}
"""Modules that move complete folders into place, or runs that are outdated aside."""


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def umask():
    """Yield `os.umask` and restore the umask afterwards."""
    before = os.umask(0)
    os.umask(before)
    yield os.umask
    os.umask(before)


@pytest.mark.parametrize(("content", "expected"), [(b"\x00\r\n", b"\x00\r\n"), ("ö\n", "ö\n".encode())])
def test_the_content_is_written_unchanged(tmp_path, content, expected):
    write_atomic(tmp_path / "new" / "folder" / "file.txt", content)
    assert (tmp_path / "new" / "folder" / "file.txt").read_bytes() == expected
    assert names(tmp_path / "new" / "folder") == ["file.txt"]


def test_the_old_file_stays_until_the_block_ends(tmp_path):
    path = tmp_path / "file.npz"
    path.write_text("old")
    with atomic_path(path) as draft:
        draft.write_text("new")
        assert path.read_text() == "old"
        assert draft.parent == path.parent and draft.suffix == path.suffix
    assert path.read_text() == "new"
    assert names(tmp_path) == ["file.npz"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_an_error_while_writing_keeps_the_old_file_and_no_other(tmp_path, error):
    path = tmp_path / "file.txt"
    path.write_text("old")
    with pytest.raises(error), atomic_path(path) as draft:
        draft.write_text("ha")
        raise error
    assert path.read_text() == "old" and names(tmp_path) == ["file.txt"]


@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_a_disk_error_keeps_the_old_file_and_no_other(tmp_path, monkeypatch, step):
    path = tmp_path / "file.txt"
    path.write_text("old")

    def full(*_):
        raise OSError("disk full")

    monkeypatch.setattr(os, step, full)
    with pytest.raises(OSError, match="disk full"):
        write_atomic(path, "new")
    assert path.read_text() == "old" and names(tmp_path) == ["file.txt"]


FULL = (errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("named", [False, True], ids=["a write fails", "the temporary file cannot be opened"])
def test_the_error_of_a_full_disk_names_the_file_that_was_asked_for(tmp_path, named):
    path = tmp_path / "file.txt"
    with pytest.raises(OSError) as raised, atomic_path(path) as draft:
        draft.write_text("ha")
        raise OSError(*FULL, str(draft)) if named else OSError(*FULL)
    assert (raised.value.errno, raised.value.filename) == (errno.ENOSPC, str(path))
    assert str(raised.value) == f"[Errno {errno.ENOSPC}] No space left on device: '{path}'"
    assert names(tmp_path) == []


@pytest.mark.parametrize(
    "error", [OSError("no number"), OSError(errno.EPIPE, "Broken pipe"), OSError(*FULL, "another file"), ValueError()]
)
def test_errors_of_something_else_keep_what_they_name(error):
    with pytest.raises(type(error)) as raised, disk_errors_name("file.txt"):
        raise error
    assert raised.value is error


@pytest.mark.parametrize(("number", "of_disk"), [(errno.ENOSPC, True), (errno.EIO, True), (errno.EPIPE, False)])
def test_errors_of_the_disk_are_told_by_their_number(number, of_disk):
    assert is_disk_error(OSError(number, "")) is of_disk
    assert not is_disk_error(ValueError(number))


@pytest.mark.parametrize(
    ("name", "format"),
    [("a.png", "PNG"), ("a.JPG", "JPEG"), ("a.webp", "WEBP"), ("without", "PNG"), ("a.psd", "PNG"), ("a.xpm", "PNG")],
)
def test_a_picture_has_the_format_of_its_name(tmp_path, name, format):
    pixels = np.full((8, 8, 3), 60, np.uint8)
    write_picture(tmp_path / name, Image.fromarray(pixels))
    with Image.open(io.BytesIO((tmp_path / name).read_bytes())) as picture:
        assert picture.format == format
        assert abs(np.asarray(picture).astype(int) - pixels).max() <= 2


def test_the_content_is_synced_before_the_rename(tmp_path, monkeypatch):
    path, events = tmp_path / "file.txt", []
    fsync, replace = os.fsync, os.replace

    def synced(descriptor: int) -> None:
        events.append(("fsync", os.fstat(descriptor).st_size))
        fsync(descriptor)

    def replaced(one, other) -> None:
        events.append(("replace", Path(other).name))
        replace(one, other)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", replaced)
    write_atomic(path, b"12345")
    assert events == [("fsync", 5), ("replace", "file.txt")]


@pytest.mark.parametrize("mask", [0o022, 0o077, 0o002])
def test_permissions_follow_the_umask(tmp_path, umask, mask):
    umask(mask)
    (tmp_path / "plain.txt").write_text("")
    write_atomic(tmp_path / "atomic.txt", "")
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("plain.txt", "atomic.txt")]
    assert modes == [0o666 & ~mask] * 2


def test_a_block_that_writes_nothing_is_an_error(tmp_path):
    with pytest.raises(FileNotFoundError), atomic_path(tmp_path / "file.txt"):
        pass
    assert names(tmp_path) == []


def test_concurrent_writers_leave_the_complete_file_of_one_of_them(tmp_path):
    path, size = tmp_path / "file.bin", 200_000
    contents = [bytes([letter]) * size for letter in b"abcdefgh"]
    begin, seen = threading.Barrier(len(contents)), []

    def write(content: bytes) -> None:
        begin.wait()
        for _ in range(5):
            write_atomic(path, content)
            seen.append(path.read_bytes())

    threads = [threading.Thread(target=write, args=(content,)) for content in contents]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(seen) == 5 * len(contents) and set(seen) <= set(contents)
    assert names(tmp_path) == ["file.bin"]


HALF = """
import os, signal, sys
from thalweg.core import atomic_io
from thalweg.core.atomic_io import atomic_path
with atomic_path(sys.argv[1]) as draft:
    draft.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_file_left_by_a_killed_process_does_no_harm(tmp_path):
    path = tmp_path / "file.txt"
    path.write_text("old")
    killed = subprocess.run([sys.executable, "-c", HALF, str(path)], check=False)
    assert killed.returncode == -signal.SIGKILL
    assert path.read_text() == "old"
    (left,) = set(names(tmp_path)) - {"file.txt"}
    assert left.startswith(".file.") and ".part" in left, "hidden, and matched by no lookup"
    write_atomic(path, "new")
    assert path.read_text() == "new" and names(tmp_path) == sorted([left, "file.txt"])


def test_only_the_known_modules_rename_files():
    package = Path(thalweg.__file__).parent
    words = ("os.replace", "mkstemp", "NamedTemporaryFile", '.part"', ".part{")
    found = {
        path.relative_to(package).as_posix()
        for path in package.rglob("*.py")
        if any(word in path.read_text(encoding="utf-8") for word in words)
    }
    assert found == {"core/atomic_io.py", *FOLDERS}


@pytest.mark.parametrize(("busy", "left"), [(2, "new"), (9, "old")])
def test_a_file_that_is_read_on_windows_is_replaced_a_little_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, busy: int, left: str
):
    (path := tmp_path / "file.txt").write_text("old")
    attempts, replace = iter(range(100)), os.replace

    def refuse_at_first(old: Path, new: Path) -> None:
        if next(attempts) < busy:
            raise PermissionError(13, "being used by another process")
        replace(old, new)

    monkeypatch.setattr(os, "replace", refuse_at_first)
    monkeypatch.setattr(atomic_io, "ON_WINDOWS", True)
    monkeypatch.setattr(atomic_io, "PAUSES_S", (0.0,) * 3)
    if left == "old":
        with pytest.raises(PermissionError):
            write_atomic(path, "new")
    else:
        write_atomic(path, "new")
    assert path.read_text() == left and names(tmp_path) == ["file.txt"]


def test_the_temporary_files_of_killed_processes_are_told_from_all_others(tmp_path):
    for name in ("file.txt", "without", "two.dots.npz"):
        with pytest.raises(ValueError), atomic_path(tmp_path / name) as draft:
            assert is_temporary(draft) and draft.name != name
            raise ValueError
    others = [tmp_path / name for name in ("a.part.csv", ".a.part.csv", ".a.1.part.csv", ".lock", "b.npz", ".part")]
    assert not any(map(is_temporary, others))
    assert without_temporaries([tmp_path / ".a.0123456789abcdef.part.csv", *others]) == sorted(others)
