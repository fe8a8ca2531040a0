"""A copy of the tiny results that tests may spoil, and reports that draw nothing."""

import importlib
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from tests.bench.small_place import draw_nothing

HERE = Path(__file__).parent


@pytest.fixture
def tiny_results(tmp_path: Path) -> Path:
    """A results folder of two levels: a baseline, a finished run and a failed one."""
    return Path(shutil.copytree(HERE / "tiny_results", tmp_path / "results"))


@pytest.fixture(scope="module")
def no_pictures() -> Iterator[None]:
    """Reports without figures, for tests of what else there is: all figures together take ten seconds."""
    with pytest.MonkeyPatch.context() as patch:
        draw_nothing(patch)
        yield


@pytest.fixture
def findings(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """`benchmarks/findings.py`, with nothing read yet."""
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "benchmarks")
    monkeypatch.delitem(sys.modules, "findings", raising=False)
    return importlib.import_module("findings")
