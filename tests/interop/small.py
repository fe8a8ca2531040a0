"""Small environments for the tests of adapters, and comparison of what they return, to the bit."""

import os
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from thalweg.render import Camera

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "other-libraries.md"
OPTIONS: dict[str, Any] = {"camera": Camera(40, 48), "quality": "fast", "max_steps": 12}
"""Options of small environments whose episodes are short."""


def single(**options: Any) -> gymnasium.Env:
    """Return a single environment with small frames."""
    return gymnasium.make("thalweg/Easy-v0", **{**OPTIONS, **options})


def vector(num_envs: int = 3, **options: Any) -> gymnasium.vector.VectorEnv:
    """Return the native vector environment with small frames."""
    return gymnasium.make_vec("thalweg/Easy-v0", num_envs=num_envs, **{**OPTIONS, **options})


def actions(space: gymnasium.Space, steps: int, seed: int = 0) -> list[Any]:
    """Return random actions of a space."""
    space.seed(seed)
    return [space.sample() for _ in range(steps)]


def assert_same(found: Any, expected: Any, where: str = "it") -> None:
    """Assert that two nested values are the same to the bit, with the same types of arrays."""
    if isinstance(expected, Mapping):
        assert set(found) == set(expected), where
        for key, value in expected.items():
            assert_same(found[key], value, f"{where}[{key!r}]")
    elif isinstance(expected, list | tuple):
        assert len(found) == len(expected), where
        for index, value in enumerate(expected):
            assert_same(found[index], value, f"{where}[{index}]")
    else:
        first, second = np.asarray(found), np.asarray(expected)
        assert (first.dtype, first.shape) == (second.dtype, second.shape), where
        assert first.tobytes() == second.tobytes(), where


def output_of(*arguments: str, cwd: Path) -> str:
    """Return the standard output of Python with some arguments; fails with its errors."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, *arguments]
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def output_of_example(name: str, *arguments: str, cwd: Path) -> str:
    """Return the standard output of a script in examples/interop."""
    return output_of(str(ROOT / "examples" / "interop" / name), *arguments, cwd=cwd)


def output_of_page(section: str, smaller: Mapping[str, str], cwd: Path) -> str:
    """Return the standard output of the Python in a section of the page on other libraries, with smaller numbers."""
    text = PAGE.read_text().partition(f"\n## {section}\n")[2].partition("\n## ")[0]
    (block,) = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    for shown, run in smaller.items():
        assert shown in block, shown
        block = block.replace(shown, run)
    return output_of("-c", block, cwd=cwd)
