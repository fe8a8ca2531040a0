"""Tests that kernels of frames and rules count references only outside loops: each count is an atomic operation."""

import ast
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from numba.core import runtime

from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.policy import Policy
from thalweg.core.cache import PACKAGE
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.task.ideal_eye import FEATURES
from thalweg.render import Camera
from thalweg.world import World

NUMBA: Any = runtime
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


def allocations() -> int:
    """Blocks of memory that kernels have allocated and not freed."""
    stats = NUMBA.rtsys.get_allocation_stats()
    return stats.alloc - stats.free


def test_no_memory_is_lost_by_acting_stepping_and_drawing(easy_world: World):
    """A kernel that counts no references, but gets an array from another, would never free it."""
    stats = NUMBA._nrt_python.memsys_stats_enabled()
    NUMBA._nrt_python.memsys_enable_stats()
    try:
        config = EnvConfig(camera=Camera(32, 32))
        seen = RiverVectorEnv([easy_world], 4, replace(config, observation="privileged"))
        drawn = RiverVectorEnv([easy_world], 4, config)
        policy = Policy(len(FEATURES), actions_of(seen.single_action_space))
        observations, _ = seen.reset(seed=0)
        drawn.reset(seed=0)

        def act_and_step() -> None:
            actions = policy.act(observations)
            seen.step(actions)
            drawn.step(actions)

        act_and_step()
        before = allocations()
        for _ in range(20):
            act_and_step()
        assert allocations() == before
    finally:
        if not stats:
            NUMBA._nrt_python.memsys_disable_stats()
