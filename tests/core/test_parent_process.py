"""Tests of processes that end with their parent."""

import subprocess
import sys
import time
from pathlib import Path

import pytest


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
    (tmp_path / "parent.py").write_text(code)
    with open(tmp_path / "printed", "w") as printed:  # a pipe would stay open as long as the worker
        subprocess.run([sys.executable, str(tmp_path / "parent.py")], stdout=printed, stderr=printed, check=False)
    worker = Path("/proc") / (tmp_path / "printed").read_text().split()[0]
    deadline = time.monotonic() + 30
    while running(worker) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not running(worker)
