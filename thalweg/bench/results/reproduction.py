"""Comparison of a run that was made again with the recorded one: its training curve and its flights.

On the same kind of processor they are the same to the bit. Elsewhere the last bits of sums differ, and with them, soon,
the sampled actions: training then takes another course, as with another seed, and only means are compared.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from thalweg.bench.csv_files import ResultsError, finite, read_csv

LAST_SHARE = 0.1
"""Share of the steps of training, at their end, whose episodes give the means of a curve."""
TOLERANCES = {"return": 1.0, "cost": 0.25, "success": 0.2}
"""Least tolerance of each mean: points of return, of which a whole course has 10, cost of an episode, share."""
SEED_DEVIATIONS = 3.0
"""Tolerance of a mean in standard deviations of the means of all seeds, where that is more."""
PACKAGES = ("numpy", "scipy", "numba", "torch")
"""Packages of which another version may round differently."""
PROCESSOR = ("cpu", "cpu_type", "vector_bits", "system", "learning_threads", "fast_path")
"""What the last bits depend on of a machine; some processors of several kinds have one name, such as AMD EPYC."""
RECORDED_LATER = ("fast_path",)
"""Of these, what older records do not have: it is no difference where either lacks it."""
MOST_NAMED = 3
"""Number of differences of a file that are named; the others are counted."""

Row = Mapping[str, str]


@dataclass(frozen=True)
class Table:
    """A file that every run of a policy has: its curve, or its flights in a trial."""

    name: str
    pattern: str
    """Path in a results folder, with `{run}` for the name of a run."""
    columns: tuple[str, ...]
    """Columns that it must have."""
    steps: int = 0
    """Steps of the training of which it is the curve; 0 for flights."""

    def path(self, folder: Path, run: str) -> Path:
        """Return the path of a run's file in a results folder."""
        return folder / self.pattern.format(run=run)


@dataclass(frozen=True)
class Part:
    """What became of one table of a run."""

    name: str
    episodes: int
    """Number of recorded episodes."""
    differences: tuple[str, ...]
    """What is not the same, or not within the tolerances; empty if all is."""
    means: str = ""
    """Means there and here, with their tolerances, where they are compared."""


def other_conditions(there: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """Return why a run may differ in its last bits, by the content of config.yaml of both; empty for the same kind of
    processor with the same packages, number of threads and setting of the fast path."""
    pairs = {name: ("machine", name) for name in PROCESSOR}
    pairs |= {name: ("versions", name) for name in PACKAGES}
    found = []
    for name, (group, key) in pairs.items():
        values = [(record.get(group) or {}).get(key) for record in (there, here)]
        if values[0] != values[1] and not (name in RECORDED_LATER and None in values):
            found.append(f"{name.replace('_', ' ')} {values[0]} there, {values[1]} here")
    devices = [record.get("device", "cpu") for record in (there, here)]
    return [*found, f"device {' there, '.join(devices)} here"] if devices != ["cpu", "cpu"] else found


def compare_to_the_bit(table: Table, there: Path, here: Path) -> Part:
    """Return where two files of a table differ, value by value; numbers are written so that they read back to the bit.

    Raises `ResultsError` for a file that cannot be read.
    """
    recorded, repeated = (read_csv(path, table.columns) for path in (there, here))
    found = list(_differences(table, recorded, repeated))
    more = [f"and {len(found) - MOST_NAMED} more"] if len(found) > MOST_NAMED else []
    return Part(table.name, int(sum(_episodes(there, recorded))), (*found[:MOST_NAMED], *more))


def _differences(table: Table, recorded: Sequence[Row], repeated: Sequence[Row]) -> Iterator[str]:
    """Yield a line for each row that differs, with its first value that does."""
    if len(recorded) != len(repeated):
        yield f"{len(recorded)} rows there, {len(repeated)} here"
    for line, (there, here) in enumerate(zip(recorded, repeated, strict=False), start=2):
        for column in dict.fromkeys([*there, *here]):
            if there.get(column) != here.get(column):
                yield f"line {line}: {column} {there.get(column)} there, {here.get(column)} here"
                break


def compare_means(table: Table, seeds: Sequence[Path], there: Path, here: Path) -> Part:
    """Return where the means of two files of a table differ by more than the tolerances; `seeds`: those of all seeds.

    Raises `ResultsError` for a file that cannot be read.
    """
    recorded = _means(table, there)
    repeated, *of_seeds = (_means(table, path, tuple(recorded)) for path in (here, *seeds))
    wrong, said = [], []
    for name, mean in recorded.items():
        spread = np.std([each[name] for each in of_seeds], ddof=1) if len(of_seeds) > 1 else 0.0
        allowed = max(TOLERANCES[name], SEED_DEVIATIONS * float(spread))
        words = f"{name} {mean:.2f} there, {repeated[name]:.2f} here (tolerance {allowed:.2f})"
        said.append(words)
        if not abs(mean - repeated[name]) <= allowed:
            wrong.append(words)
    episodes = int(sum(_episodes(there, read_csv(there, table.columns))))
    return Part(table.name, episodes, tuple(wrong), "; ".join(said))


def _episodes(path: Path, rows: Sequence[Row]) -> list[float]:
    """Return the number of episodes of each row, which is a block of them in a curve; raises `ResultsError` for a value
    that is no finite number."""
    try:
        return [finite(row.get("episodes", "1")) for row in rows]
    except ValueError as error:
        raise ResultsError(f"{path}: episodes: {error}") from error


def _means(table: Table, path: Path, wanted: Sequence[str] = ()) -> dict[str, float]:
    """Return the means of the compared columns of a file, of a curve over its last steps; raises `ResultsError` for no
    rows, for a value that is no number, and for a file without the `wanted` columns."""
    rows = read_csv(path, table.columns)
    try:
        if table.steps:
            rows = [row for row in rows if float(row["step"]) > (1 - LAST_SHARE) * table.steps]
        means = {name: [float(row[name]) for row in rows] for name in TOLERANCES if name in (rows or [{}])[0]}
    except ValueError as error:
        raise ResultsError(f"{path}: {error}") from error
    episodes = _episodes(path, rows)
    if not sum(episodes):
        raise ResultsError(f"{path}: {table.name} has no episodes to compare")
    if missing := [name for name in wanted if name not in means]:
        raise ResultsError(f"{path} lacks the column {missing[0]}, which {table.name} of the recorded run has")
    return {name: float(np.average(values, weights=episodes)) for name, values in means.items()}
