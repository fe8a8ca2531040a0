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
        ("010", 10),
        ("-007", -7),
        ("1_000", 1000),
        ("0o10", 8),
        ("-0x1F", -31),
        ("0b101", 5),
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


LAUGHS = "\n".join(
    ["a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    + [f"{to}: &{to} [{', '.join([f'*{of}'] * 10)}]" for of, to in zip("abcdefgh", "bcdefghi", strict=True)]
)
"""Some lines that stand for a billion values."""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("day: 2020-99-99", "cannot be read"),
        ("number: 0b_", "cannot be read"),
        ("flag: !!bool 3", "cannot be read"),
        ("[" * 5000, "nested too deep"),
        ("&a [*a]", "an alias of what it is part of"),
        ("a: &a {b: [1, *a]}", "an alias of what it is part of"),
        (LAUGHS, "more than 1,000,000 values"),
        ('name: "\\ud800"', "text that is not Unicode"),
    ],
)
def test_what_cannot_be_read_is_a_yaml_error(text: str, words: str):
    with pytest.raises(yaml.YAMLError, match=words):
        yaml12.load(text)


def test_aliases_stand_for_what_they_name():
    assert yaml12.load("a: &x [1, 2]\nb: *x\nc: {d: *x}") == {"a": [1, 2], "b": [1, 2], "c": {"d": [1, 2]}}


def test_files_that_pyyaml_wrote_are_read_as_it_reads_them():
    written = {"text": "1e5", "number": 1e-4, "range": "1:16", "none": None}
    assert yaml12.load(yaml.safe_dump(written), yaml.SafeLoader) == written
    assert yaml12.load("") is None
