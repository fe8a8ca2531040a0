"""What does `thalweg speed` print and write? Its measurements as a table or JSON, with the machine and the versions."""

import json
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.table import Column, Table
from rich.text import Text

from thalweg.bench.speed.measure import QUICK, Measurement, Plan, measure, measure_stages
from thalweg.core.atomic_io import write_atomic
from thalweg.core.machine import machine_info, package_versions

COLUMNS = ("what", "median", "slowest", "fastest", "unit", "batch", "worlds", "frame", "features")
"""Of the table; of a stage, `median` is the mean over views, which add up to the frame."""


def record(lines: list[Measurement]) -> dict:
    """The measurements as plain data, with the machine and the versions."""
    return {"machine": machine_info(), "versions": package_versions(), "measurements": [asdict(line) for line in lines]}


def speed(*, as_json: bool, quick: bool, out: Path | None, stages: bool = False) -> int:
    """Measure and print, the whole or the stages of a frame; JSON goes to standard output by itself, the progress
    elsewhere."""
    console = Console(stderr=True)
    lines = []
    plan = QUICK if quick else Plan()
    for line in measure_stages(plan) if stages else measure(plan):
        console.print(f"{line.name}: {line.median:,.4g} {line.unit}", highlight=False)
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


def table_rows(found: dict) -> list[list[str]]:
    """The measurements of a record as text, in the order of `COLUMNS`."""
    return [
        [
            line["name"],
            *(
                f"{line[key]:,.0f}" if line[key] >= 100 else f"{line[key]:.3g}"
                for key in ("median", "slowest", "fastest")
            ),
            line["unit"],
            str(line["batch"]),
            str(line["worlds"]),
            line["resolution"],
            line["features"],
        ]
        for line in found["measurements"]
    ]


def describe(found: dict) -> str:
    """The machine and the versions in one line."""
    where = found["machine"]
    parts = ", ".join(f"{name} {number}" for name, number in found["versions"].items())
    return f"{where['cpu']}, {where['cores']} cores, {where['memory_gib']} GiB, {where['system']}; {parts}"


def print_table(found: dict, console: Console) -> None:
    """A row for each measurement, with what it depends on below its name, so that 80 columns are enough."""
    figures = (Column(name, justify="right", no_wrap=True) for name in ("median", "slowest", "fastest"))
    table = Table("what", *figures, Column("unit", no_wrap=True), title=describe(found), show_lines=True)
    for name, median, slowest, fastest, unit, batch, worlds, frame, features in table_rows(found):
        given = ", ".join(part for part in (f"batch {batch}", f"worlds {worlds}", frame, features) if part)
        table.add_row(Text.assemble(name, "\n", (given, "dim")), median, slowest, fastest, unit)
    console.print(table)
