"""Tests of the registry of algorithms and of the configs in it."""

import dataclasses
import inspect

import pytest

from thalweg.algos import ALGORITHMS, AlgorithmError, algorithm_named
from thalweg.algos.onpolicy.focops import FOCOPSConfig
from thalweg.core.config import parse_config, to_plain


def test_an_unknown_algorithm_lists_the_known_ones():
    with pytest.raises(AlgorithmError, match=r"there is no algorithm 'TRPO'; there are PPO, PPOLag, FOCOPS"):
        algorithm_named("TRPO")


def test_a_name_is_found_in_any_case():
    assert algorithm_named("focops").name == "FOCOPS"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"activation": "gelu"}, r"activation must be one of 'tanh'.*, got 'gelu'"),
        ({"memory": "lstm"}, "memory must be one of"),
        ({"mask": "all"}, "mask must be one of"),
        ({"multiplier_rule": "pid"}, "multiplier_rule must be one of"),
        ({"passes": 2.5}, "passes must be a whole number above 0, got 2.5"),
    ],
)
def test_a_complete_config_is_checked_like_a_mapping(changes: dict, words: str):
    with pytest.raises(AlgorithmError, match=words):
        ALGORITHMS["FOCOPS"].configure(FOCOPSConfig(**changes))


@pytest.mark.parametrize("entry", ALGORITHMS.values(), ids=lambda entry: entry.name)
def test_a_config_equals_itself_after_conversion_to_plain_data_and_back(entry):
    assert parse_config(entry.config, to_plain(entry.config())) == entry.config()


@pytest.mark.parametrize("entry", ALGORITHMS.values(), ids=lambda entry: entry.name)
def test_each_config_is_frozen_and_each_field_has_a_docstring(entry):
    with pytest.raises(dataclasses.FrozenInstanceError):
        entry.config().hidden = (1,)
    documented: set[str] = set()
    kinds: tuple[type, ...] = entry.config.__mro__[:-1]
    for kind in kinds:
        lines = [line.strip() for line in inspect.getsource(kind).splitlines()]
        for name in inspect.get_annotations(kind):
            at = next(i for i, line in enumerate(lines) if line.startswith(f"{name}:"))
            assert lines[at + 1].startswith('"""'), f"{kind.__name__}.{name}"
            documented.add(name)
    assert documented == {field.name for field in dataclasses.fields(entry.config)}
