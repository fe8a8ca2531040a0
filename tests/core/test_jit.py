"""Tests of compiled kernels: vectorised loops, the cache folder, and the sources that key it."""

import os
import subprocess
import sys

import numpy as np
import pytest
from numba.core.errors import NumbaError

from thalweg.core import jit
from thalweg.core.cache import PACKAGE
from thalweg.core.jit import kernel, kernel_sources


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
    monkeypatch.setattr("thalweg.core.jit.kernel_cache_dir", lambda: None)


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
        "from thalweg.core.jit import kernel\n@kernel\ndef double(x):\n    return x + x\nprint(double(21.0))\n"
    )
    env = {**os.environ, "THALWEG_CACHE": str(tmp_path / folder)}
    done = subprocess.run([sys.executable, str(script)], env=env, capture_output=True, text=True, timeout=120)
    assert done.stdout == "42.0\n", done.stderr
    cached = list(tmp_path.glob("mine/**/*.nbi"))
    assert bool(cached) == (folder == "mine")
    assert not list((tmp_path / "__pycache__").glob("*.nbi"))


def test_kernel_sources_include_direct_and_indirect_imports():
    sources = {path.relative_to(PACKAGE).as_posix() for path in kernel_sources()}
    assert {"core/jit.py", "render/kernels/frame.py", "env/task/rules.py", "world/light/sun_shadow.py"} <= sources
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
