"""Tests of memory that is kept when it is freed."""

import os
import subprocess
import sys

import pytest

FAULTS = """
import resource
from thalweg.core.compute.heap import keep_freed_memory

def page_faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(5):
        bytearray(48 << 20)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

first = page_faults()
kept = keep_freed_memory()
page_faults()
print(kept, first, page_faults(), resource.getpagesize())
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="glibc is a library of Linux")
def test_blocks_that_are_freed_are_not_mapped_anew():
    own = {name: value for name, value in os.environ.items() if not name.startswith(("MALLOC_", "GLIBC_"))}
    run = subprocess.run([sys.executable, "-c", FAULTS], env=own, capture_output=True, text=True, check=True)
    kept, before, after, page = run.stdout.split()
    if kept == "False":
        pytest.skip("this C library keeps no more than it does anyway")
    assert int(before) >= 5 * (48 << 20) // int(page)
    assert int(after) < 100
