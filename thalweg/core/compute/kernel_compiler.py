"""Numba's compiler for kernels: each of those that Python calls is one piece of machine code with all that it calls.

Numba by itself optimises every function, turns it into machine code, stores it, and then does so again within each of
its callers. A frame's kernel calls two hundred others. Here a kernel has two forms. As a part of others it is only
translated to LLVM's intermediate code; the whole, which Python calls, links all parts and is optimised once. Parts come
from the source and never from the cache, so that the code of a whole does not depend on what was compiled before it.
"""

import os
from collections.abc import Callable
from functools import cached_property
from typing import Any

from llvmlite import binding
from numba.core import codegen, compiler, lowering, typed_passes, types
from numba.core import config as numba_config
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.environment import lookup_environment
from numba.core.registry import CPUDispatcher

config: Any = numba_config
"""Numba's settings, typed as `Any` because they are set on import and unknown to type checkers."""
VECTOR_SETTING = "THALWEG_VECTOR_BITS"
"""Environment variable with the widest vectors that kernels may use, one of `VECTOR_WIDTHS`."""
VECTOR_WIDTHS = (256, 512)


class VectorSettingError(ValueError):
    """A setting of the width of vectors that is not one of `VECTOR_WIDTHS`."""


def preferred_vector_bits() -> int:
    """Return the widest vectors in bits that kernels may use: 512, or `$THALWEG_VECTOR_BITS`.

    Raises `VectorSettingError` for a setting that is not one of `VECTOR_WIDTHS`.
    """
    setting = os.environ.get(VECTOR_SETTING, "") or str(VECTOR_WIDTHS[-1])
    if setting not in map(str, VECTOR_WIDTHS):
        raise VectorSettingError(f"{VECTOR_SETTING} = {setting!r}: choose one of {', '.join(map(str, VECTOR_WIDTHS))}")
    return int(setting)


def vector_bits() -> int:
    """Return the width in bits of the vectors in compiled kernels: the processor's, up to the preferred one."""
    features = processor_features()
    widest = 512 if "+avx512f" in features else 256 if "+avx" in features else 128
    return min(widest, preferred_vector_bits())


def processor_features() -> list[str]:
    """Return the features of the processor that Numba compiles for, such as `+avx2`."""
    return (config.CPU_FEATURES or codegen.get_host_cpu_features()).split(",")


def gathering_features() -> str | None:
    """Return the processor's features and `+fast-gather`, or None where LLVM gathers without it or never can.

    With AVX2 alone LLVM uses gathers, and vectorises loops that need them, only on the processors of Intel that it
    lists. Most loops of a frame look something up in tables; on AMD's Zen 3 a frame with gathers takes 0.8 of the time.
    """
    features = processor_features()
    return ",".join((*features, "+fast-gather")) if "+avx2" in features and "+avx512f" not in features else None


class Part(codegen.JITCodeLibrary):
    """The intermediate code of one kernel that other kernels call."""

    def finalize(self) -> None:
        """End additions, without optimising or linking anything."""
        self._raise_if_finalized()
        self._finalized = True

    def own_module(self) -> Any:
        """Return the module of this kernel alone."""
        return super()._get_module_for_linking()

    def _get_module_for_linking(self) -> Any:
        """Return a module with all that the kernel calls, for functions that are no kernels."""
        self._ensure_finalized()
        module = self.own_module().clone()
        link(module, self._linking_libraries)
        return module


class Whole(codegen.JITCodeLibrary):
    """The machine code of a kernel that Python calls, and of all that it calls."""

    _codegen: Any

    def __init__(self, codegen: Any, name: str) -> None:
        super().__init__(codegen, name)
        # The machine code is kept, to be stored.
        self.enable_object_caching()

    def finalize(self) -> None:
        """Link all parts, then optimise and compile."""
        for library in link(self._final_module, self._linking_libraries):
            self._reload_init.update(library._reload_init)
        # They would be linked once more.
        self._linking_libraries = []
        super().finalize()

    def _verify_declare_only_symbols(self) -> None:
        """Raise `AssertionError` for a function that is called and was not linked: its address would be zero."""
        missing = [f.name for f in self._final_module.functions if f.is_declaration and f.name.startswith("_ZN")]
        if missing:
            raise AssertionError(f"functions called by {self.name} are not linked: {', '.join(missing)}")

    def set_environments(self) -> None:
        """Tell the machine code where the constants of its functions are; Numba does it for the first of them only."""
        for variable in self._final_module.global_variables:
            environment = lookup_environment(variable.name)
            if environment is not None:
                self._codegen.set_env(variable.name, environment)


def link(module: binding.ModuleRef, libraries: list[Any]) -> list[Any]:
    """Link libraries into a module, with all that parts among them call; returns all that were linked."""
    linked = callers_first(libraries)
    for library in linked:
        own = library.own_module() if isinstance(library, Part) else library._get_module_for_linking()
        module.link_in(own, preserve=True)
    return linked


def callers_first(libraries: list[Any]) -> list[Any]:
    """Return libraries and all that parts among them call, each once, after all those that call it.

    LLVM's linker leaves out a function that nothing has called so far.
    """
    ordered: list[Any] = []
    seen: set[int] = set()

    def visit(library: Any) -> None:
        if id(library) not in seen:
            seen.add(id(library))
            for called in reversed(library._linking_libraries if isinstance(library, Part) else []):
                visit(called)
            ordered.append(library)

    for library in reversed(libraries):
        visit(library)
    return ordered[::-1]


class _Lower(lowering.Lower):
    """Writes LLVM's code of a kernel, and lets it use the preferred width of vectors, and gathers.

    For most of Intel's processors with AVX-512, LLVM prefers vectors of 256 bits, which suits programs with few vector
    loops. The attributes belong to the function, so that other users of Numba in the process keep their code.
    """

    def setup_function(self, fndesc: Any) -> None:
        super().setup_function(fndesc)
        # Not by the method of the same name, which refuses attributes that depend on the processor.
        set.add(self.function.attributes, f'"prefer-vector-width"="{preferred_vector_bits()}"')
        if (features := gathering_features()) is not None:
            set.add(self.function.attributes, f'"target-features"="{features}"')


class _KernelLowering(typed_passes.NativeLowering):
    """Numba's last pass, into a library of a given class, by `_Lower`."""

    library_class: type[codegen.JITCodeLibrary]

    @property
    def lowering_class(self) -> type[lowering.Lower]:
        return _Lower

    def run_pass(self, state: Any) -> bool:
        state.library = self.library_class(state.targetctx.codegen(), state.func_id.func_qualname)
        return super().run_pass(state)


@register_pass(mutates_CFG=True, analysis_only=False)
class _WholeLowering(_KernelLowering):
    _name = "kernel_lowering"
    library_class = Whole

    def run_pass(self, state: Any) -> bool:
        changed = super().run_pass(state)
        state.library.set_environments()
        return changed


@register_pass(mutates_CFG=True, analysis_only=False)
class _PartLowering(_KernelLowering):
    _name = "part_of_kernel_lowering"
    library_class = Part

    def run_pass(self, state: Any) -> bool:
        changed = super().run_pass(state)
        # Callers find the function by what would be its machine code.
        key = object()
        state.targetctx.insert_user_function(key, state.cr.fndesc, [state.library])
        state.cr = state.cr._replace(cfunc=key)
        return changed


class WholeCompiler(compiler.CompilerBase):
    """Compiles a kernel for calls from Python."""

    lowering_pass: type[_KernelLowering] = _WholeLowering

    def define_pipelines(self) -> list[Any]:
        """Return Numba's pipeline with another last pass."""
        pipeline = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        swapped = PassManager(pipeline.pipeline_name)
        for one, description in pipeline.passes:
            swapped.add_pass(self.lowering_pass if one is typed_passes.NativeLowering else one, description)
        swapped.finalize()
        return [swapped]


class _PartCompiler(WholeCompiler):
    """Compiles a kernel for calls from other kernels."""

    lowering_pass = _PartLowering


class _PartDispatcher(CPUDispatcher):
    """A kernel as others call it, by types of arguments."""

    _compiler: Any

    def add_overload(self, cres: Any) -> None:
        """Keep a compiled form, without telling the dispatcher of calls from Python."""
        self.overloads[tuple(cres.signature.args)] = cres


class Kernel(CPUDispatcher):
    """A kernel as Python calls it."""

    _compiler: Any
    _flags: dict[str, bool]

    def set_flags(self, disjoint: bool, allocates: bool) -> None:
        """Set the compiler flags for which Numba has no public option.

        `noalias` marks arguments as disjoint; `nrt` enables reference counts.
        """
        self._flags = {"noalias": disjoint, "nrt": allocates}
        self._compiler._customize_flags = _setter(self._flags)

    @cached_property
    def _part(self) -> _PartDispatcher:
        part = _PartDispatcher(self.py_func, targetoptions=self.targetoptions, pipeline_class=_PartCompiler)
        code_only = {"no_compile": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        part._compiler._customize_flags = _setter(self._flags | code_only)
        return part

    @property
    def _numba_type_(self) -> types.Dispatcher:
        """The type of the kernel in compiled functions, which call its part."""
        return types.Dispatcher(self._part)


def _setter(values: dict[str, bool]) -> Callable[[Any], Any]:
    """Return a function that sets flags of the compiler."""

    def set_all(flags: Any) -> Any:
        # All of them: a function would otherwise inherit a flag of the caller that is being compiled.
        for name, value in values.items():
            setattr(flags, name, value)
        return flags

    return set_all
