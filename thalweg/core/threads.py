"""A thread pool for compiled kernels: the jobs are split into one range per thread.

Kernels release Python's lock. Numba's own `parallel=True` is not used: it runs on OpenMP where that is installed, and
then sets PyTorch's number of threads to that of all cores and makes forked processes die at their first kernel.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

from thalweg.core.jit import config

_pool: ThreadPoolExecutor | None = None
_threads = int(config.NUMBA_NUM_THREADS)


def get_num_threads() -> int:
    """Return the number of threads that kernels use; all cores, or `NUMBA_NUM_THREADS`, unless it was set."""
    return _threads


def set_num_threads(threads: int) -> None:
    """Set the number of threads that kernels use in this process; it changes no result.

    Raises `ValueError` for a number outside 1 to `NUMBA_NUM_THREADS`.
    """
    global _threads
    if not 1 <= threads <= config.NUMBA_NUM_THREADS:
        raise ValueError(f"threads = {threads}: it must be in 1..{config.NUMBA_NUM_THREADS}")
    _threads = threads


def run_in_threads(jobs: int, work: Callable[[int, int], object], most: int | None = None) -> None:
    """Call `work(first, last)` for ranges that cover 0 to `jobs`, in `get_num_threads` threads, or `most` if fewer.

    The calling thread takes the first range. An error in any range is raised here after all ranges have ended.
    """
    global _pool
    threads = min(_threads, jobs, jobs if most is None else most)
    if threads <= 1:
        work(0, jobs)
        return
    if _pool is None:
        _pool = ThreadPoolExecutor(config.NUMBA_NUM_THREADS, "thalweg")
    edges = [jobs * thread // threads for thread in range(threads + 1)]
    futures = [_pool.submit(work, *ends) for ends in pairwise(edges[1:])]
    try:
        work(*edges[:2])
    finally:
        errors = [error for future in futures if (error := future.exception())]
    if errors:
        raise errors[0]


def _drop_pool() -> None:
    """Drop the pool in a forked process, which has none of its parent's threads."""
    global _pool
    _pool = None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_drop_pool)
