"""Suites that train and fly on real rivers of files and on levels with other banks."""

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.bench.small_backend import SUITE, SmallBackend
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.conditions import Condition, Trial
from thalweg.bench.evaluate.rivers import RIVERS
from thalweg.bench.execute import backend
from thalweg.bench.execute.backend import RiverBackend
from thalweg.bench.execute.runner import run_suite, versions_of
from thalweg.bench.fronts.fronts import packaged_points
from thalweg.bench.report import failure_maps
from thalweg.bench.report.html.page import _introduction
from thalweg.bench.results.reading import read_results
from thalweg.bench.results.run_versions import read_versions
from thalweg.bench.suite.arms import Arm, Run, Stage
from thalweg.bench.suite.builtin import SUITES, load_suite
from thalweg.bench.suite.config import Suite
from thalweg.bench.suite.record import has_banks
from thalweg.cli.main import main
from thalweg.core import versions
from thalweg.train.river import RiverTraining
from thalweg.world import Reach, WorldError

pytestmark = pytest.mark.usefixtures("no_pictures")

LINE = '{"type": "LineString", "coordinates": [[9, 48], [9.0004, 48], [9.0008, 48], [9.0012, 48]]}'
PAGE = Path(__file__).resolve().parents[3] / "docs" / "bench.md"
TRAINED = Run("train", "PPO", 0)


@pytest.fixture
def brook(tmp_path: Path) -> Path:
    path = tmp_path / "brook.geojson"
    path.write_text(LINE)
    return path


def on_brook(path: Path, **changes: Any) -> Suite:
    """A suite that trains and flies on a brook 9 m wide."""
    files = {"brook": {"file": str(path), "width_m": 9.0}}
    given = {"train_level": "brook", "test_levels": ("brook",), "files": files}
    return replace(SUITE, **(given | changes))


def test_a_file_names_rivers_wherever_it_names_levels(tmp_path: Path, brook: Path):
    (tmp_path / "mine.yaml").write_text(f"""
arms:
  - {{algorithm: PPO, before: [{{algorithm: PPO, level: Easy, steps: 4096}}]}}
  - {{algorithm: CUP, level: Medium+quay_120-180}}
train_level: brook
test_levels: [brook, Cam, Medium+meadow]
files: {{brook: {{file: {brook}, width_m: 9, start_m: 5}}}}
conditions: [deterministic, {{name: fog, rivers: [brook], varied: [haze]}}]
packaged: false
""")
    suite = load_suite(str(tmp_path / "mine.yaml"))
    reach = Reach(brook, width_m=9, start_m=5)
    assert (suite.ground("brook"), suite.ground("Cam"), suite.ground("Easy")) == (reach, RIVERS["Cam"], "Easy")
    assert suite.grounds == ["brook", "Easy", "Medium+quay_120-180", "Cam", "Medium+meadow"]
    levels = ["brook", "Cam", "Medium+meadow"]
    named = [*levels, *(f"{level}, deterministic" for level in levels), "brook, fog"]
    assert [str(trial) for trial in suite.trials(TRAINED)] == named
    assert suite.conditions[1].river("brook") == reach
    data = suite.as_data()
    assert data["rivers"] == {"brook": reach.as_data(), "Cam": RIVERS["Cam"].as_data()} and "files" not in data


def test_the_file_in_the_docs_is_a_valid_suite(tmp_path: Path, brook: Path, monkeypatch: pytest.MonkeyPatch):
    blocks = re.findall(r"```yaml\n(.*?)```", PAGE.read_text(), flags=re.DOTALL)
    (shown,) = (text for text in blocks if "files:" in text)
    monkeypatch.chdir(tmp_path)
    brook.rename("isar.geojson")
    Path("mine.yaml").write_text(shown)
    suite = load_suite("mine.yaml")
    assert suite.ground(suite.train_level) == Reach(Path("isar.geojson"), start_m=700, length_m=300)
    assert [condition.name for condition in suite.conditions] == ["deterministic", "fog", "unseen"]


def test_stages_are_trained_on_rivers_and_banks_by_name(brook: Path, monkeypatch: pytest.MonkeyPatch):
    given: list[Any] = []
    monkeypatch.setattr(RiverTraining, "train", lambda ground, *_, **__: given.append((ground.river, ground.seeds)))
    monkeypatch.setattr(backend, "load_compatible_encoder", lambda _: None)
    before = (Stage("PPO", "Easy+meadow", 100), Stage("PPO", "Cam", 20_000))
    suite = on_brook(brook, arms=(Arm("PPO", steps=20_000, before=before, world_seeds=(3, 4)),))
    RiverBackend(suite).train(TRAINED, brook.parent / "run")
    reach = Reach(brook, width_m=9.0)
    assert given == [("Easy+meadow", (3, 4)), (RIVERS["Cam"], (3, 4)), (reach, (3, 4))]


def test_policies_are_flown_on_a_river_in_place_of_a_level(brook: Path):
    (course,) = RiverBackend(on_brook(brook)).courses(Trial("brook"))
    assert (course.world.name, course.world.river.width_m[0], len(course.starts)) == ("brook", 9.0, 3)


def test_results_name_the_river_and_a_changed_file_is_noticed(tmp_path: Path, brook: Path):
    suite, folder = on_brook(brook), tmp_path / "results"
    outcome = run_suite(suite, folder, SmallBackend())
    assert {row.level for row in outcome.results.episodes} == {"brook"}
    content = Reach(brook).as_data()["content"]
    words = _introduction(outcome.results)
    assert "steps on brook (2 seeds)" in words
    assert f"brook is the real river of brook.geojson (content {content}, width_m=9.0)." in words
    again = SmallBackend()
    run_suite(on_brook(brook), folder, again)
    assert again.calls == [], "the same file again"
    brook.write_text(LINE.replace("9.0012", "9.0013"))
    with pytest.raises(ResultsError, match=rf"brook\.geojson has changed since .*: its content was {content} and is"):
        run_suite(on_brook(brook), folder, again)
    brook.write_text(LINE)
    with pytest.raises(ResultsError, match=r"rivers\.brook\.width_m is 9.0 there and 8.0 here"):
        run_suite(on_brook(brook, files={"brook": {"file": str(brook), "width_m": 8.0}}), folder, again)
    assert again.calls == []


def test_a_changed_file_of_a_condition_is_named(tmp_path: Path, brook: Path):
    files = {"brook": {"file": str(brook), "width_m": 9.0}}
    suite = replace(SUITE, conditions=(Condition("mine", rivers=("brook",), files=files),))
    run_suite(suite, tmp_path / "results", SmallBackend())
    brook.write_text(LINE.replace("9.0012", "9.0013"))
    with pytest.raises(ResultsError, match=r"brook\.geojson has changed since the suite in"):
        run_suite(suite, tmp_path / "results", SmallBackend())


def test_an_interrupted_suite_on_a_river_resumes(tmp_path: Path, brook: Path):
    folder, first, rest = tmp_path / "results", SmallBackend(broken=("FOCOPS-0",)), SmallBackend()
    assert [row.run for row in run_suite(on_brook(brook), folder, first).failed] == ["FOCOPS-0"]
    run_suite(on_brook(brook), folder, rest)
    assert rest.calls[:2] == ["train FOCOPS-0", "evaluate FOCOPS-0 brook"]
    assert not any("PPO" in call and "train" in call for call in rest.calls)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"train_level": "brok"}, r"unknown level 'brok' \(did you mean 'brook'\?\); known: Easy, .*Cherwell, brook"),
        ({"arms": (Arm("PPO", level="Wera"),)}, r"unknown level 'Wera' \(did you mean 'Wear'\?\)"),
        ({"test_levels": ("Medium+medow",)}, r"banks: unknown kind 'medow' .did you mean 'meadow'"),
        ({"test_levels": ("Medium+Meadow",)}, r"level 'Medium\+Meadow' is called 'Medium\+meadow'"),
        ({"files": {"brook": {"file": "no.kml"}}}, r"river brook: no\.kml: there is no such file"),
        ({"files": {"Hard": {"file": "no.kml"}}}, "the name 'Hard' is that of another river"),
        (
            {"train_level": "Easy", "test_levels": ("Easy",)},
            "'brook' of files is neither trained on nor flown on: leave it out",
        ),
        ({"conditions": ({"name": "away", "unseen": True},)}, "condition away: brook is a real river, whose seeds"),
        ({"world_seeds": range(20)}, r"20 seeds of brook\.geojson for 16 environments: the seeds of a real river"),
        ({"test_levels": ("Cam", "brook", "cam")}, "unknown level 'cam'"),
    ],
)
def test_what_does_not_work_on_a_river_is_refused_before_anything_runs(
    tmp_path: Path, brook: Path, changes: dict[str, Any], message: str
):
    place = SmallBackend()
    with pytest.raises(ResultsError, match=message):
        run_suite(on_brook(brook, **changes), tmp_path / "new", place)
    assert place.calls == [] and not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("written", "changes", "message"),
    [
        ('{"type": "Point", "coordinates": [9, 48]}', {}, "no water way in it"),
        (LINE, {"test_levels": ("brook", "Easy+quay_900-950")}, r"quay_900-950 is not on the course, which is 2\d\d"),
        (
            LINE,
            {"files": {"brook": {"file": "brook.geojson", "width_m": 9.0, "start_m": 500.0}}},
            "the reach from 500 to 90 m is not on the line",
        ),
    ],
)
def test_rivers_that_cannot_be_built_are_refused_before_anything_runs(
    tmp_path: Path, brook: Path, written: str, changes: dict[str, Any], message: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    brook.write_text(written)
    place = SmallBackend()
    with pytest.raises(WorldError, match=message):
        run_suite(on_brook(brook, **changes), tmp_path / "new", place)
    assert place.calls == [] and not (tmp_path / "new").exists()


def test_a_file_that_is_edited_while_a_suite_runs_fails_the_runs_after_it(tmp_path: Path, brook: Path):
    class Edits(SmallBackend):
        def train(self, run: Run, folder: Path) -> None:
            super().train(run, folder)
            brook.write_text(LINE.replace("9.0012", "9.0013"))

    place = Edits()
    failed = run_suite(on_brook(brook), tmp_path / "results", place).failed
    assert [call for call in place.calls if call.startswith("train")] == ["train PPO-0"]
    assert [row.run for row in failed] == ["PPO-1", "FOCOPS-0", "FOCOPS-1"]
    assert "brook.geojson has changed since the suite in" in failed[0].error


def test_a_river_with_two_files_is_refused(brook: Path):
    other = Condition("mine", rivers=("brook",), files={"brook": {"file": str(brook), "width_m": 8.0}})
    with pytest.raises(ResultsError, match="river brook: condition mine has another file, or other options"):
        on_brook(brook, conditions=(other,))


def test_runs_on_other_banks_depend_on_their_version(tmp_path: Path, brook: Path, monkeypatch: pytest.MonkeyPatch):
    suite = replace(SUITE, train_level="Medium+meadow", test_levels=("Medium+meadow", "Easy"))
    run_suite(suite, tmp_path / "results", SmallBackend())
    assert {each["banks"] for each in read_versions(tmp_path / "results").values()} == {versions.BANKS}
    assert read_results(tmp_path / "results").outdated == {}, "the report derives the same versions from the record"
    monkeypatch.setattr(versions, "BANKS", versions.BANKS + 1)
    again = SmallBackend()
    run_suite(suite, tmp_path / "results", again)
    assert "train PPO-0" in again.calls
    meadow = on_brook(brook, files={"brook": {"file": str(brook), "width_m": 9.0, "banks": "meadow"}})
    files = {"quay": {"file": str(brook), "width_m": 9.0, "banks": "quay_10-30"}}
    alone = replace(SUITE, conditions=(Condition("mine", rivers=("quay",), files=files),))
    package = replace(SUITE, conditions=(Condition("real", rivers=("Cam",)),))
    assert package.as_data()["conditions"][0]["rivers"] == {"Cam": RIVERS["Cam"].as_data()}, "as before"
    for each, banks in ((meadow, True), (alone, True), (on_brook(brook), False), (package, False), (SUITE, False)):
        data = each.as_data()
        assert ("banks" in versions_of(each, TRAINED), has_banks(data)) == (banks, banks)


def test_the_report_shows_levels_on_other_banks_and_the_real_rivers_of_the_package(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(failure_maps, "load_or_build", lambda level, seed: (level.name, seed))
    monkeypatch.setattr(Reach, "build", lambda reach, seed: (reach.name, seed))
    flown = [
        SimpleNamespace(level=level, world_seed=1) for level in ("Medium+meadow", "Cam", "brook", "Medium+glacier")
    ]
    recorded = {"Cam": RIVERS["Cam"].as_data() | {"has_banks": True}, "brook": {}}
    results: Any = SimpleNamespace(episodes=flown, suite={"rivers": recorded})
    shown = [failure_maps._world(results, row.level) for row in flown]
    assert shown == [("Medium+meadow", 1), ("cam.geojson", 1), None, None]
    recorded["Cam"]["content"] = "another"
    assert failure_maps._world(results, "Cam") is None


def test_records_of_suites_without_rivers_are_as_before_there_were_some():
    for suite in SUITES.values():
        data = suite.as_data()
        assert not {"files", "rivers"} & data.keys() and not has_banks(data)


def test_a_level_with_other_banks_has_the_oracles_front_of_that_with_forest():
    points = packaged_points("Swimmers", "Medium+meadow")
    assert points == packaged_points("Swimmers", "Medium") and len(points) > 2


@pytest.mark.slow
def test_the_command_trains_and_flies_on_the_river_of_a_file(tmp_path: Path, brook: Path, capsys: Any):
    (tmp_path / "mine.yaml").write_text(f"""
arms: [{{algorithm: PPO, seeds: [0], steps: 256, settings: {{steps_per_update: 128}}}}]
train_level: brook
test_levels: [brook, Easy+meadow]
files: {{brook: {{file: {brook}, width_m: 9}}}}
observation: privileged
episodes: 2
num_envs: 2
baselines: [pilot]
packaged: false
film: false
""")
    command = ["bench", str(tmp_path / "mine.yaml"), "--out", str(tmp_path / "results"), "--jobs", "1"]
    assert main(command) == 0
    trained = (tmp_path / "results" / "runs" / "PPO-0" / "config.yaml").read_text()
    assert f"content: {Reach(brook).as_data()['content']}" in trained
    results = read_results(tmp_path / "results")
    assert {row.level for row in results.episodes} == {"brook", "Easy+meadow"}
    record = json.loads((tmp_path / "results" / "suite.json").read_text())
    assert record["rivers"]["brook"]["width_m"] == 9
    brook.write_text(LINE.replace("9.0012", "9.0013"))
    assert main(command) == 2
    assert "brook.geojson has changed since the suite" in capsys.readouterr().err
