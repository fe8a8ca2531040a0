"""How does a suite get done? Run by run, each in its folder, several at a time; what is finished is never done again.

Kill it at any moment: the same command goes on and ends with the same episodes. A run that fails is a row with its
error in `runs.csv`, the others go on, and the same command tries the failed one again.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.episodes import read_episodes
from thalweg.bench.execute.executors import Hands, Here, Work
from thalweg.bench.execute.filming import film_flights
from thalweg.bench.execute.rivers import Place, Rivers, made_by
from thalweg.bench.report.report import Report, write_report
from thalweg.bench.results.results import RunRow, evaluation_path, read_runs, write_runs
from thalweg.bench.suite.record import read_suite
from thalweg.bench.suite.suites import Run, Suite, check
from thalweg.core.atomic_io import write_atomic
from thalweg.core.machine import machine_info, package_versions
from thalweg.env import EnvConfig


@dataclass(frozen=True)
class Outcome:
    """What a suite left."""

    folder: Path
    report: Report
    runs: list[RunRow]
    """Of the runs that were asked for, in the order of the suite."""

    @property
    def failed(self) -> list[RunRow]:
        return [row for row in self.runs if row.status == "failed"]


def run_suite(
    suite: Suite,
    folder: Path,
    place: Place | None = None,
    console: Console | None = None,
    *,
    hands: Hands | None = None,
    only: tuple[str, ...] = (),
) -> Outcome:
    """Do what is left of a suite and write its report.

    Args:
        suite: What to do.
        folder: Of the results.
        place: Where policies are trained and flown; our rivers if not given.
        console: Where it is said what is going on.
        hands: Who does the runs; this process, one after the other, if not given.
        only: Names of policies or runs that are to be done now, as `chosen` takes them; all if empty.

    Raises `ResultsError` or `AlgorithmError`, before anything runs, for a suite that names what does not exist, for a
    folder that holds another suite, and for a name in `only` that the suite does not have.
    """
    console = console or Console()
    _check(suite)
    asked = chosen(suite, only)
    claim(folder, suite)
    place = place or Rivers(suite)
    rows = {row.run: row for row in read_runs(folder)}
    left = [run for run in asked if not _finished(run, suite, folder, rows.get(run.name))]
    for row in (hands or Here()).carry_out(Work(suite, folder, place, console), left):
        rows[row.run] = row
        write_runs(folder, [rows[other.name] for other in suite.runs() if other.name in rows])
    film_flights(suite, folder, place, console)
    report = write_report(folder)
    return Outcome(folder, report, [rows[run.name] for run in asked])


def chosen(suite: Suite, only: tuple[str, ...]) -> list[Run]:
    """The runs of a suite that are named, by their own name (`FOCOPS-0`) or by their policy's: an arm's, a baseline's
    or `packaged`; all if none is."""
    runs = suite.runs()
    known = {name for run in runs for name in (run.name, run.algorithm)}
    for name in only:
        if name not in known:
            policies = ", ".join(dict.fromkeys(run.algorithm for run in runs))
            raise ResultsError(
                f"suite {suite.name} has no {name!r}; name one of {policies}, or one run, such as {runs[-1].name}"
            )
    return [run for run in runs if not only or {run.name, run.algorithm} & set(only)]


def _check(suite: Suite) -> None:
    from thalweg.algos.common.errors import AlgorithmError
    from thalweg.algos.registry import ALGORITHMS
    from thalweg.world import LEVELS

    check(suite, tuple(ALGORITHMS), tuple(LEVELS))
    for arm in suite.arms:
        for each in (*arm.before, arm):
            try:
                ALGORITHMS[each.algorithm].configure(dict(each.settings), each.preset, suite.num_envs)
            except AlgorithmError as error:
                raise AlgorithmError(f"suite {suite.name}, {arm.label}: {error}") from error


def claim(folder: Path, suite: Suite) -> None:
    """Make the folder this suite's, or raise `ResultsError` if it holds something else or was made by other code."""
    made = made_by()
    record = {
        **suite.as_data(),
        "made_by": made,
        "env": asdict(EnvConfig()),
        "versions": package_versions(),
        "machine": machine_info(),
    }
    path = folder / "suite.json"
    if not (there := next(place for place in (folder, *folder.absolute().parents) if place.exists())).is_dir():
        raise ResultsError(f"{there} is not a folder; choose another for the results")
    if not path.exists():
        if folder.exists() and any(folder.iterdir()):
            raise ResultsError(f"{folder} is not empty and holds no suite; choose another folder")
        write_atomic(path, json.dumps(record, indent=2) + "\n")
        return
    try:
        old = read_suite(folder)
    except ResultsError as error:
        raise ResultsError(f"{folder} cannot be gone on with: {error}; choose another folder") from error
    changes = differences(old, json.loads(json.dumps(suite.as_data())))
    if changes:
        raise ResultsError(f"{folder} holds other results ({'; '.join(changes)}); choose another folder")
    theirs = old.get("made_by") or {}
    changes = [f"{key} {theirs.get(key)} there, {mine} now" for key, mine in made.items() if theirs.get(key) != mine]
    if changes:
        raise ResultsError(
            f"{folder} holds results made by another Thalweg ({'; '.join(changes)}); choose another --out, or remove it"
            f" (make demo OUT=elsewhere, too). Its report can be made again all the same: thalweg report {folder}"
        )


def differences(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """What differs between two records of suites, arm by arm."""
    there, here = ({arm["name"]: arm for arm in record.get("arms", [])} for record in (old, new))
    found = [
        f"{key} {old.get(key)!r} there, {value!r} now"
        for key, value in new.items()
        if key != "arms" and old.get(key) != value
    ]
    found += [f"arm {name} {'not there' if name in here else 'not now'}" for name in there.keys() ^ here.keys()]
    return found + [
        f"{name}: {key} {there[name].get(key)!r} there, {value!r} now"
        for name in here
        if name in there
        for key, value in here[name].items()
        if there[name].get(key) != value
    ]


def _finished(run: Run, suite: Suite, folder: Path, row: RunRow | None) -> bool:
    """Whether all episodes of the run are there."""
    if row is None or row.status != "finished":
        return False
    try:
        return all(
            len(read_episodes(evaluation_path(folder, run.name, trial))) == suite.episodes
            for trial in suite.trials(run)
        )
    except (ResultsError, OSError):
        return False
