"""Frozen configs validated by pydantic, with errors as one line in plain words.

`@frozen_config(SomeError)` makes a class a frozen dataclass. The annotation of a field gives its valid values; a
rule about several fields is a method under `pydantic.model_validator(mode="after")` that raises `ValueError`. A wrong
value raises the given error with the message `path must be what is right, got value`. Types are strict: "3" is not a
number, 1 is not a bool, and NumPy's scalars are refused unless a config asks for them.
"""

import dataclasses
import functools
import typing
from collections.abc import Callable, Iterable, Mapping
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, Union, dataclass_transform, get_args, get_origin

import numpy as np
import pydantic.dataclasses
from annotated_types import Ge, Le
from pydantic import AllowInfNan, BeforeValidator, ConfigDict, Field, InstanceOf, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import PydanticCustomError, core_schema

from thalweg.core.suggestion import did_you_mean

C = TypeVar("C")
T = TypeVar("T")

MAX_MESSAGES = 3
"""Number of wrong values that one error names; it counts the others."""
MAX_VALUE_CHARS = 80
"""Number of characters of a wrong value that an error repeats."""


@dataclasses.dataclass(frozen=True)
class Hint:
    """Annotation of a field: text in brackets that an error about the field adds."""

    text: str


def _integer(value: Any) -> Any:
    """Return the integer equal to a float such as 2e5, or any other value unchanged."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


TupleOf = Annotated[tuple[T, ...], BeforeValidator(_tuple)]
"""A tuple; a list is converted."""
PairOf = Annotated[tuple[T, T], BeforeValidator(_tuple)]
"""A tuple of two; a list is converted."""
WholeNumber = Annotated[int, BeforeValidator(_integer)]
"""An integer; a float such as 2e5 is converted."""
Fraction = Annotated[float, Field(ge=0, le=1)]
"""A number from 0 to 1."""
FiniteNonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
FinitePositive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
FiniteNumber = Annotated[float, Field(allow_inf_nan=False)]


@dataclass_transform(frozen_default=True, field_specifiers=(dataclasses.field, Field))
def frozen_config(
    error: type[ValueError], *, extra: Literal["forbid", "ignore"] = "forbid", numpy_scalars: bool = False
) -> Callable[[type[C]], type[C]]:
    """Return a decorator for frozen dataclasses that raise `error` for an unknown key or a wrong value.

    An integer given for a float becomes one. With `extra="ignore"`, unknown keys are ignored: another version may have
    written more. With `numpy_scalars`, NumPy's scalars become Python's; otherwise only those that are
    Python's too are accepted: `np.float64` and `np.str_`.
    """
    accepted = np.generic if numpy_scalars else (np.float64, np.str_)
    schema_of = functools.partial(_config_schema, accepted)

    def decorate(cls: type[C]) -> type[C]:
        cls.__get_pydantic_core_schema__ = staticmethod(schema_of)  # pyright: ignore[reportAttributeAccessIssue]
        settings = ConfigDict(strict=True, extra=extra)
        dataclass_type: Any = pydantic.dataclasses.dataclass(frozen=True, config=settings)(cls)
        checked = dataclass_type.__init__

        @functools.wraps(checked)
        def init(self: Any, *args: Any, **kwargs: Any) -> None:
            try:
                checked(
                    self,
                    *(_python_scalar(accepted, value) for value in args),
                    **{key: _python_scalar(accepted, value) for key, value in kwargs.items()},
                )
            except ValidationError as found:
                raise error(describe(type(self), found)) from None

        dataclass_type.__init__, dataclass_type.__config_error__ = init, error
        return dataclass_type

    return decorate


def parse_config(kind: type[C], data: Any, source: str = "", show: Callable[[Any], str] = repr) -> C:
    """Return the config of plain data, for example from YAML or JSON; missing fields have their defaults.

    A config of that kind is returned unchanged. Raises the config's error; its message starts with `source` and formats
    wrong values by `show`.
    """
    if isinstance(data, kind):
        return data
    cls: Any = kind
    if not isinstance(data, Mapping):
        needed = f"a {kind.__name__} or a mapping is needed, got a {type(data).__name__}"
        raise cls.__config_error__(f"{source}: {needed}" if source else needed)
    try:
        return cls.__pydantic_validator__.validate_python(data)
    except ValidationError as found:
        raise cls.__config_error__(describe(kind, found, source, show)) from None


def to_plain(value: Any) -> Any:
    """Return a config as plain data for YAML and JSON: dataclasses become dictionaries, tuples lists."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: to_plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {key: to_plain(item) for key, item in value.items()}
    return [to_plain(item) for item in value] if isinstance(value, list | tuple) else value


def describe(kind: type, found: ValidationError, source: str = "", show: Callable[[Any], str] = repr) -> str:
    """Return pydantic's findings about the data of a config as one line, unknown keys first."""
    unknown: dict[tuple[Any, ...], list[str]] = {}
    wrong: list[str] = []
    for each in found.errors(include_url=False):
        if each["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
            unknown.setdefault(each["loc"][:-1], []).append(str(each["loc"][-1]))
        else:
            wrong.append(_wrong_value(kind, each, show))
    lines = [*(_unknown_keys(kind, loc, keys) for loc, keys in unknown.items()), *wrong]
    more = f"; and {len(lines) - MAX_MESSAGES} more" if len(lines) > MAX_MESSAGES else ""
    return (f"{source}: " if source else "") + "; ".join(lines[:MAX_MESSAGES]) + more


def refuse_unknown(what: str, given: Iterable[str], known: Iterable[str], error: type[ValueError]) -> None:
    """Raise `error` for names that are not among the known ones, which it lists."""
    known = list(known)
    unknown = sorted(set(given) - set(known))
    if unknown:
        raise error(f"unknown {what} {_with_suggestion(unknown, known)}; known: {', '.join(known)}")


def bounds(kind: type, name: str) -> tuple[float, float]:
    """Return the least and the greatest value that the annotation of a number, or of each of a pair, allows."""
    field = _unpack(typing.get_type_hints(kind, include_extras=True)[name])
    limits = _unpack(get_args(field.type)[0]) if get_origin(field.type) is tuple else field
    low = next(constraint.ge for constraint in limits.constraints if isinstance(constraint, Ge))
    high = next(constraint.le for constraint in limits.constraints if isinstance(constraint, Le))
    return low, high  # pyright: ignore[reportReturnType]


def _python_scalar(accepted: Any, value: Any) -> Any:
    """Return the Python equivalent of a NumPy scalar of the accepted types, and anything else unchanged.

    `np.bool_` is left unchanged, because only a bool field accepts it: see `_flag`.
    """
    return value.item() if isinstance(value, accepted) and not isinstance(value, np.bool_) else value


def _flag(accepted: Any, value: Any) -> Any:
    """Return the bool of a `np.bool_` if NumPy's scalars are accepted, and anything else unchanged."""
    return bool(value) if isinstance(value, np.bool_) and accepted is np.generic else value


def _number(accepted: Any, value: Any) -> Any:
    """Return an int or a float; anything else fails, whereas pydantic accepts whatever has `__float__`."""
    value = _python_scalar(accepted, value)
    if not isinstance(value, int | float):
        raise PydanticCustomError("float_type", "a number is needed")
    return value


def _config_schema(accepted: Any, source: Any, handler: pydantic.GetCoreSchemaHandler) -> Any:
    """Return the schema of a config, which accepts mappings as well as instances, because files contain mappings."""
    checks = {"float": functools.partial(_number, accepted), "bool": functools.partial(_flag, accepted)}
    schema = _with_checks(handler(source), checks)
    inner: Any = handler.resolve_ref_schema(schema)
    while inner["type"] != "dataclass":  # the class's own validators stand around it
        inner = inner["schema"]
    inner["strict"] = False
    return schema


def _with_checks(schema: Any, checks: Mapping[str, Callable[[Any], Any]]) -> Any:
    """Return a copy of a schema that applies `checks[type]` before each part of that type."""
    if isinstance(schema, list):
        return [_with_checks(part, checks) for part in schema]
    if not isinstance(schema, dict):
        return schema
    copy: Any = {key: _with_checks(part, checks) for key, part in schema.items()}
    check = checks.get(copy["type"]) if isinstance(copy.get("type"), str) else None
    return copy if check is None else core_schema.no_info_before_validator_function(check, copy)


class _Annotation(NamedTuple):
    """An annotation taken apart."""

    type: Any
    constraints: list[Any]
    """Constraints on the value besides its type."""
    optional: bool
    """Whether None is allowed."""


def _unpack(kind: Any) -> _Annotation:
    constraints: list[Any] = []
    optional = False
    while True:
        options = get_args(kind)
        if get_origin(kind) is Annotated:
            for constraint in options[1:]:
                constraints.extend(constraint.metadata if isinstance(constraint, FieldInfo) else [constraint])
            kind = options[0]
        elif get_origin(kind) in (Union, UnionType) and len(options) == 2 and options[1] is NoneType:
            kind, optional = options[0], True
        else:
            return _Annotation(kind, constraints, optional)


def _locate(kind: Any, loc: tuple[Any, ...]) -> tuple[str, Any]:
    """Return the location of a finding of pydantic, in Python's notation, and the annotation there."""
    path = ""
    for key in loc:
        outer = _unpack(kind).type
        if dataclasses.is_dataclass(outer):
            name = dataclasses.fields(outer)[key].name if isinstance(key, int) else key
            kind = typing.get_type_hints(outer, include_extras=True).get(name, Any)
            path += f".{name}" if path else name
        elif get_origin(outer) is tuple:
            options = get_args(outer)
            kind = options[0] if Ellipsis in options else options[key]
            path += f"[{key}]"
        elif key != "[key]":
            kind = Any
            path += f".{key}"
    return path, kind


def _unknown_keys(kind: type, loc: tuple[Any, ...], keys: list[str]) -> str:
    path, inner = _locate(kind, loc)
    cls = _unpack(inner).type
    known = _field_names(cls)
    return f"{path or cls.__name__} has no {_with_suggestion(keys, known)}; it has {', '.join(known)}"


def _field_names(cls: Any) -> list[str]:
    return [field.name for field in dataclasses.fields(cls)]


def _with_suggestion(unknown: list[str], known: list[str]) -> str:
    return ", ".join(map(repr, unknown)) + did_you_mean(unknown[0], known)


def _wrong_value(kind: type, error: Any, show: Callable[[Any], str]) -> str:
    if error["type"] == "unexpected_positional_argument":
        return f"{kind.__name__} has only {len(dataclasses.fields(kind))} fields"  # pyright: ignore[reportArgumentType]
    loc = error["loc"]
    is_key = error["type"] == "invalid_key" or loc[-1:] == ("[key]",)
    if is_key:  # the mapping is at fault, not what stands under the key
        loc = loc[: -2 if loc[-1] == "[key]" else -1]
    path, inner = _locate(kind, loc)
    prefix = f"{path}: " if path else ""
    if error["type"] == "missing":
        return f"{path} is missing"
    if error["type"] in ("value_error", "assertion_error"):
        return f"{prefix}{error['ctx']['error']}"
    value = show(error["input"])
    value = value if len(value) <= MAX_VALUE_CHARS else value[:MAX_VALUE_CHARS] + "..."
    if is_key:
        outer = _unpack(inner).type
        known = f"; it has {', '.join(_field_names(outer))}" if dataclasses.is_dataclass(outer) else ""
        return f"{prefix}a key must be a string, got {value}{known}"
    hint = "".join(f" ({constraint.text})" for constraint in _unpack(inner).constraints if isinstance(constraint, Hint))
    return f"{path or kind.__name__} must be {_expected(inner)}{hint}, got {value}"


def _expected(kind: Any) -> str:
    """Return what a value must be, in words."""
    outer, constraints, optional = _unpack(kind)
    options = get_args(outer)
    if get_origin(outer) is Literal:
        words = f"one of {', '.join(map(repr, options))}"
    elif get_origin(outer) is tuple:
        words = "a list" if Ellipsis in options else f"a pair, each {_expected(options[0])}"
    elif outer in (int, float):
        whole_word, finite = "whole " * (outer is int), "finite " * (AllowInfNan(False) in constraints)
        words = f"a {finite}{whole_word}number{_range(constraints)}"
    elif any(type(constraint) is InstanceOf for constraint in constraints):
        words = f"{'an' if outer.__name__[0] in 'AEIOU' else 'a'} {outer.__name__}"
    else:
        words = {bool: "true or false", str: "a string"}.get(outer, "a mapping")
    return words + " or None" * optional


def _range(constraints: list[Any]) -> str:
    """Return the limits of a number in words, after a space."""
    limits = {
        name: f"{value:g}" if isinstance(value, float) else str(value)
        for constraint in constraints
        for name in ("ge", "gt", "le", "lt")
        if (value := getattr(constraint, name, None)) is not None
    }
    if limits.keys() >= {"ge", "le"}:
        return f" from {limits['ge']} to {limits['le']}"
    words = {"ge": "of at least", "gt": "above", "le": "at most", "lt": "below"}
    return "".join(f" {words[name]} {value} and" for name, value in limits.items()).removesuffix(" and")
