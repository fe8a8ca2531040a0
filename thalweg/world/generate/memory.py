"""The memory that building a world needs, estimated from its size and compared with the free memory.

The peak was measured for maps of 0.7 to 16 million nodes, see the constants. The estimate leaves out what the process
holds already and what frames of the world need later.
"""

import os
from pathlib import Path

import numpy as np

from thalweg.core.cores import GROUPS, PROC, control_groups
from thalweg.world.errors import WorldError
from thalweg.world.generate.terrain import make_grid

NODE_BYTES = 165
"""Bytes per node of the map while the light is baked: 144 to 162 were measured at the density of the levels."""
BARE_NODE_BYTES = 80
"""Bytes per node of the map while plants are scattered."""
TRIES_BYTES = 390
"""Bytes per square metre at a density of 1 while plants are scattered: the tried positions, most of them reeds."""


def needed_bytes(shape: tuple[int, int], cell_m: float, plant_density: float) -> int:
    """Return an upper bound of the peak memory for building a map of (GY, GX) nodes.

    The last term is the lattice of the finest noise: two float32 at every second node, over the square that the map may
    fill when it is rotated. It matters for long narrow maps only.
    """
    rows, columns = shape
    nodes = rows * columns
    scattered = BARE_NODE_BYTES * nodes + TRIES_BYTES * plant_density * nodes * cell_m**2
    return int(max(NODE_BYTES * nodes, scattered)) + (rows + columns) ** 2


def check_memory(position_m: np.ndarray, plant_density: float = 1.0) -> None:
    """Raise `WorldError` unless there is enough free memory to build the world around a line [S, 2]; allocates nothing.

    Also raised for a line whose map would be larger than the maximum. Where the free memory is unknown, as on Windows,
    all other lines pass.
    """
    grid, shape = make_grid(position_m)
    need, free = needed_bytes(shape, grid.cell_m, plant_density), free_bytes()
    if free is not None and need > free:
        plants = f", and plants of density {plant_density:g}" if plant_density > 0 else ""
        high, wide = (np.array(shape) - 1) * grid.cell_m
        raise WorldError(
            f"the map covers {wide:.0f} x {high:.0f} m with {shape[0] * shape[1] / 1e6:.1f} million nodes, "
            f"{grid.cell_m:.2f} m apart{plants}; to build it takes "
            f"{need / 1e9:.2f} GB of memory, and {free / 1e9:.2f} GB are free"
        )


def free_bytes() -> int | None:
    """Return the free memory: the smaller of the machine's and of what the process's containers may still use.

    None where neither is known.
    """
    limits = [value for value in (machine_bytes(), container_bytes()) if value is not None]
    return min(limits, default=None)


def machine_bytes(proc: Path = PROC) -> int | None:
    """Return the available memory on Linux, the total memory on other systems as an upper bound, or None."""
    try:
        for line in (proc / "meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None


def container_bytes(proc: Path = PROC, groups: Path = GROUPS) -> int | None:
    """Return the smallest remaining memory of the control groups (version 2) of this process; None without a limit.

    The file cache counts as free, because the kernel drops it when memory is needed.
    """
    remaining = []
    for controllers, folder in control_groups(proc, groups):
        if controllers:
            continue
        try:
            limit = (folder / "memory.max").read_text().strip()
            used = int((folder / "memory.current").read_text())
            stat = dict(line.split() for line in (folder / "memory.stat").read_text().splitlines())
            if limit != "max":
                remaining.append(max(int(limit) - used + int(stat.get("inactive_file", 0)), 0))
        except (OSError, ValueError):
            pass
    return min(remaining, default=None)
