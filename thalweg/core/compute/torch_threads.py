"""The number of threads that PyTorch computes with.

It is set explicitly, because last bits depend on it and other libraries on OpenMP change it.
This is apart from `thalweg.core.compute.threads` so that rendering on the CPU does not import PyTorch.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import torch

from thalweg.core.compute.threads import run_in_threads
from thalweg.core.cores import usable_cores

INITIAL_THREADS = min(torch.get_num_threads(), usable_cores())
"""The number PyTorch chose on import, which does not know the limits of containers, or that of the cores this process
may use, if smaller."""


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Set PyTorch's number of threads to `count` inside the block."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def default_torch_threads() -> int:
    """Return `OMP_NUM_THREADS` if it is set to a positive number, else `INITIAL_THREADS`."""
    value = os.environ.get("OMP_NUM_THREADS", "")
    return int(value) if value.isdigit() and int(value) > 0 else INITIAL_THREADS


def run_in_torch_threads(jobs: int, work: Callable[[int, int], object], least: int = 1) -> None:
    """Call `work(first, last)` for ranges of at least `least` jobs in the threads of kernels, up to
    `default_torch_threads()`; each computes with one thread of PyTorch.

    PyTorch's threads on OpenMP wait for their next task in a loop for milliseconds, in which they take the cores from
    kernels. These threads sleep.
    """

    def with_one_thread(first: int, last: int) -> None:
        # OpenMP keeps the number for each thread. Threads of the pool keep it for good.
        if torch.get_num_threads() != 1:
            torch.set_num_threads(1)
        work(first, last)

    with torch_threads(1):
        run_in_threads(jobs, with_one_thread, min(default_torch_threads(), max(jobs // least, 1)))
