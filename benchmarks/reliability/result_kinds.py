"""Kinds of files of results: fronts, studies of encoders, runs to verify, and what a whole report is made of."""

import shutil
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from kind import Kind, check_sound
from mutations import mutated_json, mutated_table

from tests.bench.versioned import record_current_versions
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.episodes import COLUMNS, END_COLUMNS
from thalweg.bench.fronts.fronts import PACKAGED_FRONTS, read_fronts
from thalweg.bench.leaderboard import entries
from thalweg.bench.report.html.page import page
from thalweg.bench.report.sections import SECTIONS, TableSection
from thalweg.bench.results.reading import read_results
from thalweg.bench.results.reproduction import Table, compare_means, compare_to_the_bit
from thalweg.bench.studies.encoder_study import CASES, read_measures
from thalweg.bench.studies.encoder_tables import size_row
from thalweg.encoder import EncoderFileError
from thalweg.train.encoder.probe_table import probe_table, read_probe
from thalweg.train.encoder.views import TARGETS

REPOSITORY = Path(__file__).resolve().parents[2]
TINY = REPOSITORY / "tests" / "bench" / "tiny_results"
FLIGHTS = "evaluation/PPO-0-Easy.csv"
CURVE = "runs/PPO-0/episodes.csv"
CURVES = Table("curve", CURVE, ("step", "return", "tight", "loose"), steps=300)
TRIAL = Table("Easy", FLIGHTS, tuple(name for name in COLUMNS if name not in END_COLUMNS))
Mutate = Callable[[bytes, Random], bytes]


def _reported(part: str, mutate: Mutate) -> Kind:
    """Return the kind of a part of a results folder, which is read with all others for a report and a leaderboard."""
    tables = [section for section in SECTIONS if isinstance(section, TableSection)]

    def whole(folder: Path) -> Path:
        if not (results := folder / "results").exists():
            shutil.copytree(TINY, results)
            record_current_versions(results)
        return results

    def read(path: Path) -> Any:
        folder = whole(path.parent)
        (folder / part).write_bytes(path.read_bytes())
        results = read_results(folder)
        text = page(results, tables, {section.name: section.table(results) for section in tables}, {}, [])
        shown = text, [entry.policy for entry in entries(folder)]
        if results.skipped:  # a file that is left out is refused, and what is shown without it must be right too
            check_sound(shown)
            raise ResultsError("; ".join(results.skipped))
        return shown

    # Reading all of a folder takes a tenth of a second; the part alone is a kind too, of which the whole has as many
    # files as of others.
    return Kind(
        Path(part).name,
        lambda folder: [(whole(folder) / part).read_bytes()],
        mutate,
        read,
        (ResultsError,),
        wanted=10_000,
    )


def _verified(table: Table) -> Kind:
    """Return the kind of a file of a run that was made again, which is compared with the recorded one."""

    def read(path: Path) -> Any:
        recorded = TINY / table.pattern
        parts = compare_to_the_bit(table, recorded, path), compare_means(table, [recorded], recorded, path)
        return [(part.differences, part.means) for part in parts]

    name = Path(table.pattern).name
    return Kind(name, lambda _: [(TINY / table.pattern).read_bytes()], mutated_table, read, (ResultsError,))


def _measures(folder: Path) -> list[bytes]:
    return [path.read_bytes() for path in sorted((REPOSITORY / "benchmarks" / "encoders").glob("*/measures.json"))[:2]]


RESULT_KINDS: dict[str, Kind] = {
    "fronts": Kind(
        "fronts.csv",
        lambda _: [b"".join(PACKAGED_FRONTS.read_bytes().splitlines(keepends=True)[:20])],
        mutated_table,
        lambda path: [(point.task, point.return_, point.cost) for point in read_fronts(path)],
        (ResultsError,),
    ),
    "study measures": Kind(
        "measures.json",
        _measures,
        mutated_json,
        lambda path: size_row(CASES[0], read_measures(path)),
        (ResultsError,),
    ),
    "probes": Kind(
        "probe.csv",
        lambda _: [probe_table({("geometry", "flights"): np.linspace(-0.1, 0.9, len(TARGETS))}).encode()],
        mutated_table,
        lambda path: sorted(read_probe(path)),
        (EncoderFileError,),
    ),
    "verified curve": _verified(CURVES),
    "verified flights": _verified(TRIAL),
    "report: suite": _reported("suite.json", mutated_json),
    "report: runs": _reported("runs.csv", mutated_table),
    "report: versions": _reported("versions.json", mutated_json),
    "report: flights": _reported(FLIGHTS, mutated_table),
    "report: curve": _reported(CURVE, mutated_table),
}
"""By their names in the table."""
