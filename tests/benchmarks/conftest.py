"""Scripts of `benchmarks/` as modules, and results for them."""

import importlib
import shutil
import sys
from pathlib import Path
from types import ModuleType

import pytest

from tests.bench.versioned import record_current_versions

TESTS = Path(__file__).resolve().parents[1]


@pytest.fixture
def tiny_results(tmp_path: Path) -> Path:
    """A copy of the results of two levels that the tests of the package use."""
    folder = Path(shutil.copytree(TESTS / "bench" / "tiny_results", tmp_path / "results"))
    record_current_versions(folder)
    return folder


@pytest.fixture
def findings(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """`benchmarks/findings.py`, with an empty cache of results."""
    monkeypatch.syspath_prepend(TESTS.parent / "benchmarks")
    monkeypatch.delitem(sys.modules, "findings", raising=False)
    return importlib.import_module("findings")
