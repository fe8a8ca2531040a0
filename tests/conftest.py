"""Worlds that many tests share, and the marks of tests that need a GPU, a browser, Ray or the compiler for GPUs."""

from collections.abc import Callable, Iterator
from importlib.util import find_spec

import pytest

from tests.browser import Browser, missing_for_browser
from thalweg.core.compute.device import cuda_unavailable_reason
from thalweg.world import World, load_or_build


def missing_for_ray() -> str:
    """Return what must be installed for a cluster, or an empty string."""
    return "" if find_spec("ray") else "pip install -r requirements-cluster.lock"


NEEDS: dict[str, tuple[str, Callable[[], str]]] = {
    "gpu": ("A GPU", cuda_unavailable_reason),
    "browser": ("A BROWSER", missing_for_browser),
    "ray": ("RAY", missing_for_ray),
}
"""For each mark: what its tests need, and a function that says what is missing."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests that need more than `requirements.lock` as slow; skip those whose need is not met, and say so."""
    for item in items:
        if item.nodeid.startswith("tests/cuda/") or any(item.get_closest_marker(mark) for mark in NEEDS):
            item.add_marker(pytest.mark.slow)
    for mark, (thing, missing_for) in NEEDS.items():
        marked = [item for item in items if item.get_closest_marker(mark)]
        missing = missing_for() if marked else ""
        for item in marked if missing else ():
            item.add_marker(pytest.mark.skip(reason=f"NEEDS {thing}: {missing}"))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Report the number of tests that were skipped for each missing requirement, and the reason."""
    skipped = [str(report.longrepr) for report in terminalreporter.stats.get("skipped", [])]
    for thing, _ in NEEDS.values():
        reasons = [words.split(f"NEEDS {thing}: ")[1].rstrip("')") for words in skipped if f"NEEDS {thing}: " in words]
        if reasons:
            terminalreporter.section(f"{len(reasons)} TESTS NEED {thing} AND WERE NOT RUN", yellow=True)
            terminalreporter.line("; ".join(dict.fromkeys(reasons)))


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


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    browser = Browser()
    yield browser
    browser.close()
