"""How a loop becomes a compiled kernel: Numba with the flags this project measured to be fastest, safely cached.

Numba's own cache watches only the file a function stands in, so that a change in an imported kernel would leave a
stale one behind. Here the cache folder is named by a hash of every source that holds kernels.

In kernels everything is float32 (write `float32(0.5)`: a Python literal is float64 and halves the speed), conditions
in inner loops are selects, and NaN or infinity never stand for a mark, because `fastmath` forbids them.
"""

import hashlib
import sys
import tempfile
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from llvmlite import binding
from numba.core import config as numba_config

from thalweg.core.cache import PACKAGE, cache_dir, source_hash

config: Any = numba_config
"""Its settings are made when Numba is imported, so that no type checker knows them."""
KERNEL_SOURCES = ("core/jit.py", "world", "render", "env", "algos/policy/mlp_numba.py")


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
        folder = kernel_folder()
        before = config.CACHE_DIR
        config.CACHE_DIR = str(folder)
        try:
            dispatcher = numba.njit(
                cache=folder is not None,
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


@cache
def kernel_folder() -> Path | None:
    """Where compiled kernels are kept, or None if no folder can be made there: then every process compiles anew.

    Numba by itself would fall back to folders beside the sources, which is what must not be.
    """
    folder = cache_dir() / "kernels" / f"{source_hash(*KERNEL_SOURCES)}-{place_hash(PACKAGE)}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        warnings.warn(f"compiled kernels can't be kept in {folder} ({error}): every start will compile", stacklevel=2)
        return None
    return folder


def place_hash(package: Path) -> str:
    """What else Numba keeps kernels apart by: where the package lies, the processor, and the versions."""
    cpu = binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()
    named = (str(package.resolve()), *cpu, numba.__version__, sys.version)
    return hashlib.sha256("\n".join(named).encode()).hexdigest()[:8]


def _promise_disjoint(dispatcher: Any) -> None:
    """Mark the arguments of a function as `noalias`. Numba has the flag for its own use but no option that sets it."""
    compiler = dispatcher._compiler
    customize = compiler._customize_flags

    def with_noalias(flags: Any) -> Any:
        flags = customize(flags)
        flags.noalias = True
        return flags

    compiler._customize_flags = with_noalias
