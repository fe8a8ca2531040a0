"""How does this process join a cluster of Ray's? Or what keeps it from it, within seconds.

Ray itself waits for minutes where nobody answers, and for ever where somebody else does. So that an address is tried by
a process of its own first, which is given up in time.
"""

import importlib
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from thalweg.bench.csv_files import ResultsError

CONNECT_S, ANSWER_S = 5.0, 45.0
"""How long the head of a cluster may take to be reached, and to answer."""
START = "start one with `ray start --head`, and `ray start --address=HOST:6379` on the other nodes"
TRY = """
import sys, ray
try:
    ray.init(address=sys.argv[1], log_to_driver=False, logging_level="CRITICAL")
except Exception as error:
    print(error)
    sys.exit(3)
"""


def check_address(address: str) -> None:
    """Raise `ResultsError` for an address of a kind that is not taken."""
    if address.startswith("ray://"):
        raise ResultsError(
            f"--cluster {address}: Ray's client is not supported. Run the command on a node of the cluster, with"
            " --cluster auto; `ray start --address=HOST:6379 --num-cpus=0` makes this machine one that does no runs"
        )
    if address != "auto" and _host_and_port(address) is None:
        raise ResultsError(f"--cluster {address}: give auto, or the head's address as HOST:PORT, such as 10.0.0.1:6379")


def import_ray() -> Any:
    """Ray; raises `ResultsError` where it is not installed."""
    try:
        return importlib.import_module("ray")
    except ImportError as error:
        raise ResultsError("--cluster needs Ray: pip install 'thalweg[cluster]'") from error


@contextmanager
def joined(address: str) -> Iterator[Any]:
    """Ray, joined to the cluster inside; whatever this process has asked of it ends with the block.

    Raises `ResultsError` for a cluster that can't be joined, saying why.
    """
    ray = import_ray()
    _require_reachable(address)
    _require_answer(address)
    told_to_end = signal.getsignal(signal.SIGTERM)
    try:
        ray.init(address=address, log_to_driver=False, logging_level="CRITICAL")
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, told_to_end)  # Ray has put its own handler there
        yield ray
    finally:
        ray.shutdown()


def _host_and_port(address: str) -> tuple[str, int] | None:
    host, _, port = address.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    return (host, int(port)) if host and "/" not in host and port.isdigit() and int(port) < 2**16 else None


def _require_reachable(address: str) -> None:
    """Raise `ResultsError` unless somebody listens there; where a cluster of this machine lies only Ray knows."""
    place = _host_and_port(address)
    if place is None:
        return
    try:
        socket.create_connection(place, timeout=CONNECT_S).close()
    except OSError as error:
        raise ResultsError(f"no cluster at {address} ({error}); {START}") from error


def _require_answer(address: str) -> None:
    """Raise `ResultsError` unless a process of this machine can join."""
    try:
        tried = subprocess.run([sys.executable, "-c", TRY, address], capture_output=True, text=True, timeout=ANSWER_S)
    except subprocess.TimeoutExpired as error:
        raise ResultsError(
            f"the cluster at {address} has not answered in {ANSWER_S:.0f} s. Is this the port of the head (`ray start`"
            " prints it), and this machine one of the nodes (`ray start --address=HOST:6379`)?"
        ) from error
    if tried.returncode:
        said = " ".join((tried.stdout or tried.stderr).split())
        raise ResultsError(f"the cluster at {address} can't be joined: {said}; {START}")
