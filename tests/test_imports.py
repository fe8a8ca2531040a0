"""Tests of import rules that `lint-imports` cannot express, and of the completeness of its contracts."""

import re
import tomllib
from pathlib import Path

from thalweg.algos.registry import ALGORITHMS

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "thalweg"
CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]


def contract(kind: str) -> dict:
    """Return the first contract of a kind in `pyproject.toml`."""
    return next(each for each in CONTRACTS if each["type"] == kind)


def test_nothing_imports_ray_before_a_cluster_is_requested():
    found = [
        path.name for path in PACKAGE.rglob("*.py") if re.search(r"^\s*(import|from) ray\b", path.read_text(), re.M)
    ]
    assert found == []


def test_every_part_of_the_package_has_its_layer():
    parts = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").exists()}
    layers = {part.strip() for line in contract("layers")["layers"] for part in line.split("|")}
    assert layers == {f"thalweg.{part}" for part in parts}


def test_every_algorithm_is_independent_of_the_others():
    assert set(contract("independence")["modules"]) == {entry.config.__module__ for entry in ALGORITHMS.values()}
