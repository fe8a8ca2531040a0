"""A thread pool for compiled kernels: each thread takes one range of the jobs, or several from a shared list.

Kernels release Python's lock. Numba's own `parallel=True` is not used: it runs on OpenMP where that is installed, and
then sets PyTorch's number of threads to that of all cores and makes forked processes die at their first kernel.
"""

import os
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

from thalweg.core.compute.kernel_compiler import config
from thalweg.core.cores import usable_cores

_pool: ThreadPoolExecutor | None = None


def default_threads() -> int:
    """Return `NUMBA_NUM_THREADS` if the environment has it, else the number of cores this process may use."""
    most = int(config.NUMBA_NUM_THREADS)
    return most if os.environ.get("NUMBA_NUM_THREADS") else min(most, usable_cores())


_threads = default_threads()


def get_num_threads() -> int:
    """Return the number of threads that kernels use: `default_threads()`, unless another was set."""
    return _threads


def set_num_threads(threads: int) -> None:
    """Set the number of threads that kernels use in this process; it changes no result.

    Raises `ValueError` for a number outside 1 to `NUMBA_NUM_THREADS`.
    """
    global _threads
    if not 1 <= threads <= config.NUMBA_NUM_THREADS:
        raise ValueError(f"threads = {threads}: it must be in 1..{config.NUMBA_NUM_THREADS}")
    _threads = threads


def run_in_threads(
    jobs: int, work: Callable[[int, int], object], most: int | None = None, *, unequal: bool = False
) -> None:
    """Call `work(first, last)` for ranges that cover 0 to `jobs`, in `get_num_threads` threads, or `most` if fewer.

    The calling thread takes the first range. An error in any range is raised here after all threads have ended.

    `unequal`: jobs take different times. The threads then take ranges from one list, shorter ones towards its end, so
    that none waits long for another.
    """
    global _pool
    threads = min(_threads, jobs, jobs if most is None else most)
    if threads <= 1:
        work(0, jobs)
        return
    if _pool is None:
        _pool = ThreadPoolExecutor(config.NUMBA_NUM_THREADS, "thalweg")
    edges = shrinking_edges(jobs, threads) if unequal else [jobs * thread // threads for thread in range(threads + 1)]
    ranges = deque(pairwise(edges))
    own = [ranges.popleft() for _ in range(threads)]

    def take_ranges(first: int, last: int) -> None:
        work(first, last)
        while ranges:
            try:
                another = ranges.popleft()
            except IndexError:  # another thread has just taken the last one
                return
            work(*another)

    futures = [_pool.submit(take_ranges, *ends) for ends in own[1:]]
    try:
        take_ranges(*own[0])
    finally:
        errors = [error for future in futures if (error := future.exception())]
    if errors:
        raise errors[0]


def shrinking_edges(jobs: int, threads: int) -> list[int]:
    """Return the ends of ranges that cover 0 to `jobs`, each half of a thread's share of the jobs that are left."""
    edges = [0]
    while edges[-1] < jobs:
        edges.append(edges[-1] + max((jobs - edges[-1]) // (2 * threads), 1))
    return edges


def _drop_pool() -> None:
    """Drop the pool in a forked process, which has none of its parent's threads."""
    global _pool
    _pool = None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_drop_pool)
