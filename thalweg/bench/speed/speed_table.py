"""The output of `thalweg speed`: measurements as a table or as JSON, with the machine and the versions."""

import json
from dataclasses import asdict
from pathlib import Path

import pandas as pd
from rich.console import Console
from rich.table import Column, Table
from rich.text import Text

from thalweg.bench.report.table import frame
from thalweg.bench.speed.measure import QUICK, Measurement, Plan, measure, measure_stages
from thalweg.core.atomic_io import write_atomic
from thalweg.core.machine import machine_info, package_versions

COLUMNS = ("what", "median", "slowest", "fastest", "unit", "batch", "worlds", "frame", "features")
"""Columns of the table. For a stage of a frame, `median` is the mean over views, so that stages add up to the frame."""


def record(lines: list[Measurement]) -> dict:
    """Return the measurements as plain data, with the machine and the versions."""
    return {"machine": machine_info(), "versions": package_versions(), "measurements": [asdict(line) for line in lines]}


def speed(*, as_json: bool, quick: bool, out: Path | None, stages: bool = False) -> int:
    """Measure every part, or with `stages` the stages of a frame, and print the results; returns the exit status.

    JSON is all that goes to standard output; progress goes to standard error.
    """
    console = Console(stderr=True)
    lines = []
    plan = QUICK if quick else Plan()
    for line in measure_stages(plan) if stages else measure(plan):
        name = ", ".join(text for text in (line.name, line.resolution) if text)
        console.print(f"{name}: {line.median:,.4g} {line.unit}", highlight=False)
        lines.append(line)
    found = record(lines)
    text = json.dumps(found, indent=2) + "\n"
    if out is not None:
        write_atomic(out, text)
    if as_json:
        print(text, end="")
    else:
        print_table(found, Console())
    return 0


def speed_frame(found: dict) -> pd.DataFrame:
    """Return the measurements of a record as text, with `COLUMNS`."""
    rows = []
    for line in found["measurements"]:
        values = (line[key] for key in ("median", "slowest", "fastest"))
        rows.append(
            [
                line["name"],
                *(f"{value:,.0f}" if value >= 100 else f"{value:.3g}" for value in values),
                line["unit"],
                str(line["batch"]),
                str(line["worlds"]),
                line["resolution"],
                line["features"],
            ]
        )
    return frame(COLUMNS, rows)


def describe(found: dict) -> str:
    """Return the machine and the versions in one line; older records name no type of processor and no vectors."""
    about = found["machine"]
    versions_text = ", ".join(f"{name} {number}" for name, number in found["versions"].items())
    kind = f" ({about['cpu_type']}, vectors of {about['vector_bits']} bits)" if "vector_bits" in about else ""
    return (
        f"{about['cpu']}{kind}, {about['cores']} cores, {about['memory_gib']} GiB, {about['system']}; {versions_text}"
    )


def print_table(found: dict, console: Console) -> None:
    """Print a row for each measurement, with what it depends on below its name, so that 80 columns are enough."""
    figures = (Column(name, justify="right", no_wrap=True) for name in ("median", "slowest", "fastest"))
    table = Table("what", *figures, Column("unit", no_wrap=True), title=describe(found), show_lines=True)
    for row in speed_frame(found).itertuples(index=False):
        name, median, slowest, fastest, unit, batch, worlds, resolution, features = row
        details = ", ".join(text for text in (f"batch {batch}", f"worlds {worlds}", resolution, features) if text)
        table.add_row(Text.assemble(name, "\n", (details, "dim")), median, slowest, fastest, unit)
    console.print(table)
