"""Tests of processes that end with their parent."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

from thalweg.core.parent_process import ending_with_parent


def running(process: Path) -> bool:
    """Whether the process of a folder of /proc runs; one that ended may still wait for its parent there."""
    try:
        return (process / "stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc")
def test_workers_end_with_their_parent(tmp_path: Path):
    """The parent is killed while its worker sleeps."""
    code = (
        "import os, signal, time, multiprocessing\n"
        "from concurrent.futures import ProcessPoolExecutor\n"
        "from thalweg.core.parent_process import end_with_parent\n"
        "if __name__ == '__main__':\n"
        "    pool = ProcessPoolExecutor(1, multiprocessing.get_context('spawn'), end_with_parent)\n"
        "    print(pool.submit(os.getpid).result(), flush=True)\n"
        "    pool.submit(time.sleep, 600)\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    assert_child_ends(code, tmp_path)


@pytest.mark.skipif(ending_with_parent(["true"]) == ["true"], reason="there is no setpriv of util-linux")
def test_a_command_ends_with_the_process_that_started_it(tmp_path: Path):
    code = (
        "import os, signal, subprocess\n"
        "from thalweg.core.parent_process import ending_with_parent\n"
        "command = ending_with_parent(['sh', '-c', 'echo $$; exec sleep 600'])\n"
        "process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)\n"
        "print(process.stdout.readline(), flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    assert_child_ends(code, tmp_path)


def assert_child_ends(code: str, folder: Path) -> None:
    """Assert that the process whose number a program prints ends when that program is killed."""
    (folder / "parent.py").write_text(code)
    with open(folder / "printed", "w") as printed:  # a pipe would stay open as long as the child
        subprocess.run([sys.executable, str(folder / "parent.py")], stdout=printed, stderr=printed, check=False)
    child = Path("/proc") / (folder / "printed").read_text().split()[0]
    deadline = time.monotonic() + 30
    while running(child) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not running(child)
