"""How do threads share compiled work? Each takes one run of the jobs, and the caller's own thread the first.

Kernels let go of Python's lock. Numba could share a loop out by itself, but compiles what the loop calls three times
for that, which is a quarter of a first start for the frame.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numba

from thalweg.core.jit import config

_pool: ThreadPoolExecutor | None = None


def share_out(jobs: int, work: Callable[[int, int], object]) -> None:
    """Call work(first, last) for runs of the numbers 0 to `jobs`, in as many threads as Numba is set to use.

    An error in any of them is raised here, once all have ended.
    """
    global _pool
    threads = min(numba.get_num_threads(), jobs)
    if threads <= 1:
        work(0, jobs)
        return
    if _pool is None:
        _pool = ThreadPoolExecutor(config.NUMBA_NUM_THREADS, "thalweg")
    edges = [jobs * thread // threads for thread in range(threads + 1)]
    others = [_pool.submit(work, *run) for run in pairwise(edges[1:])]
    try:
        work(*edges[:2])
    finally:
        failures = [error for other in others if (error := other.exception())]
    if failures:
        raise failures[0]


def _forget() -> None:
    """A forked process has none of its parent's threads."""
    global _pool
    _pool = None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
