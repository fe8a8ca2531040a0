"""The machine and the package versions that are recorded beside every result."""

import math
import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

GROUPS = Path("/sys/fs/cgroup")
"""Folder of the Linux control groups, by which containers limit the time of processors."""
PROC = Path("/proc")
PACKAGES = ("thalweg", "numpy", "scipy", "numba", "torch", "gymnasium")
"""Packages that results may depend on."""


def package_versions() -> dict[str, str]:
    """Return the versions of Python and of `PACKAGES`; a package that is not installed is "unknown"."""
    return {"python": platform.python_version()} | {name: package_version(name) for name in PACKAGES}


def gpu_info() -> dict[str, str]:
    """Return the name of PyTorch's current GPU and the versions of CUDA and numba-cuda."""
    import torch  # only called where a GPU is used

    return {
        "card": torch.cuda.get_device_name(),
        "cuda": str(torch.version.cuda),
        "numba-cuda": package_version("numba-cuda"),
    }


def machine_info() -> dict[str, str | int]:
    """Return the processor, its type as LLVM names it, the width in bits of the vectors in compiled kernels, the cores
    this process may use, the memory in GiB and the system."""
    from llvmlite import binding

    from thalweg.core.compute.kernel_compiler import vector_bits  # takes a second to import

    return {
        "cpu": _cpu(),
        "cpu_type": binding.get_host_cpu_name(),
        "vector_bits": vector_bits(),
        "cores": usable_cores(),
        "memory_gib": _memory_gib(),
        "system": f"{platform.system()} {platform.machine()}",
    }


def usable_cores() -> int:
    """Return the number of cores this process may use, rounded up where a container limits their time."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    limit = container_cores(PROC, GROUPS)
    return cores if limit is None else max(min(cores, math.ceil(limit)), 1)


def container_cores(proc: Path, groups: Path) -> float | None:
    """Return the smallest limit of the control groups of this process, in cores; None without a limit.

    `cpu.max` of version 2 has the time and the period, or `max`; version 1 has a file for each, and a time of -1.
    """
    try:
        lines = (proc / "self" / "cgroup").read_text().splitlines()
    except OSError:
        return None
    limits = []
    for _, controllers, group in (line.split(":", 2) for line in lines if line.count(":") >= 2):
        if controllers and "cpu" not in controllers.split(","):
            continue
        root = groups / controllers
        innermost = root / group.strip("/")
        for folder in (innermost, *innermost.parents):
            limits.append(_limit_of_group(folder))
            if folder == root:
                break
    return min((limit for limit in limits if limit is not None), default=None)


def _limit_of_group(folder: Path) -> float | None:
    """Return the cores of a control group, None for one without a limit."""
    for names in (("cpu.max",), ("cpu.cfs_quota_us", "cpu.cfs_period_us")):
        try:
            time_us, period_us = " ".join((folder / name).read_text() for name in names).split()
            return int(time_us) / int(period_us) if time_us not in ("max", "-1") else None
        except (OSError, ValueError, ZeroDivisionError):
            pass
    return None


def package_version(package: str) -> str:
    """Return the version of a package, "unknown" where it is not installed, as in a copy of the sources."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"


def _cpu() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def _memory_gib() -> int:
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30)
    except (AttributeError, ValueError, OSError):  # Windows has no sysconf
        return 0
