"""Tests of the YAML loader: numbers as in YAML 1.2, and duplicate keys."""

import pytest
import yaml

from thalweg.core import yaml12


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-4", 1e-4),
        ("2E5", 2e5),
        ("-.5", -0.5),
        ("+1.", 1.0),
        ("7", 7),
        ("1e", "1e"),
        ("v1", "v1"),
        ("1:16", "1:16"),
        ("-12", -12),
    ],
)
def test_numbers_are_read_as_in_yaml_1_2(text: str, value: object):
    found = yaml12.load(f"key: {text}")["key"]
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize("text", ["a: 1\na: 2", "b:\n  a: 1\n  a: 2"])
def test_a_duplicate_key_is_refused_by_name(text: str):
    with pytest.raises(yaml.YAMLError, match="duplicate key 'a'"):
        yaml12.load(text)
