"""Kernels are compiled once, as a whole; tests that call them in every way, from Python and from compiled functions."""

import os
import subprocess
import sys

import numba
import numpy as np
import pytest

from thalweg.core.compute import kernel_compiler
from thalweg.core.compute.jit import kernel


@kernel
def third(x):
    return x / 3.0


@kernel
def half_of_third(x):
    return 0.5 * third(x)


@kernel
def root(x):
    if x < 0.0:
        raise ValueError("negative", x)
    return np.sqrt(x)


@kernel
def third_of_root(x):
    return third(root(x))


@kernel
def reduced(x):
    # LLVM drops this call, and would drop all that it calls if that were linked right behind it.
    if x - x > 1.0:
        return half_of_third(x)
    return root(third_of_root(x))


def test_a_kernel_that_calls_others_computes_what_python_computes():
    np.testing.assert_allclose(reduced(81.0), np.sqrt(3.0), rtol=1e-15)


def test_only_what_python_calls_becomes_machine_code():
    @kernel
    def inner(x):
        return x + 1.0

    @kernel
    def outer(x):
        return inner(x) * 2.0

    assert outer(2.0) == 6.0
    assert outer.signatures == [(numba.float64,)]
    assert inner.signatures == []
    assert inner(2.0) == 3.0
    assert inner.signatures == [(numba.float64,)]


def test_an_error_of_an_inner_kernel_reaches_python_with_its_values():
    @kernel
    def outer(x):
        return root(x) + 1.0

    assert outer(4.0) == 3.0
    with pytest.raises(ValueError, match="negative") as caught:
        outer(-2.5)
    assert caught.value.args == ("negative", -2.5)


def test_functions_that_are_no_kernels_call_kernels_with_all_that_these_call():
    @numba.njit
    def plain(x):
        return reduced(x) + third(x)

    np.testing.assert_allclose(plain(81.0), np.sqrt(3.0) + 27.0, rtol=1e-15)


def test_a_function_that_is_not_linked_is_an_error_and_no_call_of_address_zero(monkeypatch):
    @kernel
    def inner(x):
        return x + 1.0

    @kernel
    def outer(x):
        return inner(x)

    monkeypatch.setattr(kernel_compiler, "callers_first", lambda libraries: [])
    with pytest.raises(AssertionError, match=r"called by .*outer are not linked: .*inner"):
        outer(1.0)


class Library(kernel_compiler.Part):
    """A part that calls others, and has no code."""

    def __init__(self, *called):
        self._linking_libraries = list(called)


def test_callers_are_linked_before_what_they_call_and_each_once():
    shared = Library()
    middle, early = Library(shared), Library(shared)
    late = Library(early, middle)
    names = {id(shared): "shared", id(middle): "middle", id(early): "early", id(late): "late"}
    ordered = [names[id(library)] for library in kernel_compiler.callers_first([early, shared, late, early])]
    assert ordered[0] == "late"
    assert ordered[-1] == "shared"
    assert sorted(ordered) == sorted(names.values())


STORED = """
import numpy as np
from thalweg.core.compute import jit
from thalweg.render.kernels.plants import tiles
made = tiles.empty_tiles(8, 8, 1)
depth = np.arange(128, dtype=np.float32).reshape(8, 16)
{first}
tiles.load_depths(depth, 8, 1, made)
print(float(made.depth.sum()), *sorted(file.name.split("-")[0] for file in jit.kernel_cache_dir().rglob("*.nbc")))
"""


@pytest.mark.slow
def test_what_is_stored_is_what_python_calls(tmp_path):
    env = {**os.environ, "THALWEG_CACHE": str(tmp_path)}
    for first in ("", "tiles.pixel_of(1, 1, 2, 1, 0, 0)"):
        code = STORED.format(first=first)
        done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True)
        found, *files = done.stdout.split()
        assert float(found) == sum(r * 16 + c for r in range(8) for c in range(8))
        assert files == ["tiles.empty_tiles", "tiles.load_depths"] + (["tiles.pixel_of"] if first else [])
