"""Worlds that many tests share, taken from the cache folder where they were built before; and what is said of tests for
a GPU where there is none."""

import pytest

from thalweg.devices import missing_for_cuda
from thalweg.world import World, load_or_build

NO_GPU = "NO GPU"
"""What reasons begin with that are counted at the end."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip what needs a GPU where none can be used, with what is missing."""
    marked = [item for item in items if item.get_closest_marker("gpu")]
    missing = missing_for_cuda() if marked else ""
    for item in marked if missing else ():
        item.add_marker(pytest.mark.skip(reason=f"{NO_GPU}: {missing}"))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say how many tests were not run for want of a GPU."""
    skipped = terminalreporter.stats.get("skipped", [])
    count = sum(NO_GPU in str(report.longrepr) for report in skipped)
    if count:
        terminalreporter.section(f"{count} TESTS NEED A GPU AND WERE NOT RUN", yellow=True)


@pytest.fixture(scope="session")
def easy_world() -> World:
    """The fixed river of the level Easy."""
    return load_or_build("Easy")


@pytest.fixture(scope="session")
def medium_world() -> World:
    """The fixed river of the level Medium."""
    return load_or_build("Medium")


@pytest.fixture(scope="session")
def hard_world() -> World:
    """The fixed river of the level Hard."""
    return load_or_build("Hard")
