"""Tests of what a page is told to choose from."""

from pathlib import Path

import pytest

from tests.plugins import NESTS, install, no_plugins  # noqa: F401  (a fixture)
from thalweg.core.plugins.lookup import add_files
from thalweg.env.tasks import TASKS, task_named
from thalweg.viewer.errors import ViewerError
from thalweg.viewer.flight.options import FlightOptions
from thalweg.viewer.flight.rivers import Rivers
from thalweg.viewer.server.catalogue import catalogue

pytestmark = pytest.mark.usefixtures("no_plugins")


def tasks() -> dict[str, str]:
    return catalogue(Rivers(), [], FlightOptions())["tasks"]


def test_the_task_of_a_plugin_is_offered_and_can_be_flown(tmp_path: Path):
    (tmp_path / "nests.py").write_text(NESTS)
    add_files([tmp_path / "nests.py"])
    assert tasks() == {**tasks(), "HighNests": "higher nests, and more of them"}
    assert list(tasks()) == [*TASKS, "HighNests"]
    assert task_named(FlightOptions(task="HighNests").rules.task).reserve_height_m == 9.0


def test_the_task_of_a_broken_plugin_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    install(tmp_path, {"thalweg.tasks": {"Broken": "nowhere_at_all:PLUGIN"}})
    monkeypatch.syspath_prepend(str(tmp_path))
    assert list(tasks()) == list(TASKS)
    with pytest.raises(ViewerError, match="nowhere_at_all"):
        FlightOptions(task="Broken")
