"""The same source compiled for a GPU of the Hopper kind, without having one: registers only, and single precision."""

import os
import re
from collections.abc import Callable

import numba
import pytest

if "CI" not in os.environ:  # `make test` installs it; there its absence is an error
    pytest.importorskip("numba_cuda", reason="needs numba-cuda: pip install -r requirements-cuda.lock")

from numba import cuda, float32, int64, types, uint32
from numba.cuda import dispatcher

from tests.render.cuda import cases, one_pixel
from thalweg.render.scene import build_scene

LINE = types.float32[::1]
PLANE, SPACE = types.float32[:, ::1], types.float32[:, :, ::1]
CLASSES, IMAGE = types.int32[:, ::1], types.uint32[:, ::1]


class Hopper:
    compute_capability = (9, 0)


@pytest.fixture(autouse=True)
def _no_device_is_needed(monkeypatch: pytest.MonkeyPatch):
    """Functions called from a kernel ask which device they are compiled for; here nobody else could answer."""
    monkeypatch.setattr(dispatcher, "get_current_device", Hopper)


def compiled(function: Callable, *arguments: types.Type) -> str:
    ptx, _ = cuda.compile_ptx(function, types.void(*arguments), cc=Hopper.compute_capability, fastmath=True)
    return ptx


def stays_in_registers(ptx: str) -> bool:
    return ".local" not in ptx and not re.search(r"\.f64\b", ptx)


@pytest.mark.slow
def test_a_pixel_is_traced_and_shaded_in_registers_alone():
    scene = numba.typeof(build_scene([cases.world()]))
    arguments = (
        scene, int64, LINE, float32, LINE, types.boolean, types.int32[::1], LINE, SPACE, PLANE, CLASSES, PLANE
    )  # fmt: skip
    ptx = compiled(one_pixel.trace, *arguments)
    assert ".target sm_90" in ptx
    assert ptx.count("ld.global") > 100
    assert stays_in_registers(ptx)


def test_a_pixel_on_an_outline_is_softened_in_registers_alone():
    scene = numba.typeof(build_scene([cases.world()]))
    ptx = compiled(one_pixel.soften, scene, int64, LINE, LINE, PLANE, CLASSES, PLANE, SPACE, SPACE)
    assert "st.global" in ptx
    assert stays_in_registers(ptx)


def test_a_pixel_is_developed_in_registers_alone():
    ptx = compiled(one_pixel.tone_frame, SPACE, CLASSES, PLANE, float32, LINE, uint32, types.uint32[::1], IMAGE)
    assert "st.global" in ptx
    assert stays_in_registers(ptx)


def test_a_kernel_that_spills_or_computes_in_double_precision_is_noticed():
    def indexed(numbers, out):
        kept = cuda.local.array(64, float32)
        for i in range(64):
            kept[i] = numbers[i]
        out[0] = kept[int(numbers[0])]

    def doubled(numbers, out):
        out[0] = numbers[0] * 0.1  # a Python literal is a double

    assert not stays_in_registers(compiled(indexed, LINE, LINE))
    assert not stays_in_registers(compiled(doubled, LINE, LINE))
