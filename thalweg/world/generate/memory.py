"""Is there memory for a world? What building one takes, known from its size alone, against what is free.

The peak was measured: builds of maps of 0.7 to 16 million nodes, see the constants. What a process holds already, and
what frames of the world need later, is not in it.
"""

import os
from pathlib import Path

import numpy as np

from thalweg.world.errors import WorldError
from thalweg.world.generate.terrain import lay_grid

NODE_BYTES = 165
"""A node of the map, while the light is baked: 144 to 162 were measured at the density of the levels."""
BARE_NODE_BYTES = 80
"""A node of the map, while plants are scattered."""
TRIES_BYTES = 390
"""A square metre at a density of 1, while plants are scattered: the places that are tried, most of them for reeds."""
GROUPS = Path("/sys/fs/cgroup")
"""Where Linux shows the control groups (version 2) that containers are made of."""
PROC = Path("/proc")


def needed_bytes(shape: tuple[int, int], cell_m: float, plant_density: float) -> int:
    """An upper bound of what building a map of (GY, GX) nodes takes at its peak.

    The last term is the lattice of the finest noise: two float32 at every other node's distance, over the square that
    the map may fill when it is turned. It counts for long narrow maps only.
    """
    rows, columns = shape
    nodes = rows * columns
    scattered = BARE_NODE_BYTES * nodes + TRIES_BYTES * plant_density * nodes * cell_m**2
    return int(max(NODE_BYTES * nodes, scattered)) + (rows + columns) ** 2


def check_memory(position_m: np.ndarray, plant_density: float = 1.0) -> None:
    """Raise `WorldError` unless there is memory to build the world around a line [S, 2]; takes none itself.

    Also raised for a line whose map would be larger than any that is built. Where the free memory can't be told, as on
    Windows, all others pass.
    """
    grid, shape = lay_grid(position_m)
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
    """What can still be taken: of the machine's memory, and of what this process's containers may use.

    None where the system tells neither.
    """
    known = [value for value in (machine_bytes(), container_bytes()) if value is not None]
    return min(known, default=None)


def machine_bytes(proc: Path = PROC) -> int | None:
    """Linux: what is available without swapping; elsewhere all memory there is, which bounds it; else None."""
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
    """The least that any control group (version 2) round this process leaves it; None where none sets a limit.

    What files read earlier occupy counts as free, since it is given up when it is needed.
    """
    try:
        lines = (proc / "self" / "cgroup").read_text().splitlines()
    except OSError:
        return None
    own = next((line[3:] for line in lines if line.startswith("0::")), None)
    if own is None:
        return None
    folder, left = groups / own.strip("/"), []
    for place in (folder, *folder.parents):
        try:
            limit = (place / "memory.max").read_text().strip()
            used = int((place / "memory.current").read_text())
            stat = dict(line.split() for line in (place / "memory.stat").read_text().splitlines())
            if limit != "max":
                left.append(max(int(limit) - used + int(stat.get("inactive_file", 0)), 0))
        except (OSError, ValueError):
            pass
        if place == groups:
            break
    return min(left, default=None)
