"""Leaves this folder out where slow tests are not asked for: its tests import the compiler for GPUs."""

from pathlib import Path

import pytest


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """True under `-m "not slow"`, which `make test` runs without having installed that compiler."""
    return True if config.option.markexpr == "not slow" else None
