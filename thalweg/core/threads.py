"""A thread pool for compiled kernels: the jobs are split into one range per thread.

Kernels release Python's lock. Numba's own `parallel=True` would compile everything that the loop calls three times,
which takes a quarter of the first start for the frame kernel.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numba

from thalweg.core.jit import config

_pool: ThreadPoolExecutor | None = None


def run_in_threads(jobs: int, work: Callable[[int, int], object]) -> None:
    """Call `work(first, last)` for ranges that cover 0 to `jobs`, in as many threads as Numba is set to use.

    The calling thread takes the first range. An error in any range is raised here after all ranges have ended.
    """
    global _pool
    threads = min(numba.get_num_threads(), jobs)
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
