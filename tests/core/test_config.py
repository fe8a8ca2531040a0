"""Tests of frozen configs: which values are accepted, and what the errors say."""

from decimal import Decimal
from fractions import Fraction
from typing import Any, Literal

import numpy as np
import pytest
from pydantic import PositiveInt

from thalweg.core.config import FinitePositive, PairOf, TupleOf, frozen_config, parse_config, refuse_unknown, to_plain


class ExampleError(ValueError):
    """The error of the configs below."""


@frozen_config(ExampleError)
class Example:
    """One field of each type."""

    steps: PositiveInt = 1
    rate: FinitePositive = 0.5
    limits: PairOf[float] = (0.0, 1.0)
    sizes: TupleOf[int] = (64, 64)
    decay: bool = False
    rule: Literal["dual", "ascent"] = "dual"


@frozen_config(ExampleError, numpy_scalars=True)
class NumpyExample(Example):
    """The same fields, which accept NumPy's scalars."""


NOT_NUMBERS = ["1", b"1", True, None, 1j, Decimal(1), Fraction(1), np.array(1.0), np.bool_(True), [1.0]]
WRONG = [
    *(("rate", value) for value in (*NOT_NUMBERS, 0.0, float("nan"), float("inf"), 10**400)),
    *(("steps", value) for value in (*NOT_NUMBERS, 0, 2.5, 2.0, float("nan"))),
    *(("decay", value) for value in (0, 1, "yes", None, 0.0)),
    *(("limits", value) for value in (1.0, (0.0, 1.0, 2.0), (0.0, np.array(1.0)), (0.0, "1"), "01")),
    *(("rule", value) for value in ("pid", None, 1, ["dual"])),
]
NUMPY_SCALARS = [
    ("rate", np.float32(0.25)),
    ("rate", np.int64(2)),
    ("steps", np.int64(2)),
    ("decay", np.bool_(True)),
    ("limits", (np.float32(0.0), 1.0)),
]


@pytest.mark.parametrize("kind", [Example, NumpyExample])
@pytest.mark.parametrize(("field", "value"), WRONG)
def test_a_wrong_value_is_refused_by_name(kind: type, field: str, value: Any):
    with pytest.raises(ExampleError, match=rf"^{field}.* must be .*, got "):
        kind(**{field: value})
    with pytest.raises(ExampleError, match=rf"^{field}.* must be .*, got "):
        parse_config(kind, {field: value})


def test_a_pair_of_one_number_is_refused():
    with pytest.raises(ExampleError, match=r"^limits\[1\] is missing$"):
        Example(limits=(0.0,))  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(("field", "value"), NUMPY_SCALARS)
def test_numpy_scalars_are_refused_unless_a_config_accepts_them(field: str, value: Any):
    with pytest.raises(ExampleError, match=f"{field}.* must be .*, got .*np"):
        Example(**{field: value})
    with pytest.raises(ExampleError, match=f"{field}.* must be .*, got .*np"):
        parse_config(Example, {field: value})
    accepted = getattr(NumpyExample(**{field: value}), field)
    assert accepted == value
    assert not isinstance(accepted, np.generic)


def test_scalars_that_are_floats_and_strings_of_python_too_become_those():
    config = Example(rate=np.float64(0.25), rule=np.str_("ascent"))  # pyright: ignore[reportArgumentType]
    assert (config.rate, type(config.rate), type(config.rule)) == (0.25, float, str)


def test_integers_become_floats_and_lists_become_tuples():
    config = parse_config(Example, {"rate": 1, "sizes": [32, 16], "limits": [0, 2]})
    assert (config.rate, config.sizes, config.limits) == (1.0, (32, 16), (0.0, 2.0))
    assert type(config.rate) is float
    assert to_plain(config)["sizes"] == [32, 16]
    assert parse_config(Example, to_plain(config)) == config


def test_an_unknown_key_lists_the_known_ones_and_suggests_the_nearest():
    with pytest.raises(ExampleError, match=r"no 'rat' \(did you mean 'rate'\?\); it has steps, rate, .*, rule"):
        parse_config(Example, {"rat": 0.2})
    with pytest.raises(ExampleError, match="has no 'xyzzy'; it has "):
        Example(xyzzy=0.2)  # pyright: ignore[reportCallIssue]
    with pytest.raises(ExampleError, match=r"unknown option 'rat' \(did you mean 'rate'\?\); known: rate, rule"):
        refuse_unknown("option", ["rat"], ["rate", "rule"], ExampleError)


def test_a_message_begins_with_its_source_and_repeats_the_value():
    with pytest.raises(ExampleError, match=r"^run\.yaml: rate must be a finite number above 0, got -0\.5$"):
        parse_config(Example, {"rate": -0.5}, "run.yaml")
