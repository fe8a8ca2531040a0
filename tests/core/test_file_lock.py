"""Tests that a file is held by one process at a time, and changed without a lock where there is none."""

import errno
import subprocess
import sys
import threading
from pathlib import Path

import filelock
import pytest

from thalweg.core.file_lock import held

HOLDER = """
import sys, time
from pathlib import Path
from thalweg.core.file_lock import held
with held(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""


def test_a_file_that_another_process_holds_is_waited_for_until_it_is_killed(tmp_path: Path):
    path, got = tmp_path / "new" / "table.csv", threading.Event()

    def hold() -> None:
        with held(path):
            got.set()

    with subprocess.Popen([sys.executable, "-c", HOLDER, str(path)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "held\n"
        waiting = threading.Thread(target=hold)
        waiting.start()
        assert not got.wait(0.3)
        process.kill()
    assert got.wait(60)
    waiting.join()


def test_a_file_system_without_locks_is_used_without_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def refuse(_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(filelock.FileLock, "acquire", refuse)
    with held(tmp_path / "table.csv"):
        (tmp_path / "table.csv").touch()
    assert [path.name for path in tmp_path.iterdir()] == ["table.csv"]


def test_other_errors_of_a_lock_are_raised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def refuse(_: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(filelock.FileLock, "acquire", refuse)
    with pytest.raises(PermissionError), held(tmp_path / "table.csv"):
        pytest.fail("the file was changed")
