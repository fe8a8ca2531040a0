"""May this process draw? Not when it was forked after Numba's kernels had run on the threads of OpenMP: GNU OpenMP ends
such a process without a word at its first kernel.
"""

import thalweg


def refuse_forked() -> None:
    """Raises `RuntimeError`, which says what to use instead, in a process that could not run a kernel."""
    if thalweg.forked_after_kernels:
        raise RuntimeError(
            "this process was forked after kernels had run on several threads, and GNU OpenMP would end it at the next"
            ' frame; use gymnasium.make_vec, which needs no processes, or AsyncVectorEnv(..., context="spawn")'
        )
