"""Registers and spills of each kernel on a Hopper GPU, compiled without having one.

    python benchmarks/registers.py
    python benchmarks/registers.py advance see_boats    # these kernels alone

writes registers.csv, with the multiprocessor's share that can be at work at once. It needs requirements-cuda.lock. A
row is written as its kernel is compiled, in place of an earlier one.
"""

import argparse
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numba
import numpy as np
from numba import cuda, types
from numba.cuda import dispatcher

from thalweg.env.config import EnvConfig
from thalweg.env.device import cuda_step as rules
from thalweg.env.device.step import reset_arguments
from thalweg.env.forces.arrays import empty_forces, force_numbers
from thalweg.env.task.course_arrays import pack_courses
from thalweg.env.task.rules import State, empty_outcome, empty_state
from thalweg.render.gpu import ground_profiles, pixel, posed_props, postprocess, tile, visible_plants
from thalweg.render.kernels.camera_rays import Radiance
from thalweg.render.records.scene import Scene
from thalweg.render.records.view import COLOURS, LAYERS, MASK, Buffers, FrameSettings, Views
from thalweg.world import load_or_build

# The repository, not the folder of this script: tests would take the `omnisafe` in there for the library.
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.tables import change

TABLE = Path(__file__).resolve().parent / "registers.csv"
COLUMNS = ("kernel", "registers", "stack_bytes", "spilled_bytes", "shared_bytes", "threads", "occupancy")
CAPABILITY = (9, 0)
REGISTERS, THREADS, WARP, STEP = 65536, 2048, 32, 8
"""Of a multiprocessor of that capability: its registers and threads, the threads of a warp, and the step in which a
thread is given registers."""

FLOAT, DOUBLE, UINT, BYTE = types.float32, types.float64, types.uint32, types.uint8
LINE, PLANE, SPACE, FOUR = FLOAT[::1], FLOAT[:, ::1], FLOAT[:, :, ::1], FLOAT[:, :, :, ::1]
INTS = types.int32[::1]
VIEWS = types.NamedTuple((types.int64[::1], DOUBLE[:, ::1], DOUBLE[::1], PLANE), Views)
SETTINGS = types.NamedTuple((types.int64, types.int64, FLOAT, types.boolean), FrameSettings)
FOUND = types.int32[:, ::1], PLANE, types.int16[:, :, ::1], INTS
"""Order, distance, boxes and counts of the plants in view."""
CORNERS = types.int32[:, :, ::1]
POSED = SPACE, CORNERS, CORNERS, CORNERS, INTS
"""Parts, numbers, boxes, zones and counts of the props in view."""
SEEN = "world", "pose", "segment", "travel"
"""Arrays of a state that the ideal eye needs."""
KINDS = BYTE[:, :, ::1]
BUFFERS = types.NamedTuple((SPACE, KINDS, SPACE, SPACE, SPACE, SPACE, SPACE, SPACE), Buffers)
RADIANCE = types.NamedUniTuple(SPACE, 3, Radiance)
TABLES: dict[str, Any] = {
    "extents": types.int32[:, ::1], "constants": PLANE, "plants": PLANE, "bridges": PLANE, "shade": PLANE,
    "outlines": PLANE, "chunks": PLANE, "autumn": PLANE, "atlas_level": types.int64[::1], "paint": UINT[::1],
    "top": UINT[::1], "depth": UINT[::1],
    "canopy": UINT[::1], "canopy_paint": UINT[::1], "sky": UINT[::1], "clouds": UINT[::1], "ripples": UINT[::1],
    "atlas": UINT[::1],
}  # fmt: skip
SCENE = types.NamedTuple([TABLES.get(name, LINE) for name in Scene._fields], Scene)


class Variant(NamedTuple):
    """A kernel with the types of its arguments, the threads of a block, and its arithmetic."""

    function: Callable
    arguments: tuple[Any, ...]
    threads: int
    fastmath: bool = True


def rule_types() -> tuple[Any, ...]:
    """Return the argument types of the rules' kernel, as `TensorRiverEnv` passes them."""
    config = EnvConfig()
    courses = pack_courses([load_or_build("Easy", 0)], config)
    ints, bytes_ = np.zeros(1, np.int64), np.zeros(1, np.uint8)
    state, outcome = empty_state(ints, courses), empty_outcome(1)
    reset = reset_arguments(config, ints, ints, ints, 1)
    return tuple(numba.typeof(each) for each in (state.pose, courses, config.limits, reset, state, outcome, bytes_))


def pushed_types() -> tuple[Any, ...]:
    """Return the argument types of the rules' kernel under wind, current and inertia."""
    actions, courses, limits, reset, state, outcome, ended = rule_types()
    forces, force_state = numba.typeof(force_numbers(EnvConfig())), numba.typeof(empty_forces(1))
    return actions, courses, limits, forces, reset, state, force_state, outcome, ended


def eye_types() -> tuple[Any, ...]:
    """Return the argument types of the ideal eye's kernel, as `TensorRiverEnv` passes them."""
    _, courses, _, _, state, *_ = rule_types()
    world, pose, segment, travel = (dict(zip(State._fields, state.types, strict=True))[name] for name in SEEN)
    return courses, types.float64, world, pose, segment, travel, PLANE


def boat_eye_types() -> tuple[Any, ...]:
    """Return the argument types of the kernel of the boat's ideal eye, as `TensorRiverEnv` passes them."""
    _, courses, limits, _, state, *_ = rule_types()
    world, pose = (dict(zip(State._fields, state.types, strict=True))[name] for name in SEEN[:2])
    return courses, limits, world, pose, PLANE


def task_eye_types() -> tuple[Any, ...]:
    """Return the argument types of the kernel of the ideal eye in a task."""
    _, courses, limits, _, state, *_ = rule_types()
    fields = dict(zip(State._fields, state.types, strict=True))
    return courses, limits, *(fields[name] for name in (*SEEN, "steps", "scene", "station")), PLANE


def props_types() -> tuple[Any, ...]:
    """Return the argument types of the kernel of a task's objects."""
    _, courses, limits, _, state, *_ = rule_types()
    fields = dict(zip(State._fields, state.types, strict=True))
    return courses, limits, *(fields[name] for name in ("world", "pose", "steps", "scene", "station")), SPACE


def variants() -> dict[str, Variant]:
    """Return every kernel of a frame, in every form that `GpuRenderer` launches, and those of rules and ideal eye."""
    trace = (SCENE, VIEWS, PLANE, LINE, SPACE, types.Tuple(FOUND), types.Tuple((SPACE, *POSED)), BUFFERS)
    add = (SCENE, VIEWS, PLANE, BUFFERS, FOUR, LINE)
    kernels = {
        "place_cameras": Variant(
            visible_plants.place_cameras, (VIEWS, SETTINGS, PLANE, LINE, UINT[::1]), visible_plants.THREADS
        ),
        "find_nearness": Variant(
            ground_profiles.find_nearness, (SCENE, VIEWS, SETTINGS, PLANE, SPACE), ground_profiles.THREADS
        ),
        "find": Variant(visible_plants.find, (SCENE, VIEWS, SETTINGS, PLANE, *FOUND), visible_plants.THREADS),
        "pose": Variant(posed_props.pose, (SCENE, VIEWS, SETTINGS, PLANE, LINE, SPACE, *POSED), posed_props.THREADS),
    }
    for fast in (False, True):
        quality = "fast" if fast else "full"
        for drawn, what in ((COLOURS, ""), (LAYERS, ", no colours"), (MASK, ", mask")):
            kernels[f"trace, {quality}{what}"] = Variant(pixel.tracer(fast, drawn), trace, tile.THREADS)
            kernels[f"trace, {quality}{what}, props"] = Variant(pixel.tracer(fast, drawn, True), trace, tile.THREADS)
        kernels[f"add_up, {quality}"] = Variant(postprocess.adder(fast), add, postprocess.THREADS)
    kernels["tone_map"] = Variant(
        postprocess.tone_map,
        (RADIANCE, KINDS, SPACE, PLANE, UINT[::1], LINE, UINT[::1], UINT[:, :, ::1]),
        postprocess.THREADS,
    )
    kernels["advance"] = Variant(rules.advance, rule_types(), rules.THREADS, fastmath=False)
    kernels["advance_boats"] = Variant(rules.advance_boats, rule_types(), rules.THREADS, fastmath=False)
    for name in ("advance_pushed", "advance_pushed_boats"):
        kernels[name] = Variant(getattr(rules, name), pushed_types(), rules.THREADS, fastmath=False)
    kernels["see_in_task"] = Variant(rules.see_in_task, task_eye_types(), rules.THREADS, fastmath=False)
    kernels["props"] = Variant(rules.props, props_types(), rules.THREADS, fastmath=False)
    kernels["see"] = Variant(rules.see, eye_types(), rules.THREADS, fastmath=False)
    kernels["see_boats"] = Variant(rules.see_boats, boat_eye_types(), rules.THREADS, fastmath=False)
    kernels["write_layers"] = Variant(postprocess.write_layers, (BUFFERS, SPACE, KINDS, KINDS), postprocess.THREADS)
    kernels["write_mask"] = Variant(postprocess.write_mask, (BUFFERS, KINDS), postprocess.THREADS)
    return kernels


class Hopper:
    """The properties of a device that the compiler queries, in place of a real one."""

    compute_capability = CAPABILITY


def ptx_of(variant: Variant) -> str:
    """Return the PTX code of a kernel."""
    with mock.patch.object(dispatcher, "get_current_device", Hopper):
        ptx, _ = cuda.compile_ptx(  # pyright: ignore[reportPrivateImportUsage]
            variant.function, types.void(*variant.arguments), cc=CAPABILITY, fastmath=variant.fastmath
        )
    return ptx


def resource_usage(ptx: str) -> dict[str, int]:
    """Return the registers of a thread, the bytes of its stack and spills, and the shared bytes of a block, as reported
    by NVIDIA's assembler."""
    packages = find_spec("nvidia")  # not imported: type checks run without requirements-cuda.lock
    folders = packages.submodule_search_locations if packages else None
    if not folders:
        raise SystemExit("NVIDIA's assembler is missing: pip install -r requirements-cuda.lock")
    assembler = next(path for folder in folders for path in Path(folder).glob("*/bin/ptxas"))
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "kernel.ptx"
        source.write_text(ptx)
        command = [assembler, "-v", "-arch=sm_90", "-o", Path(folder) / "kernel.cubin", source]
        report = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    stack, stored, loaded = map(
        int, re.findall(r"(\d+) bytes stack frame, (\d+) bytes spill stores, (\d+) bytes spill loads", report)[-1]
    )
    registers = int(re.findall(r"Used (\d+) registers", report)[-1])
    shared = re.findall(r"(\d+) bytes smem", report)
    return {
        "registers": registers,
        "stack_bytes": stack,
        "spilled_bytes": stored + loaded,
        "shared_bytes": int(shared[-1]) if shared else 0,
    }


def occupancy(registers: int, threads: int) -> float:
    """Return the share of a multiprocessor's threads that can run at once given its registers, in whole blocks."""
    each = -(-registers // STEP) * STEP * WARP
    blocks = REGISTERS // (each * (threads // WARP))
    return min(blocks * threads, THREADS) / THREADS


def main() -> int:
    kernels = variants()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kernels", nargs="*", metavar="KERNEL", help=f"of these, by default all: {', '.join(kernels)}")
    chosen = parser.parse_args().kernels or list(kernels)
    if unknown := [name for name in chosen if name not in kernels]:
        parser.error(f"there is no kernel {unknown[0]!r}; choose from {', '.join(kernels)}")
    for name in chosen:
        found = resource_usage(ptx_of(kernels[name]))
        share = occupancy(found["registers"], kernels[name].threads)
        row = {"kernel": name, **found, "threads": kernels[name].threads, "occupancy": f"{share:.2f}"}
        print(*row.values(), flush=True)
        change(TABLE, COLUMNS, lambda rows, row=row: in_order([*rows, row], list(kernels)))
    return 0


def in_order(rows: Iterable[Mapping[str, Any]], kernels: Sequence[str]) -> list[Mapping[str, Any]]:
    """Return the last row of each of the kernels, in their order; rows of others are dropped."""
    found = {row["kernel"]: row for row in rows}
    return [found[name] for name in kernels if name in found]


if __name__ == "__main__":
    sys.exit(main())
