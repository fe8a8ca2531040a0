"""Tests of the lock of folders: a second command is refused, and whoever ends, however it ends, leaves none."""

import errno
import signal
import subprocess
import sys
from pathlib import Path

import filelock
import pytest

from thalweg.core.run_folder import LOCK, FolderKind

KIND = FolderKind("suite", "suite.json", ValueError)
HOLDER = """
import sys, time
from pathlib import Path
from thalweg.core.run_folder import FolderKind
with FolderKind("suite", "suite.json", ValueError).locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""


def fail_to_lock(monkeypatch: pytest.MonkeyPatch, error: OSError) -> None:
    """Let every lock fail with an error."""

    def acquire(_: object) -> None:
        raise error

    monkeypatch.setattr(filelock.FileLock, "acquire", acquire)


def test_a_folder_that_another_process_holds_is_refused_until_it_is_killed(tmp_path: Path):
    folder = tmp_path / "new" / "results"
    with subprocess.Popen([sys.executable, "-c", HOLDER, str(folder)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "held\n"
        try:
            words = r"another command is writing to .*results: wait until it has ended"
            with pytest.raises(ValueError, match=words), KIND.locked(folder):
                pass
        finally:
            process.send_signal(signal.SIGKILL)
    with KIND.locked(folder):
        assert (folder / LOCK).exists()


def test_a_folder_is_freed_without_a_trace_also_by_an_error(tmp_path: Path):
    with pytest.raises(KeyError), KIND.locked(tmp_path):
        raise KeyError
    assert list(tmp_path.iterdir()) == []
    with KIND.locked(tmp_path):
        pass


def test_a_lock_that_a_killed_command_left_is_no_file_of_somebody_else(tmp_path: Path):
    (tmp_path / LOCK).touch()
    assert KIND.is_new(tmp_path)


def test_a_folder_on_a_file_system_without_locks_is_used_with_a_notice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    fail_to_lock(monkeypatch, OSError(errno.ENOLCK, "No locks available"))
    with KIND.locked(tmp_path):
        (tmp_path / "suite.json").touch()
    assert [path.name for path in tmp_path.iterdir()] == ["suite.json"]
    told = f"{tmp_path} is on a file system without locks: start no second command in it\n"
    assert capsys.readouterr().err == told


def test_other_errors_of_a_lock_are_raised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    fail_to_lock(monkeypatch, OSError(errno.EACCES, "Permission denied"))
    with pytest.raises(PermissionError, match="Permission denied"), KIND.locked(tmp_path):
        pytest.fail("the folder was used")


KILLED = """
import os, sys
from pathlib import Path
from thalweg.core.run_folder import FolderKind
os.replace = lambda *_: os._exit(9)
kind = FolderKind("suite", "suite.json", ValueError)
with kind.locked(Path(sys.argv[1])):
    kind.write_json(Path(sys.argv[1]), {})
"""


def test_a_folder_whose_command_was_killed_in_its_first_write_is_new(tmp_path: Path):
    assert subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)]).returncode == 9
    assert len([path for path in tmp_path.iterdir() if path.name != LOCK]) == 1
    assert KIND.is_new(tmp_path)
    (tmp_path / ".hidden").touch()
    with pytest.raises(ValueError, match=r"holds \.hidden, but no suite\.json"):
        KIND.is_new(tmp_path)
