"""Tests of the messages about wrong settings of on-policy algorithms."""

import numpy as np
import pytest

from thalweg.algos import AlgorithmError
from thalweg.algos.onpolicy.focops import FOCOPSConfig
from thalweg.core.config import parse_config, to_plain


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("cost_limit", -0.1, "must be a finite number of at least 0"),
        ("cost_limit", "low", "must be a finite number of at least 0"),
        ("passes", 2.5, "must be a whole number above 0"),
        ("passes", True, "must be a whole number above 0"),
        ("mask", "all", "must be one of 'state', 'batch', got 'all'"),
        ("hidden", (64, "64"), r"hidden\[1\] must be a whole number from 1 to 65536"),
        ("discount", 1.5, "must be a number from 0 to 1, got 1.5"),
        ("linear_decay", 1, "must be true or false"),
        ("discount", float("nan"), "must be a number from 0 to 1, got nan"),
        ("discount", np.float32(0.5), r"must be a number from 0 to 1, got np.float32\(0.5\)"),
        ("passes", np.int64(2), r"must be a whole number above 0, got np.int64\(2\)"),
        ("hidden", (np.int64(2),), r"hidden\[0\] must be a whole number from 1 to 65536, got np.int64\(2\)"),
        ("linear_decay", np.bool_(True), "must be true or false, got np.True_"),
    ],
)
def test_the_message_names_the_field_of_a_wrong_value(key: str, value: object, words: str):
    with pytest.raises(AlgorithmError, match=words) as caught:
        parse_config(FOCOPSConfig, {key: value})
    assert key in str(caught.value)


def test_the_message_repeats_a_number_out_of_range():
    with pytest.raises(AlgorithmError, match=r"^cost_limit must be a finite number of at least 0, got -0\.5$"):
        FOCOPSConfig(cost_limit=-0.5)


def test_integers_and_lists_become_floats_and_tuples():
    config = parse_config(FOCOPSConfig, {"cost_limit": 1, "hidden": [32, 16]})
    assert (config.cost_limit, config.hidden) == (1.0, (32, 16))
    assert to_plain(config)["hidden"] == [32, 16]


def test_an_unknown_key_lists_the_known_ones():
    with pytest.raises(
        AlgorithmError, match=r"no 'cost_limt'.*; it has steps_per_update, .*, cost_limit, .*, temperature"
    ):
        parse_config(FOCOPSConfig, {"cost_limt": 0.2})


def test_the_nearest_key_is_suggested_for_a_misspelt_one():
    with pytest.raises(AlgorithmError, match=r"has no 'cost_limt' \(did you mean 'cost_limit'\?\); it has "):
        parse_config(FOCOPSConfig, {"cost_limt": 0.1})
    with pytest.raises(AlgorithmError, match="has no 'xyzzy'; it has "):
        parse_config(FOCOPSConfig, {"xyzzy": 0.1})
