"""Compilation of kernels: Numba with the flags this project measured to be fastest, safely cached.

Numba's own cache watches only the file a function stands in, so that a change in an imported kernel would leave a
stale one behind. Here the cache folder is named by a hash of the code of every module that kernels depend on. Comments,
docstrings, and where the package lies do not matter, so that a clone beside another uses the same compiled kernels.

In kernels everything is float32 (write `float32(0.5)`: a Python literal is float64 and halves the speed), conditions
in inner loops are selects, and NaN or infinity never stand for a mark, because `fastmath` forbids them.
"""

import hashlib
import re
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numba
from llvmlite import binding
from numba.core import caching
from numba.core import config as numba_config

from thalweg.core.cache import PACKAGE, cache_dir, code_hash

config: Any = numba_config
"""Its settings are made when Numba is imported, so that no type checker knows them."""
IMPORT = re.compile(r"^ *(?:from|import) (thalweg[.\w]*)(?: import (\([^)]*\)|.*))?", re.MULTILINE)
USES_KERNELS = re.compile(r"^from thalweg\.core\.jit import", re.MULTILINE)
"""What a module that defines kernels has among its imports."""


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
        dispatcher: Any = numba.njit(
            parallel=parallel,
            fastmath=fastmath,
            forceinline=inlined,
            error_model="numpy",
            boundscheck=False,
            nogil=True,
        )(python_function)
        if folder is not None and not config.DISABLE_JIT:
            dispatcher._cache = _Cache(dispatcher.py_func)
        if disjoint and not config.DISABLE_JIT:
            _promise_disjoint(dispatcher)
        return dispatcher

    return compile_lazily(function) if function is not None else compile_lazily


@cache
def kernel_folder() -> Path | None:
    """Where compiled kernels are kept, or None if no folder can be made there: then every process compiles anew.

    Numba by itself would fall back to folders beside the sources, which is what must not be.
    """
    folder = cache_dir() / "kernels" / f"{code_hash(kernel_sources())}-{machine_hash()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        warnings.warn(f"compiled kernels can't be kept in {folder} ({error}): every start will compile", stacklevel=2)
        return None
    return folder


def machine_hash() -> str:
    """A hash of what else compiled code depends on: the processor and the versions of Numba and Python."""
    cpu = binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()
    return hashlib.sha256("\n".join((*cpu, numba.__version__, sys.version)).encode()).hexdigest()[:8]


def kernel_sources() -> list[Path]:
    """The modules that define kernels, and every module of the package that those import, however indirectly.

    What a package's `__init__.py` gathers is found in the modules themselves, so that facades don't count.
    """
    texts = {path: path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py") if path.name != "__init__.py"}
    waiting = [path for path, text in texts.items() if USES_KERNELS.search(text)]
    found = {PACKAGE / "core" / "jit.py"}
    while waiting:
        path = waiting.pop()
        if path not in found:
            found.add(path)
            waiting += [other for other in _imported(texts[path]) if other in texts]
    return sorted(found)


def _imported(text: str) -> Iterator[Path]:
    """Where the modules of Thalweg lie that a module imports, in either way to write it."""
    for module, names in IMPORT.findall(text):
        place = PACKAGE.joinpath(*module.split(".")[1:])
        yield place.with_suffix(".py")
        yield from (place / f"{name}.py" for name in re.findall(r"\w+", names))


class _Locator(caching._CacheLocator):
    """Where the compiled form of a function lies: in the folder for kernels, whatever the time stamps of its file."""

    def __init__(self, py_func: Callable[..., Any], py_file: str) -> None:
        self._py_file = py_file
        folder = kernel_folder()
        assert folder is not None
        self._folder = folder / py_func.__module__.removeprefix("thalweg.")

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """For functions outside the package, whose code is not part of the folder's name."""
        return code_hash([Path(self._py_file)]) if PACKAGE not in Path(self._py_file).parents else ""

    def get_disambiguator(self) -> str:
        return "kernel"  # functions of one name in one module are told apart by their bytecode

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> "_Locator":
        locator = cls(py_func, py_file)
        locator.ensure_cache_path()
        return locator


class _CacheImpl(caching.CompileResultCacheImpl):
    _locator_classes = (_Locator,)


class _Cache(caching.FunctionCache):
    _impl_class = _CacheImpl


def _promise_disjoint(dispatcher: Any) -> None:
    """Mark the arguments of a function as `noalias`. Numba has the flag for its own use but no option that sets it."""
    compiler = dispatcher._compiler
    customize = compiler._customize_flags

    def with_noalias(flags: Any) -> Any:
        flags = customize(flags)
        flags.noalias = True
        return flags

    compiler._customize_flags = with_noalias
