"""Checks before each run that the files of a suite's real rivers are still those that its results name."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.suite.config import Suite
from thalweg.bench.suite.record import read_suite
from thalweg.world import Reach, WorldFileError

Place = tuple[str, str]
"""Condition and name of a real river; the condition of those in place of levels is empty."""


class OtherRiverError(ResultsError):
    """A file of a river that is missing, or has another content than the results name."""


def recorded_rivers(record: Mapping[str, Any]) -> dict[Place, dict[str, Any]]:
    """Return the real rivers of a suite's record by condition and name."""
    conditions = {condition["name"]: condition["rivers"] for condition in record.get("conditions", [])}
    named = {"": record.get("rivers", {})} | conditions
    return {(of, name): river for of, rivers in named.items() for name, river in rivers.items()}


def river_contents(suite: Suite) -> dict[Place, str]:
    """Return the hash of the file of each real river; raises `WorldFileError` for a missing file."""
    return {place: reach.as_data()["content"] for place, reach in suite.reaches_flown.items()}


def require_same_on_node(suite: Suite, expected: Mapping[Place, str], node: str) -> None:
    """Raise `OtherRiverError` unless the files on a node have the contents of those where results are collected."""
    for place, reach in suite.reaches_flown.items():
        if (found := _content(reach)) != expected.get(place):
            raise OtherRiverError(
                f"node {node} of the cluster has another file {reach.path} (its content: {found or 'no file'} there,"
                f" {expected.get(place)} here); copy the file to every node"
            )


def require_unchanged(suite: Suite, folder: Path) -> None:
    """Raise `OtherRiverError` if a file has changed since the suite in the folder was started.

    A folder without `suite.json`, such as that of a node, is not checked.
    """
    if not suite.reaches_flown or not (folder / "suite.json").is_file():
        return
    recorded = recorded_rivers(read_suite(folder))
    for place, reach in suite.reaches_flown.items():
        before, now = recorded.get(place, {}).get("content"), _content(reach)
        if now != before:
            raise OtherRiverError(
                f"{reach.path} has changed since the suite in {folder} was started: its content was {before} and is"
                f" {now or 'gone'} now. Restore the old file to resume, or choose another folder."
            )


def _content(reach: Reach) -> str:
    """Return the hash of a river's file; empty if there is none."""
    try:
        return reach.as_data()["content"]
    except WorldFileError:
        return ""
