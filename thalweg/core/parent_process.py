"""Processes that end with the process that started them, however that one ended."""

import multiprocessing
import os
import threading
from multiprocessing.connection import wait


def end_with_parent() -> None:
    """End this process as soon as its parent ends: the same command may be at work in the same folder again.

    To be called in a process of `multiprocessing`, such as by the initializer of a pool.
    """
    parent = multiprocessing.parent_process()
    assert parent is not None
    threading.Thread(target=_exit_with, args=(parent.sentinel,), daemon=True).start()


def _exit_with(sentinel: int) -> None:
    """Wait for another process to end, then end this one."""
    wait([sentinel])
    os._exit(1)
