"""The number of cores that this process may use, which a container may limit."""

import math
import os
from collections.abc import Iterator
from pathlib import Path

GROUPS = Path("/sys/fs/cgroup")
"""Folder of the Linux control groups, by which containers limit the time of processors."""
PROC = Path("/proc")


def usable_cores() -> int:
    """Return the number of cores this process may use, rounded up where a container limits their time."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    limit = container_cores(PROC, GROUPS)
    return cores if limit is None else max(min(cores, math.ceil(limit)), 1)


def container_cores(proc: Path, groups: Path) -> float | None:
    """Return the smallest limit of the control groups of this process, in cores; None without a limit.

    `cpu.max` of version 2 has the time and the period, or `max`; version 1 has a file for each, and a time of -1.
    """
    folders = control_groups(proc, groups)
    limits = [_limit_of_group(folder) for names, folder in folders if not names or "cpu" in names.split(",")]
    return min((limit for limit in limits if limit is not None), default=None)


def control_groups(proc: Path, groups: Path) -> Iterator[tuple[str, Path]]:
    """Yield the folders of the control groups of this process, of each hierarchy from the innermost to its root.

    With each come the names of the controllers of its hierarchy, separated by commas: empty in version 2.
    """
    try:
        lines = (proc / "self" / "cgroup").read_text().splitlines()
    except OSError:
        return
    for _, controllers, group in (line.split(":", 2) for line in lines if line.count(":") >= 2):
        root = groups / controllers
        innermost = root / group.strip("/")
        for folder in (innermost, *innermost.parents):
            yield controllers, folder
            if folder == root:
                break


def _limit_of_group(folder: Path) -> float | None:
    """Return the cores of a control group, None for one without a limit."""
    for names in (("cpu.max",), ("cpu.cfs_quota_us", "cpu.cfs_period_us")):
        try:
            time_us, period_us = " ".join((folder / name).read_text() for name in names).split()
            return int(time_us) / int(period_us) if time_us not in ("max", "-1") else None
        except (OSError, ValueError, ZeroDivisionError):
            pass
    return None
