"""Tests of compiled kernels: vectorised loops, the cache folder, and the sources that key it."""

import os
import platform
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core.errors import NumbaError

from thalweg.core.cache import PACKAGE
from thalweg.core.compute import jit
from thalweg.core.compute.jit import kernel, kernel_sources, machine_hash
from thalweg.core.compute.kernel_compiler import preferred_vector_bits, vector_bits

X86 = platform.machine() in ("x86_64", "AMD64")
INTEL = {
    "NUMBA_CPU_NAME": "icelake-server",
    "NUMBA_CPU_FEATURES": "+avx,+avx2,+fma,+avx512f,+avx512vl,+avx512dq,+avx512bw,+avx512cd",
}
"""Settings of Numba for a processor on which LLVM prefers vectors of 256 bits to those of 512."""
AMD = {"NUMBA_CPU_NAME": "znver3", "NUMBA_CPU_FEATURES": "+avx,+avx2,+fma"}
"""Settings of Numba for a processor on which LLVM does not gather, though it can."""


def gather(table, at, out):
    for i in range(len(out)):
        out[i] = out[i] + table[np.uint32(np.int32(at[i] * np.float32(2)))]


def add_up_halves(table, at, out):
    halves = table[:128], table[128:]
    for i in range(len(out)):
        half = halves[0] if at[i] > 0 else halves[1]
        out[i] = half[i] + half[i + 1]


def llvm_ir(dispatcher) -> str:
    floats = np.zeros(64, np.float32)
    dispatcher(np.zeros(256, np.float32), floats, floats.copy())
    (ir,) = dispatcher.inspect_llvm().values()
    return ir


@pytest.fixture(autouse=True)
def no_cache(monkeypatch):
    """Disable the kernel cache: Numba cannot show the code of cached kernels, and both would share a file."""
    monkeypatch.setattr("thalweg.core.compute.jit.kernel_cache_dir", lambda: None)


def test_a_disjoint_kernel_vectorises_a_gather_and_another_does_not():
    plain, disjoint = llvm_ir(kernel(gather)), llvm_ir(kernel(gather, disjoint=True))
    assert "noalias" in disjoint
    assert "x float>" in disjoint
    assert "x float>" not in plain


def test_a_kernel_that_allocates_nothing_counts_no_references_and_another_does():
    counting, plain = llvm_ir(kernel(add_up_halves)), llvm_ir(kernel(add_up_halves, allocates=False))
    assert "call void @NRT_incref" in counting
    assert "call void @NRT_incref" not in plain


def test_a_kernel_that_allocates_nothing_leaves_the_references_of_its_arguments_alone():
    table, out = np.arange(256, dtype=np.float32), np.zeros(64, np.float32)
    before = sys.getrefcount(table)
    kernel(add_up_halves, allocates=False)(table, np.ones(64, np.float32), out)
    assert sys.getrefcount(table) == before
    np.testing.assert_array_equal(out, 2 * np.arange(64) + 1)


def test_a_kernel_that_allocates_is_refused_where_it_promises_not_to():
    with pytest.raises(NumbaError):
        kernel(lambda n: np.zeros(n)[0], allocates=False)(3)


def test_kernels_compute_what_the_function_computes():
    rng = np.random.default_rng(0)
    table, at = rng.random(256).astype(np.float32), rng.uniform(0, 127, 64).astype(np.float32)
    out = rng.random(64).astype(np.float32)
    expected = out + table[(at * 2).astype(int)]
    kernel(gather, disjoint=True)(table, at, out)
    np.testing.assert_allclose(out, expected, rtol=1e-6)


@pytest.mark.parametrize("folder", ["mine", "file/below"])
def test_the_cache_is_in_the_chosen_folder_or_nowhere(tmp_path, folder):
    (tmp_path / "file").write_text("a file, so that no folder can be made below it")
    script = tmp_path / "job.py"
    script.write_text(
        "from thalweg.core.compute.jit import kernel\n@kernel\ndef double(x):\n    return x + x\nprint(double(21.0))\n"
    )
    env = {**os.environ, "THALWEG_CACHE": str(tmp_path / folder)}
    done = subprocess.run([sys.executable, str(script)], env=env, capture_output=True, text=True, timeout=120)
    assert done.stdout == "42.0\n", done.stderr
    cached = list(tmp_path.glob("mine/**/*.nbi"))
    assert bool(cached) == (folder == "mine")
    assert not list((tmp_path / "__pycache__").glob("*.nbi"))


def test_kernel_sources_include_direct_and_indirect_imports():
    sources = {path.relative_to(PACKAGE).as_posix() for path in kernel_sources()}
    assert {
        "core/compute/jit.py",
        "render/kernels/frame.py",
        "env/task/rules.py",
        "world/light/sun_shadow.py",
    } <= sources
    assert {"render/records/scene.py", "world/record.py", "env/config.py", "core/cache.py"} <= sources  # indirectly
    assert not {"env/vector_env.py", "render/renderer.py", "world/map_image.py", "train/run.py"} & sources


@pytest.mark.parametrize(
    "line",
    [
        "import thalweg.world.noise",
        "from thalweg.world.noise import lattice",
        "from thalweg.world import geometry, noise",
        "from thalweg.world import (\n    geometry,\n    noise as n,\n)",
        "def later():\n    from thalweg.world import noise",
    ],
)
def test_every_form_of_import_is_found(line: str):
    assert PACKAGE / "world" / "noise.py" in set(jit._imported_paths(f"import os\n{line}\n"))


WIDEST_REGISTERS = """
import numba, numpy as np
from thalweg.core.compute import jit, kernel_compiler
jit.kernel_cache_dir = lambda: None
def halve(a, b):
    for i in range(len(a)):
        b[i] = a[i] * np.float32(0.5) + np.float32(1)
array = numba.float32[::1]
for compiled in (jit.kernel(halve, disjoint=True), numba.njit(fastmath=True)(halve)):
    compiled.compile((array, array))
    (code,) = compiled.inspect_asm().values()
    print(next(name for name in ("zmm", "ymm", "xmm") if name in code), end=" ")
print(kernel_compiler.vector_bits())
"""


def widest_registers(**environment: str) -> tuple[str, str, int]:
    """The widest registers in the code of a kernel and in that of a function of plain Numba, and `vector_bits()`.

    The code is compiled for the processor that the environment names, and does not run.
    """
    done = subprocess.run(
        [sys.executable, "-c", WIDEST_REGISTERS],
        env={**os.environ, "THALWEG_VECTOR_BITS": "", **environment},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    ours, plain, bits = done.stdout.split()
    return ours, plain, int(bits)


@pytest.mark.slow
@pytest.mark.skipif(not X86, reason="registers of x86")
@pytest.mark.parametrize(("setting", "expected"), [("", ("zmm", 512)), ("256", ("ymm", 256))])
def test_kernels_use_the_vectors_that_llvm_holds_back_on_intel_and_no_other_function_does(setting, expected):
    ours, plain, bits = widest_registers(**INTEL, THALWEG_VECTOR_BITS=setting)
    assert (ours, bits) == expected
    assert plain == "ymm"


@pytest.mark.slow
@pytest.mark.skipif(not X86, reason="registers of x86")
def test_the_stated_width_is_that_of_the_code_on_this_processor():
    ours, _, bits = widest_registers()
    assert {"zmm": 512, "ymm": 256, "xmm": 128}[ours] == bits == vector_bits()


GATHERING = """
import numba, numpy as np
from thalweg.core.compute import jit, kernel_compiler
jit.kernel_cache_dir = lambda: None
def look_up(table, at, out):
    for i in range(len(out)):
        out[i] = table[np.uint32(at[i])] * np.float32(2)
for _ in range(2):
    compiled = jit.kernel(look_up, disjoint=True)
    compiled.compile((numba.float32[::1], numba.int32[::1], numba.float32[::1]))
    (code,) = compiled.inspect_asm().values()
    print("gather" in code)
    kernel_compiler.gathering_features = lambda: None
"""


@pytest.mark.slow
@pytest.mark.skipif(not X86, reason="instructions of x86")
def test_kernels_gather_where_llvm_alone_would_not():
    done = subprocess.run(
        [sys.executable, "-c", GATHERING], env={**os.environ, **AMD}, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["True", "False"]


def test_an_unknown_width_of_vectors_is_refused(monkeypatch):
    monkeypatch.setenv("THALWEG_VECTOR_BITS", "333")
    with pytest.raises(ValueError, match="THALWEG_VECTOR_BITS = '333': choose one of 256, 512"):
        preferred_vector_bits()


@pytest.mark.parametrize("change", ["width", "numba", "python"])
def test_the_hash_of_the_machine_follows_what_compiled_code_depends_on(monkeypatch, change):
    monkeypatch.setenv("THALWEG_VECTOR_BITS", "512")
    before = machine_hash()
    if change == "width":
        monkeypatch.setenv("THALWEG_VECTOR_BITS", "256")
    elif change == "numba":
        monkeypatch.setattr(numba, "__version__", "9.9.9")
    else:
        monkeypatch.setattr(sys, "version", "9.9.9")
    assert machine_hash() != before


CACHE_USE = """
import numpy as np
from thalweg.core.compute import jit
from thalweg.render.kernels.camera_rays import Rays, row_rays
from thalweg.render.records.view import PosedCamera
camera = PosedCamera(*(np.float32(1) for _ in range(15)), 4, 4)
row_rays(camera, 0, 0, np.float32(1), Rays(*np.empty((3, 4), np.float32)), 4)
hits, misses = row_rays.stats.cache_hits, row_rays.stats.cache_misses
print(jit.PACKAGE, jit.kernel_cache_dir(), sum(hits.values()), sum(misses.values()), sep="\\n")
"""


def cache_use(python: Path | str, package: Path, cache: Path) -> list[str]:
    """The folders of the package and of its kernels, and how many kernels were found and how many compiled."""
    others = [path for path in sys.path if path and Path(path) != PACKAGE.parent]
    env = {**os.environ, "THALWEG_CACHE": str(cache), "PYTHONPATH": os.pathsep.join([str(package.parent), *others])}
    done = subprocess.run([python, "-c", CACHE_USE], env=env, capture_output=True, text=True, check=True, cwd=cache)
    return done.stdout.split()


@pytest.mark.slow
def test_another_clone_in_another_virtual_environment_uses_the_compiled_kernels(tmp_path):
    cache, clone, environment = tmp_path / "cache", tmp_path / "clone" / "thalweg", tmp_path / "environment"
    cache.mkdir()
    shutil.copytree(PACKAGE, clone, ignore=shutil.ignore_patterns("__pycache__"))
    first = clone / "render" / "kernels" / "camera_rays.py"
    first.write_text("# A comment moves every line.\n" + first.read_text(encoding="utf-8"), encoding="utf-8")
    venv.create(environment, symlinks=os.name != "nt")
    python = environment / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    here = cache_use(sys.executable, PACKAGE, cache)
    there = cache_use(python, clone, cache)
    assert (here[0], there[0]) == (str(PACKAGE), str(clone))
    assert here[1] == there[1]
    assert here[2:] == ["0", "1"]
    assert there[2:] == ["1", "0"]
