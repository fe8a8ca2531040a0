"""Connection of this process to a Ray cluster, or the reason why there is none, within a minute.

Ray itself waits for minutes if nobody answers, and forever if another program does. An address is therefore tried by a
separate process first, which is stopped in time.
"""

import importlib
import importlib.util
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from thalweg.bench.csv_files import ResultsError
from thalweg.core.extras import how_to_install

CONNECT_S, ANSWER_S = 5.0, 45.0
"""Time limits for reaching the head of a cluster, and for its answer."""
START = "start one with `ray start --head`, and `ray start --address=HOST:6379` on the other nodes"
AUTH_MODE = "RAY_AUTH_MODE"
"""Environment variable that decides whether Ray sends a token; with an explicit address it does so only if told to."""
NO_TOKEN = ("InvalidAuthToken", "Token authentication is enabled")
"""Words by which Ray reports that a cluster requires a token and did not get the right one."""
TRY = """
import sys, ray
try:
    ray.init(address=sys.argv[1], log_to_driver=False, logging_level="CRITICAL")
except Exception as error:
    print(error)
    sys.exit(3)
"""


def check_address(address: str) -> None:
    """Raise `ResultsError` for an address of an unsupported kind."""
    if address.startswith("ray://"):
        raise ResultsError(
            f"--cluster {address}: Ray's client is not supported. Run the command on a node of the cluster, with"
            " --cluster auto; `ray start --address=HOST:6379 --num-cpus=0` makes this machine a node without runs"
        )
    if address != "auto" and _host_and_port(address) is None:
        raise ResultsError(f"--cluster {address}: give auto, or the head's address as HOST:PORT, such as 10.0.0.1:6379")


def check_ray() -> None:
    """Raise `ResultsError` if Ray is not installed. Ray is not imported: it reads its environment when it is."""
    if importlib.util.find_spec("ray") is None:
        raise ResultsError(f"--cluster needs Ray: {how_to_install('cluster')}")


@contextmanager
def ray_connection(address: str) -> Iterator[Any]:
    """The `ray` module, connected to a cluster inside the block; all tasks of this process end with the block.

    A cluster that requires a token gets the one that Ray finds on this machine. Raises `ResultsError` that says why a
    cluster cannot be joined.
    """
    check_ray()
    _require_reachable(address)
    with _environment(_required_environment(address)):
        ray = importlib.import_module("ray")
        previous_handler = signal.getsignal(signal.SIGTERM)
        try:
            ray.init(address=address, log_to_driver=False, logging_level="CRITICAL")
            if threading.current_thread() is threading.main_thread():
                signal.signal(signal.SIGTERM, previous_handler)  # Ray has replaced the handler
            yield ray
        finally:
            ray.shutdown()


@contextmanager
def _environment(changes: dict[str, str]) -> Iterator[None]:
    """Environment variables that are set inside the block."""
    before = {name: os.environ.get(name) for name in changes}
    os.environ.update(changes)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.update({name: value})


def _host_and_port(address: str) -> tuple[str, int] | None:
    host, _, port = address.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    return (host, int(port)) if host and "/" not in host and port.isdigit() and int(port) < 2**16 else None


def _require_reachable(address: str) -> None:
    """Raise `ResultsError` unless a program listens at the address; that of `auto` is known to Ray alone."""
    host_and_port = _host_and_port(address)
    if host_and_port is None:
        return
    try:
        socket.create_connection(host_and_port, timeout=CONNECT_S).close()
    except OSError as error:
        raise ResultsError(f"no cluster at {address} ({error}); {START}") from error


def _required_environment(address: str) -> dict[str, str]:
    """Return the environment variables with which a process of this machine can join; raises `ResultsError` if none
    can.
    """
    output = _try(address, {})
    if output is None:
        return {}
    if not any(words in output for words in NO_TOKEN):
        raise ResultsError(f"the cluster at {address} can't be joined: {output}; {START}")
    if AUTH_MODE not in os.environ and _try(address, {AUTH_MODE: "token"}) is None:
        return {AUTH_MODE: "token"}
    raise ResultsError(
        f"the cluster at {address} requires a token, and this machine has none or another one. Put the token of the"
        " cluster's head (`ray get-auth-token` prints it) into the variable RAY_AUTH_TOKEN or the file"
        f" ~/.ray/auth_token, and set {AUTH_MODE}=token or leave it unset"
    )


def _try(address: str, environment: dict[str, str]) -> str | None:
    """Return None if a new process can join with these environment variables, else Ray's error message.

    Raises `ResultsError` if there is no answer in time.
    """
    command = [sys.executable, "-c", TRY, address]
    try:
        tried = subprocess.run(
            command, capture_output=True, text=True, timeout=ANSWER_S, env={**os.environ, **environment}
        )
    except subprocess.TimeoutExpired as error:
        raise ResultsError(
            f"the cluster at {address} has not answered in {ANSWER_S:.0f} s. Is this the port of the head (`ray start`"
            " prints it), and this machine one of the nodes (`ray start --address=HOST:6379`)?"
        ) from error
    if not tried.returncode:
        return None
    refusal = next((words for words in NO_TOKEN if words in tried.stderr), "")
    return " ".join(((tried.stdout or tried.stderr) + refusal).split())
