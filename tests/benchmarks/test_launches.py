"""Tests of the table of launches and of the sentence of its page."""

import importlib
from pathlib import Path
from types import ModuleType

import pytest

from thalweg.core import versions


@pytest.fixture
def launches(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "benchmarks")
    return importlib.import_module("launches")


def row(name: str, acting: float, learning: float, version: int = 0) -> dict[str, str]:
    values = name, 64, version or versions.ALGORITHMS[name], acting, learning
    return dict(zip(("algorithm", "environments", "version", "acting", "learning"), map(str, values), strict=True))


def test_the_sentence_has_the_least_and_the_greatest_number_of_each_kind(launches: ModuleType):
    rows = [row("PPO", 45.6, 300.2), row("CUP", 45.9, 1400.0), row("SafeLOOP", 990.0, 5000.0)]
    assert " ".join(launches.sentence(rows).split()).startswith(
        "For 64 environments, an on-policy algorithm needs 46 to act and 300 to 1,400 to learn, "
        "a planner needs 990 to act and 5,000 to learn. Not counted in today's version: "
    )


def test_algorithms_without_a_row_of_todays_version_are_named(launches: ModuleType):
    rows = [row(name, 45.6, 300.2, version=(name == "PPO")) for name in versions.ALGORITHMS]
    assert launches.sentence(rows).endswith(" Not counted in today's version: PPO.\n")


def test_the_table_has_every_algorithm(launches: ModuleType):
    found = launches.rows_of(launches.TABLE, launches.COLUMNS)
    assert {each["algorithm"] for each in found} == versions.ALGORITHMS.keys()


def test_the_page_says_what_the_table_has(launches: ModuleType):
    page = launches.PAGE.read_text(encoding="utf-8")
    said = launches.sentence(launches.rows_of(launches.TABLE, launches.COLUMNS))
    assert launches.replace_section(page, launches.SECTION, said) == page, "python benchmarks/launches.py --write"
