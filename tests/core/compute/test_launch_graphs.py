"""Tests of `LaunchGraphs` with a device that records by keeping the function."""

from collections.abc import Callable

import pytest

from thalweg.core.compute import launch_graphs
from thalweg.core.compute.launch_graphs import MOST_GRAPHS, LaunchGraphs


class Device:
    """Notes what runs; `recording` says whether the caller records a graph."""

    def __init__(self) -> None:
        self.done: list[str] = []
        self.recording = False

    def launches(self, name: str) -> Callable[[], None]:
        return lambda: self.done.append(f"launch {name}")

    def record(self, launches: Callable[[], None], device: str) -> Callable[[], None]:
        assert device == "card"
        launches()
        self.done[-1] = self.done[-1].replace("launch", "record")
        return lambda: self.done.append("replay")


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> Device:
    device = Device()
    monkeypatch.setattr(launch_graphs, "record_launches", device.record)
    monkeypatch.setattr(launch_graphs, "caller_records", lambda card: card == "card" and device.recording)
    return device


def test_launches_are_recorded_when_they_come_again_and_then_replayed(device: Device):
    graphs = LaunchGraphs("card")
    for _ in range(4):
        graphs.run("a", device.launches("a"))
    graphs.run("b", device.launches("b"))
    graphs.run("a", device.launches("a"))
    assert device.done == ["launch a", "record a", "replay", "replay", "launch b", "replay"]


def test_recordings_are_forgotten_when_memory_moves(device: Device):
    graphs = LaunchGraphs("card")
    for _ in range(2):
        graphs.run("a", device.launches("a"))
    graphs.clear()
    graphs.run("a", device.launches("a"))
    assert device.done == ["launch a", "record a", "launch a"]


def test_what_was_unused_for_longest_is_forgotten(device: Device):
    graphs = LaunchGraphs("card")
    for _ in range(2):
        graphs.run("a", device.launches("a"))
    for number in range(MOST_GRAPHS - 1):
        graphs.run(number, device.launches("n"))
    device.done.clear()
    graphs.run("a", device.launches("a"))  # used again, so that number 0 is the oldest
    graphs.run("new", device.launches("new"))
    graphs.run("a", device.launches("a"))
    graphs.run(0, device.launches("0"))
    assert device.done == ["replay", "launch new", "replay", "launch 0"]


def test_nothing_is_recorded_within_a_graph_of_the_caller(device: Device):
    graphs, device.recording = LaunchGraphs("card"), True
    for _ in range(3):
        graphs.run("a", device.launches("a"))
    assert device.done == ["launch a"] * 3
    device.recording = False
    graphs.run("a", device.launches("a"))
    assert device.done[-1] == "launch a"
