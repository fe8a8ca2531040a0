"""How a loop becomes a compiled kernel: Numba with the flags this project measured to be fastest, safely cached.

Numba's own cache watches only the file a function stands in, so that a change in an imported kernel would leave a
stale one behind. Here the cache folder is named by a hash of every source that holds kernels.

In kernels everything is float32 (write `float32(0.5)`: a Python literal is float64 and halves the speed), conditions
in inner loops are selects, and NaN or infinity never stand for a mark, because `fastmath` forbids them.
"""

from collections.abc import Callable
from typing import Any

import numba
from numba.core import config

from thalweg.cache import cache_dir, source_hash

KERNEL_SOURCES = ("kernel.py", "world", "render", "env")


def kernel(
    function: Callable[..., Any] | None = None, *, parallel: bool = False, fastmath: bool = True, inlined: bool = False
) -> Any:
    """The compiled form of a function, as a decorator; its cache is keyed by all kernel sources.

    `fastmath=False` is for the rules, which must give the same bits as their plain Python twins. `inlined=True` puts
    the function into its callers: LLVM vectorises a loop only where it sees that the arrays it writes to cannot overlap
    others, which it knows of arrays that were allocated in the same function.
    """

    def compile_lazily(python_function: Callable[..., Any]) -> Any:
        before = config.CACHE_DIR
        config.CACHE_DIR = str(cache_dir() / "kernels" / source_hash(*KERNEL_SOURCES))
        try:
            return numba.njit(
                cache=True,
                parallel=parallel,
                fastmath=fastmath,
                forceinline=inlined,
                error_model="numpy",
                boundscheck=False,
                nogil=True,
            )(python_function)
        finally:
            config.CACHE_DIR = before

    return compile_lazily(function) if function is not None else compile_lazily
