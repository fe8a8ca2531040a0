"""The benchmark of starts: its rows, its table, and flights of a policy that always turns the wrong way."""

import importlib
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from thalweg.world import World

MADE = {"policy": "abc", "world": "1", "render": "1", "rules": "1"}


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "benchmarks")
    monkeypatch.delitem(sys.modules, "starts", raising=False)
    return importlib.import_module("starts")


def test_every_start_counts_once_in_its_range(script: ModuleType):
    off, water = np.array([0.0, 19.9, 20.0, 79.0]), np.array(["ahead", "none", "behind", "none"])
    rows = script.rows_of("Easy", off, water, np.array([True, False, True, True]), MADE)
    found = {(row["off_from"], row["water"]): (row["starts"], row["failures"]) for row in rows if row["starts"] != "0"}
    assert found == {
        ("0", "ahead"): ("1", "1"),
        ("0", "none"): ("1", "0"),
        ("20", "behind"): ("1", "1"),
        ("70", "none"): ("1", "1"),
    }


def test_the_table_has_shares_of_each_range_and_of_all(script: ModuleType):
    off, water = np.array([10.0, 10.0, 75.0]), np.array(["ahead", "ahead", "none"])
    section = script.page_section(script.rows_of("Hard", off, water, np.array([True, False, True]), MADE))
    assert "| Hard | 0° to 20° | 50.0% of 2 |  |  |" in section
    assert "| Hard | 70° to 90° |  |  | 100.0% of 1 |" in section
    assert "| Hard | all | 50.0% of 2 |  | 100.0% of 1 |" in section


def test_the_page_shows_no_starts_of_another_policy(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    page, out, policy = tmp_path / "page.md", tmp_path / "starts.csv", tmp_path / "mine.safetensors"
    policy.write_bytes(b"one")
    page.write_text("<!-- starts -->\n<!-- /starts -->\n")
    monkeypatch.setattr(script, "PAGE", page)
    rows = script.rows_of("Hard", np.array([10.0]), np.array(["ahead"]), np.array([True]), script.made_with(policy))
    out.write_text(script.csv_text(script.COLUMNS, ([row[name] for name in script.COLUMNS] for row in rows)))
    monkeypatch.setattr(sys, "argv", ["starts.py", "--write", "--out", str(out), "--policy", str(policy)])
    for content, shown in ((b"one", "| Hard | all | 100.0% of 1 |"), (b"other", "Nothing was measured")):
        policy.write_bytes(content)
        script.main()
        assert shown in page.read_text() and page.read_text().startswith("<!-- starts -->\n")


@pytest.fixture(scope="module")
def straight() -> World:
    """A straight river towards the east, 12 m wide and 120 m long."""
    return World.from_centerline(np.array([[x, 0.0, 5.0, 12.0] for x in range(0, 121, 10)]), closed=False, plants=False)


@pytest.mark.parametrize(("travel", "expected"), [(1, ["ahead", "behind", "none"]), (-1, ["behind", "ahead", "none"])])
def test_water_in_view_lies_ahead_or_behind_along_the_course(
    script: ModuleType, straight: World, travel: int, expected: list[str]
):
    height = straight.river.level_m.mean() + 4.0
    yaws = np.radians([0.0, 180.0, 90.0])  # up the course, down it, and towards a bank
    pose = np.array([[60.0, 4.0, height, yaw] for yaw in yaws])
    found = script.WaterInView([straight]).of(np.zeros(3, np.int64), pose, np.full(3, travel))
    assert found.tolist() == expected


def test_points_are_seen_where_they_are(script: ModuleType, straight: World):
    height = straight.river.level_m.mean() + 3.0
    pose = np.array([[60.0, 0.0, height, np.radians(30.0)]])
    view = script.WaterInView([straight])
    seen = view.renderer.render_layers(pose, layers=("mask", "depth_m"))
    (x,), (y,) = view._ground(pose, seen.depth_m)
    water = seen.mask[0, :: script.EVERY, :: script.EVERY]
    row, column = np.argwhere(water)[-1] * script.EVERY
    camera = view.renderer.camera
    below = np.radians(camera.pitch_deg) + np.arctan((row + 0.5 - 64) * camera.pixel)
    aside = (column + 0.5 - 64) * camera.pixel * np.cos(below - np.radians(camera.pitch_deg))
    flat = 3.0 / np.tan(below)
    right = 3.0 / np.sin(below) * aside
    expected = 60.0 + flat * np.cos(np.radians(30)) + right * np.sin(np.radians(30))
    assert x[water][-1] == pytest.approx(expected, abs=0.3)
    assert y[water][-1] == pytest.approx(flat * np.sin(np.radians(30)) - right * np.cos(np.radians(30)), abs=0.3)


def test_distances_along_a_loop_take_the_shorter_way(script: ModuleType):
    angles = np.linspace(0.0, 2 * np.pi, 400, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=-1) * 100.0
    river = SimpleNamespace(position_m=circle, arc_m=angles * 100.0, length_m=2 * np.pi * 100.0, closed=True)
    found = script.ahead_m(river, np.array([100.0, 0.0]), np.array([[0.0, 100.0], [0.0, -100.0]]))
    assert found == pytest.approx([50.0 * np.pi, -50.0 * np.pi], rel=0.01)


class Turns:
    """A policy that turns left at every step; notes which flights it is told are new."""

    def __init__(self) -> None:
        self.fresh: list[np.ndarray] = []

    def player(self, count: int, deterministic: bool) -> "Turns":
        return self

    def __call__(self, frames: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        self.fresh.append(fresh.copy())
        return np.tile([1, 0, 1, 1], (len(frames), 1))


def test_a_policy_that_only_turns_fails_at_all_starts_within_half_a_turn(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch
):
    policy = Turns()
    monkeypatch.setattr(script, "load_policy", lambda path: policy)
    monkeypatch.setattr(script, "RIVERS", range(4000, 4001))
    monkeypatch.setattr(script, "TOGETHER", 4)
    off, water, failed = script.failures_at(Path("none"), "Easy", 6, 18)  # 10 degrees a step, at most 170 to go
    assert off.shape == water.shape == failed.shape == (6,)
    assert failed.all() and (off <= 80.1).all() and set(water) <= set(script.VIEWS)
    assert all(fresh.all() for fresh in policy.fresh[::18])
