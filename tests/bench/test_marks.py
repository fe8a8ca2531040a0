"""The marks of what made results: everything that a number depends on is in them."""

import ast
from pathlib import Path

import pytest

from thalweg.bench.execute import rivers as river
from thalweg.bench.studies import encoder_study
from thalweg.core import cache

OF_NO_NUMBER = {
    "announce": "says what is going on",
    "bars": "says what is going on",
    "cores": "how many threads, which change no number",
    "devices": "where, not what",
    "encoder_tables": "what is made of measures",
    "episodes": "how rows are written",
    "figures": "what is made of measures",
    "files": "how rows are written",
    "film": "pictures of flights",
    "maps": "pictures of flights",
    "film_format": "pictures of flights",
    "results": "where files lie",
    "threads": "who computes, which changes no number",
    "suites": "stands in the results itself",
    "whole": "how files are written",
    "cache": "where files lie",
}
"""Modules that may be imported by what makes numbers without being in its mark, and why."""


def modules_of(sources: tuple[str, ...]) -> list[Path]:
    found = [cache.PACKAGE / source for source in sources]
    return [path for place in found for path in (sorted(place.rglob("*.py")) if place.is_dir() else [place])]


def imported_by(path: Path) -> set[str]:
    """Modules of the package, as `train/collect`, by dotted imports anywhere in the file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module}
    names |= {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    return {name.removeprefix("thalweg.").replace(".", "/") for name in names if name.startswith("thalweg.")}


def missing(sources: tuple[str, ...]) -> set[str]:
    stems = [source.removesuffix(".py") for source in sources]
    imported = {name for path in modules_of(sources) for name in imported_by(path)}
    return {
        name
        for name in imported
        if not any(name == stem or name.startswith(f"{stem}/") for stem in stems)
        and name.split("/")[-1] not in OF_NO_NUMBER
    }


@pytest.mark.parametrize("sources", [river.SOURCES, encoder_study.SOURCES], ids=["suite", "encoder study"])
def test_what_makes_numbers_imports_nothing_that_is_not_marked(sources: tuple[str, ...]):
    assert all((cache.PACKAGE / source).exists() for source in sources)
    assert missing(sources) == set()


def test_a_source_that_is_left_out_is_missed():
    assert missing(tuple(source for source in river.SOURCES if source != "bench/conditions.py")) == {"bench/conditions"}
    assert "train/collect" in missing(tuple(each for each in encoder_study.SOURCES if each != "train/collect.py"))
