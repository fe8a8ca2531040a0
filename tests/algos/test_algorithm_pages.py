"""The pages of the algorithms name settings that exist, with values that change something."""

import dataclasses
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from thalweg.algos.onpolicy.focops import FOCOPSConfig
from thalweg.algos.registry import ALGORITHMS
from thalweg.core.config import parse_config, to_plain

DOCS = Path(__file__).parents[2] / "docs" / "algorithms"
ADAPTERS = {"box_literal", "box_scaled"}
IMPOSSIBLE = {"impossible_value_of_reward", "impossible_value_of_cost"}
WARNINGS = {"limit_never_binds", "limit_never_met", "multiplier_too_slow"} | IMPOSSIBLE
TABLE_ROW = re.compile(r"^\| (`.*?) \|", re.M)


def page(name: str) -> str:
    """Return the text of an algorithm's page, with continued command lines joined."""
    return (DOCS / f"{name.lower()}.md").read_text().replace("\\\n", " ")


def metric_names() -> set[str]:
    """Return the columns that the metrics tables of all pages describe."""
    tables = [page(name).partition("## Metrics")[2] for name in ALGORITHMS]
    return {key for text in tables for row in TABLE_ROW.findall(text) for key in re.findall(r"`(\w+)`", row)}


def settings_named(name: str) -> set[str]:
    """Return the identifiers of two or more words that the page shows in code as settings."""
    text = page(name).partition("## Metrics")[0]
    found = set(re.findall(r"`([a-z]+(?:_[a-z0-9]+)+)(?:=[^`]*)?`", text))
    return found - WARNINGS - ADAPTERS - metric_names()


def values_in_commands(name: str) -> dict[str, Any]:
    """Return the settings that the page's commands give a value."""
    lines = re.findall(rf"--algorithm {name}.* --set (.*)", page(name))
    pairs = [pair for line in lines for pair in re.findall(r"([a-z]\w*)=(\[[^\]]*\]|[^\s']+)", line)]
    return {key: yaml.safe_load(value) for key, value in pairs}


def values_in_text(name: str) -> dict[str, Any]:
    """Return the settings that the page's text gives a value, as `key=value`."""
    return {key: yaml.safe_load(value) for key, value in re.findall(r"`([a-z]\w*)=([\w.\-]+)`", page(name))}


def fields(name: str) -> set[str]:
    return {field.name for field in dataclasses.fields(ALGORITHMS[name].config)}


@pytest.mark.parametrize("name", ALGORITHMS)
def test_every_setting_that_a_page_names_exists(name: str):
    named = settings_named(name)
    assert len(named & fields(name)) >= 2, "the page names too few settings for this test to mean anything"
    # A page may name what only another algorithm has, to say that its own has it not.
    assert sorted(named - set().union(*map(fields, ALGORITHMS))) == []


@pytest.mark.parametrize("name", ALGORITHMS)
def test_every_value_that_a_page_gives_is_accepted(name: str):
    for key, value in (values_in_text(name) | values_in_commands(name)).items():
        config = to_plain(parse_config(ALGORITHMS[name].config, {key: value}))
        assert config[key] == value


@pytest.mark.parametrize("name", [name for name in ALGORITHMS if values_in_commands(name)])
def test_every_value_in_a_command_differs_from_the_default(name: str):
    default = to_plain(ALGORITHMS[name].config())
    assert {key: value for key, value in values_in_commands(name).items() if default[key] == value} == {}


def test_the_page_names_every_setting_of_the_source_with_its_value_here():
    rows = re.findall(r"^\| (`.*?) \| (.*?) \| (.*?) \| .*\|$", (DOCS / "focops.md").read_text(), re.M)
    table = {key: (source, here) for names, source, here in rows for key in re.findall(r"`(\w+)`", names)}
    numbers = {key: float(here) for key, (_, here) in table.items() if re.fullmatch(r"[\d.e-]+", here)}
    assert {"temperature", "multiplier_rate", "learning_rate", "minibatch"} <= set(numbers)
    assert numbers == {key: getattr(FOCOPSConfig(), key) for key in numbers}
