"""A copy of the tiny results that tests may spoil."""

import shutil
from pathlib import Path

import pytest

HERE = Path(__file__).parent


@pytest.fixture
def tiny_results(tmp_path: Path) -> Path:
    """A results folder of two levels: a baseline, a finished run and a failed one."""
    return Path(shutil.copytree(HERE / "tiny_results", tmp_path / "results"))
