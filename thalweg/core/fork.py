"""Detection of processes that were forked after kernels had run, and the error raised when they try to render.

GNU OpenMP kills such a process silently at its first parallel kernel. `import thalweg` installs the detection.
"""

import os
import sys

forked_after_kernels = False
"""Whether this process was forked from one whose kernels had run on OpenMP threads, which do not survive a fork."""


def raise_if_forked() -> None:
    """Raise `RuntimeError`, which names the alternatives, in a process that cannot run a kernel after its fork."""
    if forked_after_kernels:
        raise RuntimeError(
            "this process was forked after kernels had run on several threads, and GNU OpenMP would kill it at the next"
            ' frame; use gymnasium.make_vec, which needs no processes, or AsyncVectorEnv(..., context="spawn")'
        )


def _record_fork() -> None:
    """In a new child process, record whether Numba's threads ran in the parent and were those of OpenMP."""
    global forked_after_kernels
    numba = sys.modules.get("numba")
    try:
        forked_after_kernels |= numba is not None and numba.threading_layer() == "omp"
    except (AttributeError, ValueError):  # half imported, or no kernel has run on several threads yet
        return


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_record_fork)
