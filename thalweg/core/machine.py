"""With what were these figures made? The machine and the versions that lie beside every result."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PARTS = ("thalweg", "numpy", "scipy", "numba", "torch", "gymnasium")
"""Packages that numbers depend on."""


def versions() -> dict[str, str]:
    """Versions of Python and of `PARTS`; one that is not installed as a package is unknown."""
    return {"python": platform.python_version()} | {part: _version(part) for part in PARTS}


def card() -> dict[str, str]:
    """The GPU that torch uses, and what its kernels are made with."""
    import torch  # which says so only where there is one

    return {"card": torch.cuda.get_device_name(), "cuda": str(torch.version.cuda), "numba-cuda": _version("numba-cuda")}


def _version(part: str) -> str:
    try:
        return version(part)
    except PackageNotFoundError:
        return "unknown"


def machine() -> dict[str, str | int]:
    """Processor, cores this process may use, system; the memory in GiB."""
    return {
        "cpu": _cpu(),
        "cores": cores(),
        "memory_gib": _memory_gib(),
        "system": f"{platform.system()} {platform.machine()}",
    }


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


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
    except (ValueError, OSError):
        return 0
