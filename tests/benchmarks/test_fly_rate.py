"""The benchmark of the page's frames: what a client says and counts, its numbers, and the table of the page."""

import importlib
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tests.viewer.server.conftest import Server
from thalweg.world import World

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    monkeypatch.delitem(sys.modules, "fly_rate", raising=False)
    return importlib.import_module("fly_rate")


class Told:
    """A server that sends the `first` frames of a flight slowly, then one every 50 ms, and ends each after so many."""

    def __init__(self, lengths: list[int], first: int = 0) -> None:
        self.said: list[tuple[str, dict[str, Any]]] = []
        self.now, self._lengths, self._left, self._first, self._slow = 0.0, lengths, -1, first, 0

    def say(self, kind: str, **about: Any) -> None:
        self.said.append((kind, about))

    def hear(self) -> dict[str, Any]:
        starts = [about for kind, about in self.said if kind == "start"]
        if len(self._lengths) and self._left < 0:
            self._left, self._slow = self._lengths.pop(0), self._first
            self.now += 9.0  # the time to begin a flight
            return {"type": "started", "options": starts[-1]["options"]}
        self.now += 0.5 if self._slow > 0 else 0.05
        self._left, self._slow = self._left - 1, self._slow - 1
        return {"type": "frame", "moving": True, "ended": "" if self._left >= 0 else "lost"}


def test_intervals_are_those_within_flights_after_their_first_frames(script: ModuleType):
    page, case = Told([script.FIRST + 6, 1000], script.FIRST), script.Case(256, "pilot", "policy's view", "fastest")
    found = script.intervals(page, case, {"level": "Medium", "seed": 0}, 1.0, clock=lambda: page.now)
    assert found == pytest.approx([0.05] * 20)
    flight = [
        ("view", {"picture": "camera", "mask": True, "seen": True}),
        ("control", {"pilot": "pilot"}),
        ("run", {"paused": False, "speed": None}),
    ]
    starts = [("start", {"options": {"level": "Medium", "seed": seed, "size_px": 256}}) for seed in (0, 1)]
    assert page.said == [starts[0], *flight, starts[1], *flight, ("run", {"paused": True})]


def test_an_error_of_the_server_ends_the_measurement(script: ModuleType):
    page = Told([])
    page.hear = lambda: {"type": "error", "message": "unknown pilot"}
    with pytest.raises(RuntimeError, match="unknown pilot"):
        script.until(page, "frame")


def test_the_numbers_of_a_case(script: ModuleType):
    case = script.Case(384, "packaged", "frame", "2 x")
    found = [0.02] * 10 + [0.04] * 9 + [0.14]
    assert script.row_of(case, found) == ["384", "packaged", "frame", "2 x", "20", "28.6", "30.0", "140.0"]


def test_the_pace_that_is_told_is_the_one_the_page_begins_with(script: ModuleType):
    page = (ROOT / "thalweg" / "viewer" / "page" / "page.html").read_text(encoding="utf-8")
    assert '<option value="2" selected>' in page and script.SPEEDS["2 x"] == 2.0


def test_frames_of_a_server_are_counted(script: ModuleType, tmp_path: Path, easy_world: World):
    with Server(tmp_path).open() as page:
        options = page.until("hello")["options"]
        case = script.Case(32, "pilot", "frame", "fastest")
        found = script.intervals(page, case, options, 0.2)
    assert sum(found) >= 0.2 > sum(found[:-1]) and min(found) > 0


def test_the_page_has_the_committed_table(script: ModuleType):
    sections = importlib.import_module("page_sections")
    page = (ROOT / "docs" / "fly.md").read_text(encoding="utf-8")
    assert sections.replace_section(page, "rate", script.table()) == page
    rows = script.read_csv(script.TABLE, script.COLUMNS)
    assert [tuple(row[name] for name in script.COLUMNS[:4]) for row in rows] == [
        (str(case.size_px), case.flies, case.view, case.speed) for case in script.cases()
    ]
