"""Tests that kernels of frames and rules count references only outside loops: each count is an atomic operation."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from thalweg.core.cache import PACKAGE

SOURCES = sorted([*(PACKAGE / "render" / "kernels").rglob("*.py"), *(PACKAGE / "env" / "task").rglob("*.py")])


def counting_kernels(source: str) -> Iterator[ast.FunctionDef]:
    """The functions of a module that `kernel` decorates without `allocates=False`, so that they count references."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef):
            for decorator in map(ast.unparse, node.decorator_list):
                if decorator.startswith("kernel") and "allocates=False" not in decorator:
                    yield node


def has_loop(function: ast.FunctionDef) -> bool:
    return any(isinstance(node, ast.For | ast.While) for node in ast.walk(function))


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.stem)
def test_kernels_that_allocate_have_no_loops(path: Path):
    found = [function.name for function in counting_kernels(path.read_text(encoding="utf-8")) if has_loop(function)]
    assert not found


def test_kernels_that_allocate_are_recognised():
    source = """
@kernel
def first(n):
    for _ in range(n): pass
@kernel(disjoint=True)
def second(n):
    while n: pass
@kernel(inlined=True, allocates=False)
def third(n):
    for _ in range(n): pass
@kernel
def fourth(n): return n
def fifth(n):
    for _ in range(n): pass
"""
    assert [(one.name, has_loop(one)) for one in counting_kernels(source)] == [
        ("first", True),
        ("second", True),
        ("fourth", False),
    ]
