"""The machine and the package versions that are recorded beside every result."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from thalweg.core.cores import usable_cores

PACKAGES = ("thalweg", "numpy", "scipy", "numba", "torch", "gymnasium")
"""Packages that results may depend on."""


def package_versions() -> dict[str, str]:
    """Return the versions of Python and of `PACKAGES`; a package that is not installed is "unknown"."""
    return {"python": platform.python_version()} | {name: package_version(name) for name in PACKAGES}


def gpu_info(device: str | None = None) -> dict[str, str]:
    """Return the name of the GPU `device`, such as cuda:1, None for PyTorch's current one, and the versions of CUDA and
    numba-cuda."""
    import torch  # only called where a GPU is used

    return {
        "card": torch.cuda.get_device_name(device),
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
