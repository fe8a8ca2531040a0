"""Scripts of `benchmarks/reliability` as modules."""

import importlib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

SCRIPTS = Path(__file__).resolve().parents[3] / "benchmarks" / "reliability"


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], ModuleType]:
    """Import of a script by its name."""
    monkeypatch.syspath_prepend(SCRIPTS)
    return importlib.import_module
