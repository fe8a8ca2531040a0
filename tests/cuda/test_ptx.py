"""Tests that every kernel, compiled for a Hopper GPU, needs registers only and computes in single precision."""

import os
import re

import pytest

if "CI" not in os.environ:  # `make test-slow` installs it; there its absence is an error
    pytest.importorskip("numba_cuda", reason="needs numba-cuda: pip install -r requirements-cuda.lock")

from numba import cuda, float32, types

from benchmarks import registers
from thalweg.bench.csv_files import read_csv

DOUBLE = {
    *("place_cameras", "advance", "advance_boats", "advance_pushed", "advance_pushed_boats", "see", "see_boats"),
    *("see_in_task", "props"),
}
"""Kernels in double precision: the rules, and those that compute with poses."""
MOST_REGISTERS, LEAST_OCCUPANCY = 136, 0.18
"""Greatest number of registers of a kernel, and the least share of the threads that a multiprocessor could have."""
HULL_REGISTERS, HULL_OCCUPANCY = 208, 0.12
"""The same of kernels that follow the outline of a boat's hull."""


def in_single_precision(ptx: str) -> bool:
    return not re.search(r"\.f64\b", ptx)


@pytest.mark.slow
@pytest.mark.parametrize("name", registers.variants())
def test_a_kernel_needs_no_local_memory_and_no_double_precision(name: str):
    variant = registers.variants()[name]
    ptx = registers.ptx_of(variant)
    assert ".target sm_90" in ptx and "st.global" in ptx
    found = registers.resource_usage(ptx)
    assert found["stack_bytes"] == found["spilled_bytes"] == 0
    # With more, too few threads would be at work at once to hide how long memory takes.
    hull = name.startswith("advance") and name.endswith("_boats")
    assert 0 < found["registers"] <= (HULL_REGISTERS if hull else MOST_REGISTERS)
    occupancy = registers.occupancy(found["registers"], variant.threads)
    assert occupancy >= (HULL_OCCUPANCY if hull else LEAST_OCCUPANCY)
    assert in_single_precision(ptx) == (name not in DOUBLE)


def test_the_table_has_every_kernel_in_its_place():
    rows = read_csv(registers.TABLE, registers.COLUMNS)
    assert [row["kernel"] for row in rows] == list(registers.variants())


def test_spills_and_double_precision_are_detected():
    def indexed(numbers, out):
        kept = cuda.local.array(512, float32)
        for i in range(512):
            kept[i] = numbers[i]
        out[0] = kept[int(numbers[0])]

    def doubled(numbers, out):
        out[0] = numbers[0] * 0.1  # a Python literal is a double

    line = types.float32[::1]
    spilling, precise = (registers.ptx_of(registers.Variant(each, (line, line), 64)) for each in (indexed, doubled))
    assert registers.resource_usage(spilling)["stack_bytes"] == 2048
    assert not in_single_precision(precise) and in_single_precision(spilling)


def test_occupancy_counts_whole_blocks():
    assert registers.occupancy(32, 256) == 1.0
    assert registers.occupancy(128, 256) == 0.25
    assert registers.occupancy(97, 64) == 9 * 64 / 2048  # 104 registers a thread, 6,656 a block
