"""A small course for evaluations, and a copy of the tiny results that tests may spoil."""

import shutil
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "env"))  # the handmade courses


@pytest.fixture
def tiny_results(tmp_path: Path) -> Path:
    """A results folder of two levels: a baseline, a finished run and a failed one."""
    return Path(shutil.copytree(HERE / "tiny_results", tmp_path / "results"))
