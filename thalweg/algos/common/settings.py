"""How does a config come from what a person wrote? Checked key by key before anything runs."""

import dataclasses
import difflib
import math
import typing
from collections.abc import Mapping
from typing import Any, TypeVar, get_args, get_origin

from thalweg.algos.common.errors import AlgorithmError

Config = TypeVar("Config")


def config_from(kind: type[Config], given: "Config | Mapping[str, Any] | None") -> Config:
    """The config of a frozen dataclass `kind` with the given values, the rest at their defaults.

    `given` may be such a config already, which is checked like a mapping. Raises `AlgorithmError` for an unknown key,
    listing the known ones, and for a value of the wrong type.
    """
    if given is None:
        return kind()
    if isinstance(given, kind):
        given = {field.name: getattr(given, field.name) for field in dataclasses.fields(given)}  # pyright: ignore
    if not isinstance(given, Mapping):
        raise AlgorithmError(f"a config of {kind.__name__} or a mapping is needed, got {type(given).__name__}")
    types = typing.get_type_hints(kind)
    unknown = [key for key in given if key not in types]
    if unknown:
        near = difflib.get_close_matches(unknown[0], types, 1)
        meant = f" (did you mean {near[0]!r}?)" if near else ""
        raise AlgorithmError(
            f"{kind.__name__} has no {', '.join(map(repr, unknown))}{meant}; it has {', '.join(types)}"
        )
    return kind(**{key: _checked(f"{kind.__name__}.{key}", types[key], value) for key, value in given.items()})


def as_data(config: Any) -> dict[str, Any]:
    """The config as plain data for JSON and YAML: tuples become lists."""
    return {
        key: list(value) if isinstance(value, tuple) else value for key, value in dataclasses.asdict(config).items()
    }


def require(config: Any, conditions: Mapping[str, tuple[bool, str]]) -> None:
    """Raises `AlgorithmError` for the first field of a config whose condition is false, with its words and value."""
    for field, (holds, words) in conditions.items():
        if not holds:
            raise AlgorithmError(f"{field} {words}; got {getattr(config, field)}")


def _checked(name: str, kind: Any, value: Any) -> Any:
    if get_origin(kind) is tuple and isinstance(value, list | tuple):
        return tuple(_checked(name, get_args(kind)[0], item) for item in value)
    if get_origin(kind) is typing.Literal:
        if value in get_args(kind):
            return value
        raise AlgorithmError(f"{name} is one of {', '.join(map(repr, get_args(kind)))}, got {value!r}")
    if kind is float and isinstance(value, int | float) and not isinstance(value, bool) and not math.isnan(value):
        return float(value)
    if kind is bool and isinstance(value, bool):
        return value
    if kind is int and isinstance(value, int) and not isinstance(value, bool):
        return value
    if kind is str and isinstance(value, str):
        return value
    raise AlgorithmError(f"{name} must be {getattr(kind, '__name__', kind)}, got {value!r}")
