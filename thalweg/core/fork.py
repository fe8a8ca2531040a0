"""Detection of a process that was forked after kernels had run, and the refusal to draw in it.

GNU OpenMP ends such a process without a word at its first parallel kernel. `import thalweg` installs the detection.
"""

import os
import sys

forked_after_kernels = False
"""Whether this process was forked from one in which kernels had run on OpenMP's threads, which forks do not survive."""


def refuse_forked() -> None:
    """Raises `RuntimeError`, which says what to use instead, in a process that could not run a kernel."""
    if forked_after_kernels:
        raise RuntimeError(
            "this process was forked after kernels had run on several threads, and GNU OpenMP would end it at the next"
            ' frame; use gymnasium.make_vec, which needs no processes, or AsyncVectorEnv(..., context="spawn")'
        )


def _note_fork() -> None:
    """In a child just forked: remember whether Numba's threads ran in the parent and were those of OpenMP."""
    global forked_after_kernels
    numba = sys.modules.get("numba")
    try:
        forked_after_kernels |= numba is not None and numba.threading_layer() == "omp"
    except (AttributeError, ValueError):  # half imported; no kernel has run on several threads yet
        return


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_note_fork)
