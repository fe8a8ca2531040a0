"""Imports between the parts of the package go one way only, local imports counted too."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "thalweg"

LAYERS = ("whole", "cache", "kernel", "threads", "devices", "gpu", "world", "render", "env")
"""Each may import those to its left."""

ALLOWED: dict[str, set[str]] = {part: set(LAYERS[:index]) for index, part in enumerate(LAYERS)}
ALLOWED["cores"] = set()
ALLOWED["encoder"] = {"whole", "cache", "cores", "devices"}
ALLOWED["algos"] = {"whole", "kernel"}
ALLOWED["train"] = {*LAYERS, "cores", "encoder", "algos"}
ALLOWED["numbers_in_yaml"] = set()
ALLOWED["bench"] = {*ALLOWED["train"], "train", "numbers_in_yaml"}
ALLOWED["options"] = {"world", "numbers_in_yaml"}
ALLOWED["commands"] = {*ALLOWED["bench"], "bench", "options"}
ALLOWED["cli"] = {"commands", "options"}
ALLOWED["__init__"] = set(LAYERS)


def imported_parts(source: str, package: str) -> Iterator[tuple[int, str]]:
    """Line and part of the package for each import of Thalweg in a module of `package` (such as `thalweg.bench`)."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parents = package.split(".")
                base = ".".join([*parents[: len(parents) - node.level + 1], *([base] if base else [])])
            names = [f"{base}.{alias.name}" for alias in node.names]
        else:
            continue
        for name in names:
            root, *rest = name.split(".")
            if root == "thalweg" and rest:
                yield node.lineno, rest[0]


def wrong_imports(file: Path) -> list[str]:
    """One line for each import in the file that the order of the parts does not allow."""
    inner = file.relative_to(PACKAGE)
    part = inner.parts[0].removesuffix(".py")
    package = ".".join(["thalweg", *inner.parent.parts])
    return [
        f"thalweg/{inner.as_posix()}:{line}: {part} may not import {imported}"
        for line, imported in imported_parts(file.read_text(), package)
        if imported != part and imported in ALLOWED and imported not in ALLOWED[part]
    ]


def test_every_part_of_the_package_has_its_place_in_the_order():
    parts = {path.relative_to(PACKAGE).parts[0].removesuffix(".py") for path in PACKAGE.rglob("*.py")}
    assert parts <= set(ALLOWED)


def test_imports_go_one_way():
    found = [line for file in sorted(PACKAGE.rglob("*.py")) for line in wrong_imports(file)]
    assert not found, "\n".join(found)


def test_nothing_imports_ray_before_a_cluster_is_asked_for():
    import re

    found = [
        path.name for path in PACKAGE.rglob("*.py") if re.search(r"^\s*(import|from) ray\b", path.read_text(), re.M)
    ]
    assert found == []


def test_no_algorithm_imports_another():
    from thalweg.algos.registry import ALGORITHMS

    modules = {entry.config.__module__ for entry in ALGORITHMS.values()}
    for module in modules:
        source = (PACKAGE.parent / (module.replace(".", "/") + ".py")).read_text()
        for other in modules - {module}:
            assert other not in source
            assert f"from thalweg.algos import {other.split('.')[-1]}" not in source


@pytest.mark.parametrize(
    ("line", "part"),
    [
        ("import thalweg.env", "env"),
        ("from thalweg import env", "env"),
        ("from thalweg.env.rules import step", "env"),
        ("from ..env import step", "env"),
        ("def later():\n    from thalweg.env import step", "env"),
    ],
)
def test_every_way_to_write_an_import_is_seen(line: str, part: str):
    assert [name for _, name in imported_parts(line, "thalweg.render")] == [part]
