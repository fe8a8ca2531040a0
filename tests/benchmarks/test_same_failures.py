"""The benchmark of failures that students share: the mean of two, mirror images, the table, and resuming."""

import importlib
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from thalweg.bench.csv_files import csv_text


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "benchmarks")
    return importlib.import_module("same_failures")


class Player:
    """Gives the options of each of four branches the same chances, and notes what it sees and what was taken."""

    def __init__(self, *chances: tuple[float, float, float]) -> None:
        self.chances = np.array([chances])
        self.seen: Any = None
        self.taken: Any = None

    def __call__(self, images: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        self.seen = images
        return self.chances.argmax(-1)

    def log_probs(self) -> np.ndarray:
        return np.log(self.chances)

    def correct(self, options: np.ndarray) -> None:
        self.taken = options


LEFT, AHEAD, UNSURE = (0.9, 0.05, 0.05), (0.1, 0.8, 0.1), (0.5, 0.45, 0.05)
IMAGES = np.arange(24, dtype=np.uint8).reshape(1, 2, 3, 4)


def test_the_most_probable_options_on_average_are_taken_and_told_to_all(script: ModuleType):
    players = Player(UNSURE, LEFT, AHEAD, AHEAD), Player((0.6, 0.35, 0.05), AHEAD, LEFT, AHEAD)
    sure = Player((0.98, 0.01, 0.01), LEFT, LEFT, LEFT), Player((0.001, 0.899, 0.1), LEFT, LEFT, LEFT)
    taken = script.Mean([(player, False) for player in players])(IMAGES, np.array([True]))
    assert taken.tolist() == [[0, 0, 0, 1]]
    assert all(player.taken.tolist() == taken.tolist() and player.seen is IMAGES for player in players)
    # The mean is that of probabilities: by their logarithms, option 1 would be better by 0.899 · 0.01 to 0.98 · 0.001.
    assert script.Mean([(player, False) for player in sure])(IMAGES, np.array([True]))[0, 0] == 0


def test_what_is_done_in_a_mirror_counts_on_the_other_side(script: ModuleType):
    player = Player(LEFT, LEFT, LEFT, LEFT)
    taken = script.Mean([(player, True)])(IMAGES, np.array([True]))
    assert taken.tolist() == [[0, 2, 0, 2]]  # turns and steps aside have sides
    assert player.taken.tolist() == [[0, 0, 0, 0]]
    assert np.array_equal(player.seen, IMAGES[:, :, ::-1])


def test_a_student_that_does_the_same_in_a_mirror_takes_neither_side(script: ModuleType):
    players = Player(LEFT, UNSURE, LEFT, UNSURE), Player(LEFT, UNSURE, LEFT, UNSURE)
    taken = script.Mean([(players[0], False), (players[1], True)])(IMAGES, np.array([True]))
    assert taken.tolist() == [[0, 1, 0, 1]]  # 0.275, 0.45, 0.275


def failures(script: ModuleType, *names: str) -> list[dict[str, str]]:
    """Rows of policies on Hard, each flown, of which some violated limits."""
    key = dict.fromkeys(script.COLUMNS, "") | {"level": "Hard"}
    found = [("first", "7", 3), ("first", "8", 200), ("second", "7", 30), ("second", "9", 31)]
    rows = [key | {"policy": name, "world_seed": seed, "length": str(steps)} for name, seed, steps in found]
    return [row for row in rows if row["policy"] in names] + [key | {"policy": name} for name in names]


def test_the_table_counts_violations_early_ones_and_shared_ones(script: ModuleType):
    table = script.table(failures(script, "first", "second", "mean"))
    assert "| Hard | the first student | 2 | 1 | 2 |" in table
    assert "| Hard | the second | 2 | 1 | 1 |" in table
    assert "| Hard | the mean of both | 0 | 0 | 0 |" in table and "mirror" not in table
    assert "| Hard | the second | 2 | 1 |  |" in script.table(failures(script, "second"))


def test_the_page_shows_one_pair_of_todays_versions(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    page, out = tmp_path / "page.md", tmp_path / "failures.csv"
    page.write_text("<!-- same failures -->\n<!-- /same failures -->\n")
    monkeypatch.setattr(script, "PAGE", page)
    monkeypatch.setattr(script, "picture", lambda rows: None)
    today = {name: str(version) for name, version in script.VERSIONS.items()} | {"students": "a b", "episodes": "300"}
    rows = [row | today for row in failures(script, "first")]
    other = [row | {"students": "a c"} for row in rows]
    old = [row | {"students": "a c", "imitation": "1"} for row in rows]
    for written, shown in ((rows + old, "| Hard | the first student | 2 | 1 | 2 |"), (old, "Nothing was measured")):
        out.write_text(csv_text(script.COLUMNS, ([row[name] for name in script.COLUMNS] for row in written)))
        assert script.main(["--write", "--out", str(out)]) == 0 and shown in page.read_text()
    out.write_text(csv_text(script.COLUMNS, ([row[name] for name in script.COLUMNS] for row in rows + other)))
    with pytest.raises(SystemExit):
        script.main(["--write", "--out", str(out)])
    assert "several pairs of students or numbers of flights: a b, 300 flights; a c, 300" in capsys.readouterr().err


def test_the_picture_shows_starts_at_which_both_fail_soon(script: ModuleType, monkeypatch: pytest.MonkeyPatch):
    drawn: list[tuple[str, int, int]] = []

    def first_frame(level: str, seed: int, episodes: int) -> np.ndarray:
        drawn.append((level, seed, episodes))
        return np.full((4, 8, 3), seed, np.uint8)

    monkeypatch.setattr(script, "first_frame", first_frame)
    rows = [row | {"episodes": "300"} for row in failures(script, "first", "second")]
    assert script.picture([*rows, rows[-1] | {"level": "Easy"}]) is None
    shown = script.picture(rows)
    assert drawn == [("Hard", 7, 300)] and shown.shape == (4, 24, 3)
    assert (shown[:, :8] == 7).all() and not shown[:, 8:].any()


@pytest.mark.slow
def test_a_flight_begins_with_the_frame_of_its_start(script: ModuleType):
    shown = script.first_frame("Easy", script.UNSEEN + 1, 3)
    (course,) = script.Course.of_seeds("Easy", [script.UNSEEN + 1], script.EvaluationConfig(3))
    (frame,) = script.Renderer([course.world]).render(course.starts[1:2], time_s=course.clocks_s[1:2])
    assert np.array_equal(shown[:, :128], frame[..., :3])
    assert np.array_equal(shown[:, 128:, 0], frame[..., 3]) and frame[..., 3].any()


def student(seen: str, algorithm: str = "DAgger") -> Any:
    """What is looked at of a policy."""
    return SimpleNamespace(about=SimpleNamespace(algorithm=algorithm, context={"observation": seen}), actions=None)


def test_policies_are_made_of_students_that_see_the_same(script: ModuleType, monkeypatch: pytest.MonkeyPatch):
    files = {"a": student("rgb", script.ALGORITHM), "b": student("rgb", script.ALGORITHM)}
    files |= {"c": student("mask", script.ALGORITHM), "d": student("rgb", "PPO")}
    monkeypatch.setattr(script, "load_policy", files.__getitem__)
    assert script.policy_named("first", "ab") is files["a"] and script.policy_named("second", "ab") is files["b"]
    assert script.policy_named("mean", "ab").students == [(files["a"], False), (files["b"], False)]
    assert script.policy_named("mirror", "ab").students == [(files["a"], False), (files["a"], True)]
    for pair in ("ac", "ad", "dd"):
        with pytest.raises(script.ResultsError, match="both must be students"):
            script.policy_named("first", pair)


def test_what_was_flown_is_not_flown_again(script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    flown: list[tuple[str, str]] = []

    def fly(policy: str, courses: Any, label: Any, config: Any) -> list[Any]:
        flown.append((policy, label.level))
        episodes = [(1, 0.0, "Success", 9), (2, 0.2, "YawOverDeviation", 4), (3, 0.0, "Idle", 9)]
        return [SimpleNamespace(world_seed=a, cost=b, reason=c, length=d) for a, b, c, d in episodes]

    monkeypatch.setattr(script, "fly", fly)
    monkeypatch.setattr(script, "policy_named", lambda name, folders: name)
    files = [tmp_path / "a", tmp_path / "b"]
    for number, file in enumerate(files):
        file.write_text(str(number))
    out = tmp_path / "failures.csv"
    arguments = [*map(str, files), "--levels", "Hard", "--out", str(out)]
    assert script.main([*arguments, "--policies", "first"]) == 0
    assert script.main([*arguments, "--policies", "first", "mean"]) == 0
    assert flown == [("first", "Hard"), ("mean", "Hard")]
    rows = script.rows_of(out, script.COLUMNS)
    assert [(row["policy"], row["world_seed"], row["reason"]) for row in rows] == [
        ("first", "2", "YawOverDeviation"), ("first", "", ""), ("mean", "2", "YawOverDeviation"), ("mean", "", "")
    ]  # fmt: skip


@pytest.mark.parametrize(("arguments", "told"), [(["a"], "not 1, 300"), (["a", "b", "--episodes", "0"], "not 2, 0")])
def test_what_cannot_be_flown_is_refused(
    script: ModuleType, arguments: list[str], told: str, capsys: pytest.CaptureFixture[str]
):
    with pytest.raises(SystemExit):
        script.main(arguments)
    assert f"two students and at least one episode are needed, {told}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("students", "told"),
    [
        (["packaged", "packaged-rgb"], "both must be students"),
        (["packaged", "nowhere"], "there is no policy at nowhere"),
    ],
)
def test_students_that_cannot_be_compared_are_refused_by_name(
    script: ModuleType, students: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    with pytest.raises(SystemExit):
        script.main([*students, "--out", str(tmp_path / "failures.csv")])
    assert told in capsys.readouterr().err
