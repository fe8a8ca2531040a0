"""What must `suite.json` hold, so that results can be read by it? Only what is read of it is asked for: another version
may have more."""

import json
import typing
from pathlib import Path
from typing import Any, NotRequired, TypedDict

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.conditions import NAME

LONGEST = 60
"""Characters of a wrong value that are repeated."""
KINDS = {dict: "a mapping", list: "a list", str: "a word", int: "a whole number", bool: "true or false"}


class StageRecord(TypedDict):
    """Of `thalweg.bench.suite.suites.Stage`."""

    steps: int


class ArmRecord(TypedDict):
    """Of `thalweg.bench.suite.suites.Arm`."""

    name: str
    algorithm: str
    seeds: list[int]
    steps: int
    level: NotRequired[str]
    before: NotRequired[list[StageRecord]]


class ConditionRecord(TypedDict):
    """Of `thalweg.bench.evaluate.conditions.Condition`."""

    name: str
    levels: list[str]
    rivers: dict[str, Any]
    blind: bool


class SuiteRecord(TypedDict):
    """Of `thalweg.bench.suite.suites.Suite`; algorithms, seeds and steps are of suites from before there were arms."""

    name: str
    train_level: str
    arms: NotRequired[list[ArmRecord]]
    algorithms: NotRequired[list[str]]
    seeds: NotRequired[list[int]]
    steps: NotRequired[int]
    test_levels: NotRequired[list[str]]
    baselines: NotRequired[list[str]]
    packaged: NotRequired[bool]
    conditions: NotRequired[list[ConditionRecord]]
    made_by: NotRequired[dict[str, Any]]


def read_suite(folder: Path) -> dict[str, Any]:
    """The content of `suite.json`; raises `ResultsError` where it is not JSON, or not the record of a suite."""
    try:
        suite = json.loads((folder / "suite.json").read_text(encoding="utf-8"))
    except (ValueError, RecursionError, OSError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise ResultsError(f"suite.json cannot be read: {why}") from error
    try:
        _check(SuiteRecord, suite)
        _check_conditions(suite.get("conditions", []))
    except ResultsError as error:
        raise ResultsError(f"suite.json is not the record of a suite: {error}") from error
    return suite


def _check(kind: Any, value: Any, where: str = "") -> None:
    """Raise `ResultsError` for a value of JSON that is not of a kind: plain, a list, a mapping, or one of the above."""
    plain = dict if typing.is_typeddict(kind) else typing.get_origin(kind) or kind
    if not isinstance(value, plain) or (plain is int and isinstance(value, bool)):
        raise ResultsError(f"{where or 'it'} must be {KINDS[plain]}, got {_short(value)}")
    if plain is list:
        (inner,) = typing.get_args(kind)
        for place, each in enumerate(value):
            _check(inner, each, f"{where}[{place}]")
    for key, inner in typing.get_type_hints(kind).items() if typing.is_typeddict(kind) else ():
        path = f"{where}: {key}" if where else key
        if key in value:
            _check(inner, value[key], path)
        elif key in kind.__required_keys__:
            raise ResultsError(f"{path} is missing")


def _check_conditions(conditions: list[ConditionRecord]) -> None:
    """Raise `ResultsError` for a name that is that of no folder, or of another condition's."""
    names = [condition["name"] for condition in conditions]
    for place, name in enumerate(names):
        if not NAME.fullmatch(name):
            raise ResultsError(f"conditions[{place}]: name must be letters, digits, - and ., got {_short(name)}")
        if name in names[:place]:
            raise ResultsError(f"conditions[{place}]: name must be one of its own, got {_short(name)} twice")


def _short(value: Any) -> str:
    """A value as it stands in the file, or its beginning."""
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."
