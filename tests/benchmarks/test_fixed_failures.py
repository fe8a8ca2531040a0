"""The benchmark of failures on the fixed rivers: its table, its maps, resuming, and what is refused."""

import importlib
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from thalweg.world import World


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "benchmarks")
    return importlib.import_module("fixed_failures")


def rows_of(script: ModuleType) -> list[dict[str, str]]:
    """Rows of two students on Hard, and of one on Easy, who never failed."""
    today = dict.fromkeys(script.COLUMNS, "") | {name: str(version) for name, version in script.VERSIONS.items()}
    found = [("a", "7", "30", "0.0099"), ("a", "8", "31", "0.0100"), ("a", "9", "200", "0.5000")]
    found += [("b", "7", "2", "0.0099"), ("b", "5", "4", "0.0000")]
    failed = [
        today
        | dict.fromkeys(script.POINTS, "1.50")
        | {"student": name, "level": "Hard", "start": start, "length": length, "water": water, "reason": "Collision"}
        for name, start, length, water in found
    ]
    failed[2]["end_y"] = "1.49"
    flown = [("a", "Hard", "64"), ("b", "Hard", "64"), ("a", "Easy", "67")]
    return [*failed, *(today | {"student": name, "level": level, "dry_starts": dry} for name, level, dry in flown)]


def test_the_table_counts_violations_of_each_kind(script: ModuleType):
    table = script.table(rows_of(script))
    assert "| Hard | 64 | A | 3 | 1 | 1 | 2 | 1 |" in table
    assert "| Hard | 64 | B | 2 | 2 | 2 | 2 | 1 |" in table
    assert "| Easy | 67 | A | 0 | 0 | 0 | 0 | 0 |" in table and table.count("Easy") == 1 and "Medium" not in table


@pytest.mark.slow
def test_water_at_a_start_is_that_of_its_first_frame(script: ModuleType, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(script, "EPISODES", 3)
    water = script.water_at_starts("Easy")
    (course,) = script.cell_of("Easy").courses()
    frames = script.Renderer([course.world]).render(course.starts, time_s=course.clocks_s)
    assert water.tolist() == [(frame[..., 3] > 0).mean() for frame in frames] and water.max() > 0.05


def test_maps_show_early_failures_at_their_starts_and_later_ones_at_their_ends(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch, easy_world: World
):
    monkeypatch.setattr(script, "load_or_build", lambda level: easy_world)
    rows = rows_of(script)
    rows[0] |= {"x": "10.00", "y": "20.00"}
    rows[1] |= {"end_x": "30.00", "end_y": "40.00"}
    panels = dict(zip(script.LEVELS, script.maps(rows).axes, strict=True))
    assert [panel.get_title() for panel in panels.values()] == list(script.LEVELS)
    drawn = [np.asarray(points.get_offsets()).tolist() for points in panels["Hard"].collections]
    assert drawn == [[[10.0, 20.0]], [[30.0, 40.0], [1.5, 1.49]], [[1.5, 1.5], [1.5, 1.5]], []]
    assert not any(len(points.get_offsets()) for points in panels["Easy"].collections)


def student(seen: str = "rgb+mask", algorithm: str = "") -> Any:
    """What is looked at of a policy."""
    return SimpleNamespace(about=SimpleNamespace(algorithm=algorithm, context={"observation": seen}), actions=None)


@pytest.fixture
def flown(script: ModuleType, monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    """Kind of flights and level of those that were flown; the second of three ends in a violation."""
    found: list[tuple[str, str]] = []

    def fly(cell: Any, policy: Any) -> list[Any]:
        found.append((cell.kind, cell.level))
        ended = [(0.0, "Success", 9), (0.2, "Collision", 4), (0.0, "Idle", 9)]
        points = dict.fromkeys(script.POINTS, 1.234)
        return [
            SimpleNamespace(episode=number, cost=cost, reason=reason, length=length, **points)
            for number, (cost, reason, length) in enumerate(ended)
        ]

    monkeypatch.setattr(script.Cell, "fly", fly)
    monkeypatch.setattr(script, "water_at_starts", lambda level: np.array([0.0, 0.25, 0.5]))
    monkeypatch.setattr(script, "load_policy", lambda path: student(algorithm=script.ALGORITHM))
    return found


def test_what_was_flown_is_not_flown_again(script: ModuleType, tmp_path: Path, flown: list[tuple[str, str]]):
    first, second, out = tmp_path / "a", tmp_path / "b", tmp_path / "failures.csv"
    first.write_text("a")
    second.write_text("b")
    assert script.main([str(first), "--levels", "Hard", "--out", str(out)]) == 0
    assert script.main([str(first), str(second), "--levels", "Hard", "Easy", "--out", str(out)]) == 0
    assert flown == [("fixed", "Hard"), ("fixed", "Hard"), ("fixed", "Easy"), ("fixed", "Easy")]
    rows = script.read_csv(out, script.COLUMNS)
    told = [tuple(row[name] for name in ("level", "start", "end_x", "length", "water", "dry_starts")) for row in rows]
    assert told == [
        row
        for level in ("Hard", "Hard", "Easy", "Easy")
        for row in ((level, "1", "1.23", "4", "0.2500", ""), (level, "", "", "", "", "1"))
    ]
    assert len(script.students_of(rows)) == 2


def test_only_students_of_image_and_mask_are_flown(
    script: ModuleType, tmp_path: Path, flown: list[tuple[str, str]], monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "a").write_text("a")
    arguments = [str(tmp_path / "a"), "--out", str(tmp_path / "failures.csv")]
    for other in (student("rgb", script.ALGORITHM), student(algorithm="PPO")):
        monkeypatch.setattr(script, "load_policy", lambda path, other=other: other)
        with pytest.raises(script.ResultsError, match="must be a student"):
            script.main(arguments)
    assert not flown and not (tmp_path / "failures.csv").exists()


@pytest.mark.parametrize("number", [0, 4])
def test_a_number_of_students_that_the_maps_have_no_colours_for_is_refused(
    script: ModuleType, number: int, capsys: pytest.CaptureFixture[str]
):
    with pytest.raises(SystemExit):
        script.main(["packaged"] * number)
    assert f"between one and 3 students are needed, not {number}" in capsys.readouterr().err


def test_a_page_of_too_many_students_is_refused(
    script: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    out = tmp_path / "failures.csv"
    monkeypatch.setattr(script, "PAGE", tmp_path / "page.md")
    rows = [rows_of(script)[-1] | {"student": name} for name in "abcd"]
    script.put(out, script.COLUMNS, rows, ("student",))
    with pytest.raises(SystemExit):
        script.main(["--write", "--out", str(out)])
    assert "holds 4 students, but the page has room for 3" in capsys.readouterr().err


def test_the_page_shows_the_committed_table(script: ModuleType):
    page = script.PAGE.read_text(encoding="utf-8")
    rows = script.of_versions(script.read_csv(script.TABLE, script.COLUMNS), script.VERSIONS)
    assert rows and script.replace_section(page, script.SECTION, script.table(rows)) == page
