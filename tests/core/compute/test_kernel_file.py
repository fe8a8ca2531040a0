"""Tests of stored kernels: damaged files, full disks and processes that store at once cost time, nothing else."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from thalweg.core.compute.kernel_file import KernelFile

JOB = """
import errno, sys
from numba.core.caching import IndexDataCacheFile
from thalweg.core.compute import jit

@jit.kernel
def double(x):
    return x + x

@jit.kernel
def triple(x):
    return x + x + x

if "full" in sys.argv:
    def full(self, path):
        raise OSError(errno.ENOSPC, "No space left on device")
    IndexDataCacheFile._open_for_write = full
print(double(21), triple(2), double(1.25))
print(sum(double.stats.cache_hits.values()), sum(double.stats.cache_misses.values()))
"""


@pytest.fixture
def job(tmp_path: Path) -> Path:
    (tmp_path / "job.py").write_text(JOB)
    return tmp_path / "job.py"


def run(job: Path, *options: str) -> tuple[str, list[int], str]:
    """Run the job; returns what its kernels computed, how many were found and how many compiled, and the warnings."""
    env = {**os.environ, "THALWEG_CACHE": str(job.parent / "cache")}
    done = subprocess.run([sys.executable, job, *options], env=env, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    computed, counts = done.stdout.splitlines()
    return computed, [int(count) for count in counts.split()], done.stderr


def stored(job: Path, ending: str) -> list[Path]:
    return sorted(job.parent.glob(f"cache/**/*double*{ending}"))


def spoil(file: Path, how: str) -> None:
    content = file.read_bytes()
    file.write_bytes({"empty": b"", "half": content[: len(content) // 2], "zeros": bytes(len(content))}[how])


@pytest.mark.parametrize("how", ["empty", "half", "zeros"])
@pytest.mark.parametrize("ending", [".nbi", ".1.nbc"])
def test_what_a_damaged_file_held_is_missing_until_it_is_stored_again(ending: str, how: str, tmp_path: Path):
    file = KernelFile(str(tmp_path), "kernel", "stamp")
    file.save("int64", "code")
    spoil(tmp_path / f"kernel{ending}", how)
    assert file.load("int64") is None
    file.save("int64", "code")
    assert file.load("int64") == "code"


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".nbi", ".1.nbc"])
def test_a_kernel_whose_file_is_empty_is_compiled_again(ending: str, job: Path):
    assert run(job)[:2] == ("42 6 2.5", [0, 2])
    for file in stored(job, ending):
        spoil(file, "empty")
    assert run(job)[0] == "42 6 2.5"
    assert run(job)[:2] == ("42 6 2.5", [2, 0])


@pytest.mark.slow
def test_code_of_another_signature_is_never_run(job: Path):
    run(job)
    first, second = stored(job, ".nbc")
    first.write_bytes(second.read_bytes())  # as two processes leave it that store two signatures at once
    assert run(job)[:2] == ("42 6 2.5", [1, 1])
    assert run(job)[:2] == ("42 6 2.5", [2, 0])


@pytest.mark.slow
def test_a_full_disk_costs_time_and_is_told_once(job: Path):
    computed, counts, told = run(job, "full")
    assert (computed, counts) == ("42 6 2.5", [0, 2])
    assert told.count("compiled kernels can't be stored in") == 1 and "No space left on device" in told


def test_two_processes_that_store_two_signatures_at_once_find_their_own_or_none(tmp_path: Path):
    one, other = (KernelFile(str(tmp_path), "kernel", "stamp") for _ in range(2))
    index = one._load_index

    def stored_meanwhile() -> dict:
        found = index()
        other.save("float64", "code for float64")
        return found

    one._load_index = stored_meanwhile  # type: ignore[method-assign]
    one.save("int64", "code for int64")
    one._load_index = index  # type: ignore[method-assign]
    assert one.load("int64") == "code for int64"
    assert other.load("float64") is None
    other.save("float64", "code for float64")
    assert [one.load(key) for key in ("int64", "float64")] == ["code for int64", "code for float64"]


OUTSIDE = """
from thalweg.core.compute import jit

@jit.kernel
def scaled(x):
    return x * {factor}

print(scaled(21.0), sum(scaled.stats.cache_hits.values()))
"""


def test_a_kernel_outside_the_package_is_compiled_again_when_its_file_changes(tmp_path: Path):
    file, env = tmp_path / "own.py", {**os.environ, "THALWEG_CACHE": str(tmp_path / "cache")}
    printed = []
    for factor in (2.0, 2.0, 3.0):  # a constant is no part of the bytecode, by which Numba tells functions apart
        file.write_text(OUTSIDE.format(factor=factor))
        done = subprocess.run([sys.executable, file], env=env, capture_output=True, text=True, check=True)
        printed.append(done.stdout.split())
    assert printed == [["42.0", "0"], ["42.0", "1"], ["63.0", "0"]]
