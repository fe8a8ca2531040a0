"""Time of one step of each packaged policy: exported and run by ONNX Runtime, and by its own player in PyTorch.

    python benchmarks/export_speed.py            # writes export_speed.csv
    python benchmarks/export_speed.py --write    # also the table of docs/export.md

One vehicle, frames of noise, one thread. Both take turns, a hundred steps each, so that a change of the machine's speed
meets both.
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from page_sections import replace_section
from task_speed import in_turns

from thalweg.bench.csv_files import csv_text, read_csv
from thalweg.bench.packaged import PACKAGED_POLICIES
from thalweg.bench.report.table import frame, markdown
from thalweg.core.atomic_io import write_atomic
from thalweg.core.compute.torch_threads import torch_threads
from thalweg.core.machine import machine_info, package_version
from thalweg.deploy.export import export_policy
from thalweg.deploy.onnx_policy import OnnxPolicy
from thalweg.train import load_policy

HERE = Path(__file__).resolve().parent
TABLE, PAGE = HERE / "export_speed.csv", HERE.parent / "docs" / "export.md"
COLUMNS = ("policy", "file_mb", "onnx_ms", "torch_ms", "onnxruntime", "torch", "cpu_type")
STEPS, TURNS = 100, 10
SIDE_PX = 128


def repeated(step: Callable[[], object]) -> Callable[[], None]:
    """Return a function that makes `STEPS` steps."""

    def work() -> None:
        for _ in range(STEPS):
            step()

    return work


def measured(name: str, folder: Path) -> dict[str, str]:
    """Return the row of a packaged policy; its export is written to a folder."""
    path, policy = folder / f"{name}.onnx", load_policy(PACKAGED_POLICIES[name])
    export_policy(policy, path, source=PACKAGED_POLICIES[name], name=name)
    exported = OnnxPolicy.load(path).player()
    frames = np.random.default_rng(0).integers(0, 256, (1, SIDE_PX, SIDE_PX, 4), np.uint8)
    frames[..., 3] = np.where(frames[..., 3] < 128, 0, 255)
    seen = frames if "mask" in exported.policy.inputs else np.ascontiguousarray(frames[..., :3])
    image, mask = np.ascontiguousarray(frames[..., :3]), np.ascontiguousarray(frames[..., 3])
    own, fresh = policy.player(1, deterministic=True), np.zeros(1, bool)
    with torch_threads(1):
        works = [repeated(lambda: exported(image=image, mask=mask)), repeated(lambda: own(seen, fresh))]
        onnx_ms, torch_ms = 1e3 * np.median(in_turns(works, TURNS, time.perf_counter), axis=0) / STEPS
    return {
        "policy": name,
        "file_mb": f"{path.stat().st_size / 1e6:.1f}",
        "onnx_ms": f"{onnx_ms:.3f}",
        "torch_ms": f"{torch_ms:.3f}",
        "onnxruntime": package_version("onnxruntime"),
        "torch": package_version("torch"),
        "cpu_type": str(machine_info()["cpu_type"]),
    }


def page_table(rows: list[dict[str, str]]) -> str:
    """Return the section of the page."""
    header = ["policy", "MB", "ms by ONNX Runtime", "ms by its player in PyTorch"]
    lines = [[row["policy"], row["file_mb"], row["onnx_ms"], row["torch_ms"]] for row in rows]
    first = rows[0]
    return (
        f"{markdown(frame(header, lines))}\n"
        f"Medians of {TURNS} turns of {STEPS} steps; ONNX Runtime {first['onnxruntime']}, PyTorch {first['torch']}, a"
        f" processor of type {first['cpu_type']}.\n"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write the table into the page")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows = [measured(name, Path(folder)) for name in PACKAGED_POLICIES]
    write_atomic(TABLE, csv_text(COLUMNS, [[row[name] for name in COLUMNS] for row in rows]))
    if given.write:
        section = page_table(read_csv(TABLE, COLUMNS))
        write_atomic(PAGE, replace_section(PAGE.read_text(encoding="utf-8"), "speed", section))


if __name__ == "__main__":
    main()
