"""A copy of the tiny results that tests may spoil, and reports that draw nothing."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.bench.small_backend import draw_nothing
from tests.bench.versioned import record_current_versions

HERE = Path(__file__).parent


@pytest.fixture
def tiny_results(tmp_path: Path) -> Path:
    """A results folder of two levels: a baseline, a finished run and a failed one."""
    folder = Path(shutil.copytree(HERE / "tiny_results", tmp_path / "results"))
    record_current_versions(folder)
    return folder


@pytest.fixture(scope="module")
def no_pictures() -> Iterator[None]:
    """Reports without figures, for tests of what else there is: all figures together take ten seconds."""
    with pytest.MonkeyPatch.context() as patch:
        draw_nothing(patch)
        yield
