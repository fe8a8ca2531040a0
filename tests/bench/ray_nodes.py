"""A cluster of Ray's on this machine: nodes that are processes, each of which can be killed."""

import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
START = (sys.executable, "-m", "ray.scripts.scripts", "start", "--block", "--disable-usage-stats")
START += ("--node-ip-address=127.0.0.1", "--num-cpus=1")
ATTEMPTS, STORE = 3, 80 * 2**20
"""How often a node is started, and the bytes of its object store: Ray takes no fewer than 75 MiB."""


def _environment(home: Path) -> dict[str, str]:
    """The environment of a node, which neither reads nor writes the user's home: Ray keeps its tokens there."""
    inherited = {name: value for name, value in os.environ.items() if not name.startswith("RAY_AUTH_")}
    return inherited | {"PYTHONPATH": str(ROOT), "HOME": str(home), "RAY_USAGE_STATS_ENABLED": "0"}


class Nodes:
    """The head, with one processor, and what is added to it."""

    def __init__(self, **environment: str) -> None:
        self._home = Path(tempfile.mkdtemp(prefix="ray", dir="/tmp"))  # a socket's name has 107 letters at most
        self._groups: list[int] = []
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.address = f"127.0.0.1:{port}"
        self._start("--head", f"--port={port}", f"--temp-dir={self._home}", "--include-dashboard=false", **environment)

    def add(self, **environment: str) -> int:
        """A node more with one processor, told by what `kill` takes."""
        return self._start(f"--address={self.address}", **environment)

    def kill(self, node: int) -> None:
        """End a node and all that it does, without a word."""
        self._groups.remove(node)
        with suppress(ProcessLookupError):
            os.killpg(node, signal.SIGKILL)

    def stop(self) -> None:
        """End all."""
        for node in reversed(self._groups.copy()):
            self.kill(node)
        shutil.rmtree(self._home, ignore_errors=True)

    def _start(self, *options: str, **environment: str) -> int:
        """Start a node; one that does not come up, as Ray's sometimes don't on a busy machine, is started again."""
        for attempt in range(ATTEMPTS):
            said = self._home / f"node{len(self._groups)}-{attempt}.txt"
            with open(said, "w") as file:
                process = subprocess.Popen(
                    [*START, f"--object-store-memory={STORE}", *options],
                    env={**_environment(self._home), **environment},
                    start_new_session=True,
                    stdout=file,
                    stderr=file,
                )
            self._groups.append(process.pid)
            while process.poll() is None:
                if "Ray runtime started" in said.read_text():
                    return process.pid
                time.sleep(0.1)
            self.kill(process.pid)
        raise RuntimeError(said.read_text())
