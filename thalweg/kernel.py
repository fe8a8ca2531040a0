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
    function: Callable[..., Any] | None = None,
    *,
    parallel: bool = False,
    fastmath: bool = True,
    inlined: bool = False,
    disjoint: bool = False,
) -> Any:
    """The compiled form of a function, as a decorator; its cache is keyed by all kernel sources.

    `fastmath=False` is for the rules, which must give the same bits as their plain Python twins. `inlined=True` puts
    the function into its callers. `disjoint=True` promises that no array written to overlaps another argument: without
    that promise LLVM does not vectorise a loop that writes to one array and gathers from another.
    """

    def compile_lazily(python_function: Callable[..., Any]) -> Any:
        before = config.CACHE_DIR
        config.CACHE_DIR = str(cache_dir() / "kernels" / source_hash(*KERNEL_SOURCES))
        try:
            dispatcher = numba.njit(
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
        if disjoint and not config.DISABLE_JIT:
            _promise_disjoint(dispatcher)
        return dispatcher

    return compile_lazily(function) if function is not None else compile_lazily


def _promise_disjoint(dispatcher: Any) -> None:
    """Mark the arguments of a function as `noalias`. Numba has the flag for its own use but no option that sets it."""
    compiler = dispatcher._compiler
    customize = compiler._customize_flags

    def with_noalias(flags: Any) -> Any:
        flags = customize(flags)
        flags.noalias = True
        return flags

    compiler._customize_flags = with_noalias
