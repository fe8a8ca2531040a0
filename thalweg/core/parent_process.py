"""Processes that end with the process that started them, however that one ended."""

import multiprocessing
import os
import shutil
import subprocess
import threading
from collections.abc import Sequence
from functools import cache
from multiprocessing.connection import wait

SETPRIV = ("setpriv", "--pdeathsig", "KILL")
"""Command of util-linux that becomes the command after it, which the system kills as soon as its parent ends."""


def end_with_parent() -> None:
    """End this process as soon as its parent ends: the same command may be at work in the same folder again.

    To be called in a process of `multiprocessing`, such as by the initializer of a pool.
    """
    parent = multiprocessing.parent_process()
    assert parent is not None
    threading.Thread(target=_exit_with, args=(parent.sentinel,), daemon=True).start()


def ending_with_parent(command: Sequence[str]) -> list[str]:
    """Return a command whose process ends as soon as the thread that starts it does; where the system cannot do that,
    the command itself.

    For commands that cannot call `end_with_parent`. Their own children are not ended.
    """
    return [*(SETPRIV if _has_setpriv() else ()), *command]


@cache
def _has_setpriv() -> bool:
    """Return whether `SETPRIV` works here: on Linux, but not with the smaller setpriv of BusyBox."""
    if shutil.which(SETPRIV[0]) is None:
        return False
    return subprocess.run([*SETPRIV, "true"], capture_output=True, check=False).returncode == 0


def _exit_with(sentinel: int) -> None:
    """Wait for another process to end, then end this one."""
    wait([sentinel])
    os._exit(1)
