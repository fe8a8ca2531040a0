import dataclasses
import inspect

import pytest

from thalweg.algos import ALGORITHMS, AlgorithmError, algorithm_named
from thalweg.algos.onpolicy.focops import FOCOPSConfig
from thalweg.core.config import parse_config, to_plain


def test_an_unknown_algorithm_lists_the_known_ones():
    with pytest.raises(AlgorithmError, match="'TRPO'; there are PPO, PPOLag, FOCOPS"):
        algorithm_named("TRPO")


def test_a_name_is_found_in_any_case():
    assert algorithm_named("focops").name == "FOCOPS"


def test_an_unknown_key_lists_the_known_ones():
    with pytest.raises(
        AlgorithmError, match=r"no 'cost_limt'.*; it has steps_per_update, .*, cost_limit, .*, temperature"
    ):
        parse_config(FOCOPSConfig, {"cost_limt": 0.2})


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("cost_limit", -0.1, "must be a finite number of at least 0"),
        ("cost_limit", "low", "must be a finite number of at least 0"),
        ("passes", 2.5, "must be a whole number above 0"),
        ("passes", True, "must be a whole number above 0"),
        ("mask", "all", "must be one of 'state', 'batch', got 'all'"),
        ("hidden", (64, "64"), r"hidden\[1\] must be a whole number above 0"),
        ("discount", 1.5, "must be a number from 0 to 1, got 1.5"),
        ("linear_decay", 1, "must be true or false"),
        ("discount", float("nan"), "must be a number from 0 to 1, got nan"),
    ],
)
def test_a_wrong_value_is_named(key: str, value: object, words: str):
    with pytest.raises(AlgorithmError, match=words) as caught:
        parse_config(FOCOPSConfig, {key: value})
    assert key in str(caught.value)


def test_a_misspelt_key_is_met_with_the_one_that_was_meant():
    with pytest.raises(AlgorithmError, match=r"has no 'cost_limt' \(did you mean 'cost_limit'\?\); it has "):
        parse_config(FOCOPSConfig, {"cost_limt": 0.1})
    with pytest.raises(AlgorithmError, match="has no 'xyzzy'; it has "):
        parse_config(FOCOPSConfig, {"xyzzy": 0.1})


def test_a_number_out_of_range_is_repeated():
    with pytest.raises(AlgorithmError, match=r"^cost_limit must be a finite number of at least 0, got -0\.5$"):
        FOCOPSConfig(cost_limit=-0.5)


def test_whole_numbers_and_lists_become_what_the_field_wants():
    config = parse_config(FOCOPSConfig, {"cost_limit": 1, "hidden": [32, 16]})
    assert (config.cost_limit, config.hidden) == (1.0, (32, 16))
    assert to_plain(config)["hidden"] == [32, 16]


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
def test_a_whole_config_is_checked_like_a_mapping(changes: dict, words: str):
    with pytest.raises(AlgorithmError, match=words):
        ALGORITHMS["FOCOPS"].configure(FOCOPSConfig(**changes))


@pytest.mark.parametrize("entry", ALGORITHMS.values(), ids=lambda entry: entry.name)
def test_a_config_survives_its_plain_data(entry):
    assert parse_config(entry.config, to_plain(entry.config())) == entry.config()


@pytest.mark.parametrize("entry", ALGORITHMS.values(), ids=lambda entry: entry.name)
def test_a_config_is_frozen_and_each_field_is_documented_where_it_stands(entry):
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


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ((0.1,), r"cost_limits must be two, tight and loose, got \[0\.1\]"),
        ((0.1, 0.2, 0.3), r"cost_limits must be two, tight and loose, got \[0\.1, 0\.2, 0\.3\]"),
        ((0.1, -0.2), r"cost_limits\[1\] must be a finite number of at least 0, got -0\.2"),
    ],
)
def test_limits_of_costs_apart_are_two(limits: tuple[float, ...], words: str):
    with pytest.raises(AlgorithmError, match=words):
        FOCOPSConfig(cost_limits=limits)


def test_limits_of_costs_apart_stand_in_place_of_the_one():
    together, apart = FOCOPSConfig(cost_limit=0.3), FOCOPSConfig(cost_limit=0.3, cost_limits=(0.1, 0.2))
    assert (together.limits, together.separate_costs) == ((0.3,), False)
    assert (apart.limits, apart.separate_costs) == ((0.1, 0.2), True)
