"""How does a suite of one's own come from a file? YAML with the fields of `Suite`, each checked before anything runs.

`docs/bench.md` shows one.
"""

import dataclasses
import difflib
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.conditions import BEYOND, Condition
from thalweg.bench.suite.suites import Suite, suite_named
from thalweg.core.yaml12 import load

ENDINGS = (".yaml", ".yml")


def suite_of(name: str) -> Suite:
    """The suite of a name, or of a YAML file; raises `ResultsError` that says what is wrong with either."""
    if not name.endswith(ENDINGS):
        return suite_named(name)
    path = Path(name)
    try:
        data = load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ResultsError(f"{path} can't be read: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ResultsError(f"{path} is not YAML: {' '.join(str(error).split())}") from error
    if not isinstance(data, Mapping):
        raise ResultsError(f"{path} holds no suite: a mapping with arms is needed, got {type(data).__name__}")
    return _made(Suite, {"name": path.stem, **data}, str(path))


def _made(kind: type, data: Any, where: str) -> Any:
    """A dataclass from a mapping; `where` is what errors call it."""
    if kind is Condition and isinstance(data, str):
        return _known_condition(data, where)
    if not isinstance(data, Mapping):
        raise ResultsError(f"{where} must be a mapping, got {data!r}")
    hints = typing.get_type_hints(kind)
    for key in data:
        if key not in hints:
            near = difflib.get_close_matches(str(key), hints, 1)
            meant = f" (did you mean {near[0]}?)" if near else ""
            raise ResultsError(f"{where}: there is no {key!r}{meant}; there are {', '.join(hints)}")
    for field in dataclasses.fields(kind):
        required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if required and field.name not in data:
            raise ResultsError(f"{where}: {field.name} is missing")
    return kind(**{key: _value(hints[key], value, f"{where}: {key}") for key, value in data.items()})


def _value(kind: Any, value: Any, where: str) -> Any:
    """A value of a type: a number or word, a list as a tuple, a mapping, or a dataclass."""
    if typing.get_origin(kind) is tuple:
        if not isinstance(value, Sequence) or isinstance(value, str):
            raise ResultsError(f"{where} must be a list, got {value!r}")
        return tuple(_value(typing.get_args(kind)[0], each, f"{where}[{place}]") for place, each in enumerate(value))
    if dataclasses.is_dataclass(kind):
        return _made(typing.cast(type, kind), value, where)
    if kind is int and isinstance(value, float) and value.is_integer():
        return int(value)
    plain = Mapping if typing.get_origin(kind) is not None else kind
    if plain is Mapping and isinstance(value, Mapping) and (odd := [key for key in value if not isinstance(key, str)]):
        raise ResultsError(f"{where}: a key must be a word, got {odd[0]!r}")
    if not isinstance(value, plain) or (isinstance(value, bool) and plain is int):
        raise ResultsError(f"{where} must be {_NAMES.get(plain, plain.__name__)}, got {value!r}")
    return value


_NAMES = {int: "a whole number", str: "a word", bool: "true or false", Mapping: "a mapping"}


def _known_condition(name: str, where: str) -> Condition:
    known = {condition.name: condition for condition in BEYOND}
    if name not in known:
        raise ResultsError(f"{where}: unknown condition {name!r}; known: {', '.join(known)}, or a mapping of one's own")
    return known[name]
