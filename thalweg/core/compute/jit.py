"""The `kernel` decorator: Numba compilation with this project's flags, and the cache of compiled kernels.

Numba's own cache watches only the file that defines a function, so a change in an imported kernel would leave a stale
one behind. Here the name of the cache folder contains a hash of the code of every module that kernels depend on.
Comments, docstrings and the location of the package do not change it, so two clones share compiled kernels.

A kernel is stored only where Python calls it, together with all that it calls; see `kernel_compiler`.

Kernels compute in float32 (write `float32(0.5)`: a Python literal is float64 and halves the speed), use selects for
conditions in inner loops, and never use NaN or infinity as special values, because `fastmath` forbids them.
"""

import hashlib
import re
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
from llvmlite import binding
from numba.core import caching
from numba.core.runtime.nrt import rtsys

from thalweg.core.cache import PACKAGE, cache_dir, code_hash, keep_in_use
from thalweg.core.compute.kernel_compiler import Kernel, WholeCompiler, config, preferred_vector_bits
from thalweg.core.compute.kernel_file import KernelFile

IMPORT = re.compile(r"^ *(?:from|import) (thalweg[.\w]*)(?: import (\([^)]*\)|.*))?", re.MULTILINE)
USES_KERNELS = re.compile(r"^from thalweg\.core\.compute\.jit import", re.MULTILINE)
"""Matches the import that every module with kernels has."""
OPTIONS = {"nopython": True, "error_model": "numpy", "boundscheck": False, "nogil": True}
"""Numba's options of all kernels."""


def kernel(
    function: Callable[..., Any] | None = None,
    *,
    fastmath: bool = True,
    inlined: bool = False,
    disjoint: bool = False,
    allocates: bool = True,
) -> Any:
    """Decorate a function to be compiled at its first call and cached under the code of all kernel sources.

    Args:
        function: The Python function, when the decorator is used without arguments.
        fastmath: Allow reordering of float operations. False for the rules, which must give the same bits as their
            plain Python reference, and for the world, which must give the same bits on every machine of a kind.
        inlined: Inline the function into its callers.
        disjoint: Promise that no array that is written overlaps another argument. Without this promise LLVM does not
            vectorise a loop that writes to one array and gathers from another.
        allocates: False for a function that neither allocates nor returns an array. Its arrays belong to the caller,
            so no references are counted, which would be an atomic operation for each array of a record. Kernels of a
            frame that need scratch are therefore two: a wrapper without loops that allocates, and one that computes.
    """

    def compile_lazily(python_function: Callable[..., Any]) -> Any:
        if config.DISABLE_JIT:
            return python_function
        options = {"fastmath": fastmath, "forceinline": inlined}
        dispatcher: Any = Kernel(python_function, targetoptions=OPTIONS | options, pipeline_class=WholeCompiler)
        dispatcher.set_flags(disjoint, allocates)
        if kernel_cache_dir() is not None:
            try:
                dispatcher._cache = _Cache(dispatcher.py_func)
            except OSError as error:  # its folder cannot be made
                _warn_not_stored(kernel_cache_dir(), str(error))
        return dispatcher

    return compile_lazily(function) if function is not None else compile_lazily


@cache
def kernel_cache_dir() -> Path | None:
    """Return the folder for compiled kernels, or None if it cannot be written; then every process compiles anew.

    Numba by itself would fall back to folders beside the sources, which would go stale. Folders of other versions that
    were not used for long are removed.
    """
    folder = cache_dir() / "kernels" / f"{code_hash(kernel_sources())}-{machine_hash()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        _warn_not_stored(folder, str(error))
        return None
    keep_in_use(folder, "*")
    return folder


@cache
def _warn_not_stored(folder: Path | None, why: str) -> None:
    """Warn, once for each reason, that kernels are compiled at every start."""
    warnings.warn(f"compiled kernels can't be stored in {folder} ({why}): every start will compile them", stacklevel=3)


def machine_hash() -> str:
    """Return a hash of what compiled code depends on besides its source: processor, vector width, Numba and Python.

    It names no folder, so that another virtual environment or clone with the same versions uses the same kernels.
    """
    cpu = binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten(), str(preferred_vector_bits())
    versions = numba.__version__, llvmlite.__version__, sys.version
    return hashlib.sha256("\n".join((*cpu, *versions)).encode()).hexdigest()[:8]


def kernel_sources() -> list[Path]:
    """Return the modules that define kernels and all modules of the package that they import, also indirectly.

    The `__init__.py` files are left out: kernels import from the defining modules.
    """
    sources = {path: path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py") if path.name != "__init__.py"}
    waiting = [path for path, text in sources.items() if USES_KERNELS.search(text)]
    waiting.append(PACKAGE / "core" / "compute" / "jit.py")
    found: set[Path] = set()
    while waiting:
        path = waiting.pop()
        if path not in found:
            found.add(path)
            waiting += [other for other in _imported_paths(sources[path]) if other in sources]
    return sorted(found)


def _imported_paths(source: str) -> Iterator[Path]:
    """Yield the paths of the package's modules that a source may import, by `import a.b` or `from a import b`."""
    for module, names in IMPORT.findall(source):
        path = PACKAGE.joinpath(*module.split(".")[1:])
        yield path.with_suffix(".py")
        yield from (path / f"{name}.py" for name in re.findall(r"\w+", names))


class _Locator(caching._CacheLocator):
    """Locates the compiled form of a function in the kernel cache, regardless of the time stamp of its source file."""

    def __init__(self, py_func: Callable[..., Any], py_file: str) -> None:
        self._py_file = py_file
        folder = kernel_cache_dir()
        assert folder is not None
        self._folder = folder / py_func.__module__.removeprefix("thalweg.")

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """Return a hash of the code for functions outside the package, which the folder's name does not cover."""
        return code_hash([Path(self._py_file)]) if PACKAGE not in Path(self._py_file).parents else ""

    def get_disambiguator(self) -> str:
        return "kernel"  # Numba distinguishes functions of one name in one module by their bytecode

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> "_Locator":
        locator = cls(py_func, py_file)
        locator.ensure_cache_path()
        return locator


class _CacheImpl(caching.CompileResultCacheImpl):
    _locator_classes = (_Locator,)


class _Cache(caching.FunctionCache):
    _impl_class = _CacheImpl

    def __init__(self, py_func: Callable[..., Any]) -> None:
        super().__init__(py_func)
        locator = self._impl.locator
        self._cache_file = KernelFile(self._cache_path, self._impl.filename_base, locator.get_source_stamp())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return a stored kernel, or None, without what only compilation needs.

        Numba would first import and install all that it knows of Python's and NumPy's functions.
        """
        rtsys.initialize(target_context)
        with suppress(OSError):  # such as a folder that may not be read
            return self._load_overload(sig, target_context)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store a compiled kernel; where that fails, as on a full disk, a warning says so once."""
        try:
            self._save_overload(sig, data)
        except OSError as error:
            _warn_not_stored(kernel_cache_dir(), str(error))
