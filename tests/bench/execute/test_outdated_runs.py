"""Runs with other versions: shown under names of their own until they have been run again, and mixed with nothing."""

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import pytest

from tests.bench.small_backend import ARMS, SUITE, SmallBackend
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.execute.runner import Outcome, run_suite, versions_of
from thalweg.bench.leaderboard import entries, leaderboard
from thalweg.bench.report.comparison_tables import limit_table, pairwise_table
from thalweg.bench.report.report import problems, write_report
from thalweg.bench.report.result_tables import paper_table
from thalweg.bench.results import outdated, reading, run_versions
from thalweg.bench.results.reading import read_results
from thalweg.bench.results.results import Results
from thalweg.bench.results.run_versions import current_versions, read_versions, some_critics_are_asymmetric
from thalweg.bench.suite.arms import Arm, Run
from thalweg.bench.suite.config import Suite
from thalweg.bench.suite.policy_files import PolicyFile
from thalweg.core import versions

pytestmark = pytest.mark.usefixtures("no_pictures")

TRAINED = ["PPO-0", "PPO-1", "FOCOPS-0", "FOCOPS-1"]


class Killed(Exception):
    """Stands for a process that is killed."""


class DiesAtOnce(SmallBackend):
    """Stands for a process that is killed while it trains or flies."""

    def train(self, *_: object, **__: object) -> NoReturn:
        raise KeyboardInterrupt

    def evaluate(self, *_: object, **__: object) -> NoReturn:
        raise KeyboardInterrupt


def killed_after(calls: int) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return a decorator; the functions that it decorates can be called so often, all together, then they kill."""
    count = iter(range(calls))

    def or_killed(operation: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            if next(count, None) is None:
                raise Killed
            return operation(*arguments, **options)

        return call

    return or_killed


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of the whole suite with the versions of today."""
    folder = tmp_path_factory.mktemp("finished")
    run_suite(SUITE, folder, SmallBackend())
    return folder


@pytest.fixture
def folder(finished: Path, tmp_path: Path) -> Path:
    """A copy of the finished results."""
    return Path(shutil.copytree(finished, tmp_path / "results"))


@pytest.fixture
def newer_frames(monkeypatch: pytest.MonkeyPatch) -> str:
    """Raises the version of frames; returns the label of what was made before."""
    label = f"render {versions.RENDER}"
    monkeypatch.setattr(versions, "RENDER", versions.RENDER + 1)
    return label


def calls(outcome_of: SmallBackend, kind: str) -> list[str]:
    return [call.removeprefix(f"{kind} ") for call in outcome_of.calls if call.startswith(f"{kind} ")]


def policies(results: Results) -> dict[str, int]:
    """Number of episodes of each policy."""
    names = [row.algorithm for row in results.episodes]
    return {name: names.count(name) for name in dict.fromkeys(names)}


def rerun(folder: Path, **options) -> tuple[Outcome, SmallBackend]:
    backend = SmallBackend()
    return run_suite(SUITE, folder, backend, **options), backend


def test_versions_are_recorded_for_each_run(finished: Path):
    made = read_versions(finished)
    assert set(made) == {"hover-0", *TRAINED}
    assert made["hover-0"] == {
        "world": versions.WORLD, "rules": versions.RULES, "evaluation": versions.EVALUATION
    }  # fmt: skip
    assert made["PPO-1"] == {
        "world": versions.WORLD, "rules": versions.RULES, "evaluation": versions.EVALUATION,
        "render": versions.RENDER, "encoder": versions.PACKAGED_ENCODER, "training": versions.TRAINING,
        "PPO": versions.ALGORITHMS["PPO"], "privileged": versions.PRIVILEGED,
    }  # fmt: skip
    assert "privileged" not in made["FOCOPS-1"]


def test_critics_that_see_more_by_a_setting_depend_on_the_ideal_eye(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    blind = replace(ARMS[0], name="blind", settings={"asymmetric_critics": False})
    told = replace(ARMS[1], name="told", settings={"asymmetric_critics": True})
    study = replace(ARMS[0], name="study", preset="paper")
    run_suite(replace(SUITE, arms=(blind, told, study)), tmp_path, SmallBackend())
    made = read_versions(tmp_path)
    assert [name for name, of in made.items() if "privileged" in of] == ["told-0", "told-1"]
    assert not read_results(tmp_path).outdated
    monkeypatch.setattr(versions, "PRIVILEGED", versions.PRIVILEGED + 1)
    assert set(read_results(tmp_path).outdated) == {f"told (privileged {versions.PRIVILEGED - 1})"}


@pytest.mark.parametrize(
    ("stages", "expected"),
    [
        ([("PPO", {}, "default")], True),
        ([("PPO", {}, "paper")], False),
        ([("FOCOPS", {"policy": "cnn"}, "default")], True),
        ([("PPO", {}, "default"), ("CUP", {}, "default")], True),
        ([("SafeLOOP", {}, "default")], False),
        ([("MyPPO", {}, "default")], False),
        ([("PPO", {}, "mine")], False),
        ([("PPO", {"mine": 1}, "default")], False),
    ],
)
def test_critics_are_asymmetric_in_some_stage_as_far_as_this_copy_knows_it(stages: list, expected: bool):
    assert some_critics_are_asymmetric(stages) is expected


@pytest.mark.parametrize(
    ("algorithm", "settings", "expected"),
    [
        ("PPO", {}, False),
        ("FOCOPS", {}, False),
        ("FOCOPS", {"policy": "cnn"}, True),
        ("TD3Lag", {"asymmetric_critics": True}, True),
        ("CCEPETS", {}, False),
    ],
)
def test_only_critics_of_costs_that_are_told_the_share_of_steps_depend_on_deadlines(
    algorithm: str, settings: dict, expected: bool
):
    arm = Arm(algorithm, settings=settings, observation="rgb" if "policy" in settings else None)
    suite = Suite("mine", (arm,))
    found = versions_of(suite, Run("train", suite.arms[0].label, 0))
    assert found.get("deadlines") == (versions.DEADLINES if expected else None)


def test_runs_that_see_no_frames_depend_on_neither_renderer_nor_encoder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    suite = replace(SUITE, arms=(replace(ARMS[0], observation="privileged"), ARMS[1]))
    run_suite(suite, tmp_path, SmallBackend())
    assert read_versions(tmp_path)["PPO-privileged-0"] == {
        "world": versions.WORLD, "rules": versions.RULES, "evaluation": versions.EVALUATION,
        "training": versions.TRAINING, "PPO": versions.ALGORITHMS["PPO"], "privileged": versions.PRIVILEGED,
    }  # fmt: skip
    label = f"render {versions.RENDER}"
    monkeypatch.setattr(versions, "RENDER", versions.RENDER + 1)
    assert set(read_results(tmp_path).outdated) == {f"FOCOPS ({label})"}
    backend = SmallBackend()
    run_suite(suite, tmp_path, backend)
    assert calls(backend, "train") == ["FOCOPS-0", "FOCOPS-1"]


def test_runs_through_the_encoder_of_geometry_depend_on_it_in_place_of_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    suite = replace(SUITE, arms=(replace(ARMS[0], encoder="geometry"), ARMS[1]))
    run_suite(suite, tmp_path, SmallBackend())
    made = read_versions(tmp_path)
    assert made["PPO-geometry-0"]["geometry"] == versions.PACKAGED_GEOMETRY and "encoder" not in made["PPO-geometry-0"]
    assert made["FOCOPS-0"]["encoder"] == versions.PACKAGED_ENCODER and "geometry" not in made["FOCOPS-0"]
    monkeypatch.setattr(versions, "PACKAGED_GEOMETRY", versions.PACKAGED_GEOMETRY + 1)
    assert set(read_results(tmp_path).outdated) == {f"PPO-geometry (geometry {versions.PACKAGED_GEOMETRY - 1})"}


def test_runs_that_see_images_depend_on_the_renderer_but_not_on_the_encoder():
    images, codes = (current_versions("train", ["FOCOPS"], observation=seen) for seen in ("rgb", "frames"))
    assert images | {"encoder": versions.PACKAGED_ENCODER} == codes
    assert images["render"] == versions.RENDER and "encoder" not in images


def test_the_pilot_that_students_are_taught_by_depends_on_a_version_of_its_own():
    pilot, steady = (current_versions("baseline", [name]) for name in ("pilot", "steady"))
    assert steady == pilot | {"steady": versions.STEADY}
    assert reading.versions_today({}, "steady", steady) == steady  # of a suite that does not name it


def test_outdated_runs_are_shown_under_names_of_their_own(folder: Path, newer_frames: str):
    results = read_results(folder)
    old = {name: f"{name} ({newer_frames})" for name in ("PPO", "FOCOPS")}
    assert policies(results) == {"hover": 9, old["PPO"]: 18, old["FOCOPS"]: 18}
    assert [row.run for row in results.runs][1:] == [f"{run} ({newer_frames})" for run in TRAINED]
    assert {log.algorithm for log in results.training} == set(old.values())
    assert results.policies == ["hover", *old.values()]
    assert set(results.outdated) == set(old.values())
    assert {f"Outdated: {name}; the suite runs it again" for name in old.values()} < set(problems(results))
    assert {"hover", *old.values()} <= set(paper_table(results).text["policy"])
    assert results.films["films/PPO-best"].words.endswith(f"Outdated: {newer_frames}.")
    assert results.films["film"].words.endswith(f"Outdated: {newer_frames}.")  # although hover's flights are current


def test_a_film_of_a_flight_that_the_results_lack_says_so(folder: Path):
    assert "among the results" not in read_results(folder).films["film"].words
    caption = folder / "film.txt"
    caption.write_text(caption.read_text().replace("return ", "return 1"))
    assert read_results(folder).films["film"].words.endswith(" This flight is no longer among the results.")


def test_a_run_that_begins_with_the_packaged_policy_depends_on_its_version():
    begun = Arm("PPO", settings={"policy": "cnn"}, observation="rgb+mask", begin_with=PolicyFile.of("packaged"))
    suite = Suite("mine", (begun, replace(begun, name="fresh", begin_with=None)), packaged=False)
    found = {name: versions_of(suite, Run("train", name, 0)) for name in (begun.label, "fresh")}
    assert found.pop(begun.label) == {**found.pop("fresh"), "packaged": versions.PACKAGED_POLICY}


def test_outdated_runs_of_one_version_can_be_read_as_recorded(folder: Path, newer_frames: str):
    recorded = read_results(folder, as_recorded=True)
    assert recorded.outdated == {} and not any("(" in name for name in recorded.policies)
    assert len(recorded.episodes) == len(read_results(folder).episodes) > 0
    versions = json.loads((folder / "versions.json").read_text())
    versions[next(iter(versions))]["world"] = 99
    (folder / "versions.json").write_text(json.dumps(versions))
    with pytest.raises(ResultsError, match=r"holds runs of several versions: .* has world"):
        read_results(folder, as_recorded=True)


def test_a_training_version_trains_again_and_replaces_the_old_results(folder: Path, newer_frames: str):
    outcome, backend = rerun(folder)
    assert calls(backend, "train") == TRAINED
    assert len(calls(backend, "evaluate")) == 3 * 4  # not the baseline, which sees no frames
    assert policies(outcome.results) == {"hover": 9, "PPO": 18, "FOCOPS": 18}
    assert outcome.results.outdated == {}
    assert not (folder / "outdated").exists()
    assert {made["render"] for run, made in read_versions(folder).items() if run in TRAINED} == {versions.RENDER}
    assert rerun(folder)[1].calls == []


def test_an_evaluation_version_only_flies_again(folder: Path, monkeypatch: pytest.MonkeyPatch):
    (folder / "runs" / "PPO-0" / "policy.safetensors").write_bytes(b"trained once")
    monkeypatch.setattr(versions, "EVALUATION", versions.EVALUATION + 1)
    outcome, backend = rerun(folder)
    assert calls(backend, "train") == []
    assert len(calls(backend, "evaluate")) == 3 * 5
    assert (folder / "runs" / "PPO-0" / "policy.safetensors").read_bytes() == b"trained once"
    assert (outcome.failed, outcome.results.outdated) == ([], {})


def test_an_algorithms_version_outdates_its_own_runs_only(folder: Path, monkeypatch: pytest.MonkeyPatch):
    before = versions.ALGORITHMS["FOCOPS"]
    monkeypatch.setitem(versions.ALGORITHMS, "FOCOPS", 99)
    assert list(read_results(folder).outdated) == [f"FOCOPS (FOCOPS {before})"]
    assert calls(rerun(folder)[1], "train") == ["FOCOPS-0", "FOCOPS-1"]


def test_old_results_stay_shown_until_the_new_ones_are_finished_and_are_mixed_with_nothing(
    folder: Path, newer_frames: str
):
    outcome, backend = rerun(folder, only=("PPO-0",))
    assert calls(backend, "train") == ["PPO-0"]
    old = {name: f"{name} ({newer_frames})" for name in ("PPO", "FOCOPS")}
    assert policies(outcome.results) == {"hover": 9, "PPO": 9, old["PPO"]: 9, old["FOCOPS"]: 18}
    assert outcome.results.planned_seeds("PPO") == 2
    table = paper_table(outcome.results).text
    assert {"PPO", *old.values()} <= set(table["policy"])
    assert pairwise_table(outcome.results).text.empty  # current and outdated results are not compared
    assert list(limit_table(outcome.results).text["policy"]) == ["PPO", *old.values()]
    lines = leaderboard([folder])
    assert "No policy that sees frames has a complete row yet." in lines
    found = {(entry.policy, entry.versions): entry for entry in entries(folder)}
    assert set(found) == {("PPO", "current"), ("PPO", newer_frames), ("FOCOPS", newer_frames)}
    assert found["PPO", newer_frames].missing == ("current versions",)
    rest, backend = rerun(folder)
    assert calls(backend, "train") == TRAINED[1:]
    assert rest.results.outdated == {}


def test_a_failed_rerun_leaves_the_old_results_shown(folder: Path, newer_frames: str):
    run_suite(SUITE, folder, SmallBackend(broken=("PPO-1",)))
    results = read_results(folder)
    assert policies(results) == {"hover": 9, "PPO": 9, f"PPO ({newer_frames})": 9, "FOCOPS": 18}
    assert rerun(folder)[0].results.outdated == {}


def test_a_training_whose_flights_were_set_aside_before_it_is_kept(folder: Path, monkeypatch: pytest.MonkeyPatch):
    """`bench` sets the flights alone aside and is killed before it flies again; then the training is outdated too."""
    (folder / "runs" / "PPO-0" / "policy.safetensors").write_bytes(b"trained once")
    for name in ("EVALUATION", "RENDER"):
        monkeypatch.setattr(versions, name, getattr(versions, name) + 1)
        with pytest.raises(KeyboardInterrupt):
            run_suite(SUITE, folder, DiesAtOnce(), only=("PPO-0",))
    assert (folder / "outdated" / "runs" / "PPO-0" / "policy.safetensors").read_bytes() == b"trained once"


OPERATIONS = 37
"""Writes, moves and removals of the bookkeeping of a suite whose runs are all outdated."""


@pytest.mark.parametrize("at", [*range(0, OPERATIONS, 3), OPERATIONS])
def test_killed_at_any_file_operation_nothing_is_lost_or_mixed(
    folder: Path, newer_frames: str, monkeypatch: pytest.MonkeyPatch, at: int
):
    """Each kill comes before a write, a move or a removal of the bookkeeping."""
    or_killed, killed = killed_after(at), False
    with monkeypatch.context() as patch:
        patch.setattr(outdated, "write_runs", or_killed(outdated.write_runs))
        patch.setattr(run_versions, "write_atomic", or_killed(run_versions.write_atomic))
        patch.setattr(os, "rename", or_killed(os.rename))
        patch.setattr(outdated.shutil, "rmtree", or_killed(shutil.rmtree))
        try:
            rerun(folder)
        except Killed:
            killed = True
            found = policies(read_results(folder))
            for name in ("PPO", "FOCOPS"):
                flown = found.get(name, 0) + found.get(f"{name} ({newer_frames})", 0)
                assert flown >= 18, found  # each seed with the old versions, the new ones or both
                assert found.get(f"{name} ({newer_frames})", 0) <= 18
    assert killed == (at < OPERATIONS)
    outcome, _ = rerun(folder)
    assert policies(outcome.results) == {"hover": 9, "PPO": 18, "FOCOPS": 18}
    assert not (folder / "outdated").exists()


@pytest.mark.parametrize("at", range(1, 10))
def test_killed_on_the_way_back_to_earlier_versions_no_training_is_lost(
    folder: Path, newer_frames: str, monkeypatch: pytest.MonkeyPatch, at: int
):
    """A run is set aside and not finished with the new versions; then the old ones come back, and a kill with them."""
    trained = {path.name: path.read_bytes() for path in (folder / "runs" / "PPO-0").iterdir() if path.is_file()}
    with pytest.raises(KeyboardInterrupt):
        run_suite(SUITE, folder, DiesAtOnce(), only=("PPO-0",))
    assert (folder / "outdated" / "runs" / "PPO-0").is_dir() and trained
    monkeypatch.setattr(versions, "RENDER", versions.RENDER - 1)
    or_killed = killed_after(at)
    with monkeypatch.context() as patch, pytest.raises(Killed):
        for module, name in ((outdated, "write_runs"), (os, "rename"), (os, "replace")):
            patch.setattr(module, name, or_killed(getattr(module, name)))
        run_suite(SUITE, folder, SmallBackend(), only=("PPO-0",))
    outcome, _ = rerun(folder)
    assert policies(outcome.results) == {"hover": 9, "PPO": 18, "FOCOPS": 18}
    kept = {path.name: path.read_bytes() for path in (folder / "runs" / "PPO-0").iterdir() if path.name in trained}
    assert kept == trained


def test_versions_that_change_again_during_the_rerun_keep_the_finished_results(
    folder: Path, newer_frames: str, monkeypatch: pytest.MonkeyPatch
):
    class Dies(SmallBackend):
        def evaluate(self, run, folder, trial, on_step):
            if trial.level == "Hard":
                raise KeyboardInterrupt
            return super().evaluate(run, folder, trial, on_step)

    with pytest.raises(KeyboardInterrupt):
        run_suite(SUITE, folder, Dies(), only=("PPO-0",))
    assert policies(read_results(folder))["PPO"] == 6
    with monkeypatch.context() as patch:
        patch.setattr(versions, "RENDER", versions.RENDER + 1)
        rerun(folder, only=("PPO-1",))
        with pytest.raises(KeyboardInterrupt):
            run_suite(SUITE, folder, Dies(), only=("PPO-0",))
        found = policies(read_results(folder))
        assert found[f"PPO ({newer_frames})"] == 9  # PPO-0's finished ones, not the interrupted ones after them
        assert found["PPO"] == 9 + 6


def test_back_at_the_old_versions_what_was_set_aside_is_current_again(folder: Path, monkeypatch: pytest.MonkeyPatch):
    with monkeypatch.context() as patch:
        patch.setattr(versions, "RENDER", versions.RENDER + 1)
        run_suite(SUITE, folder, SmallBackend(broken=("PPO-1", "FOCOPS-0", "FOCOPS-1")))
    outcome, backend = rerun(folder)
    assert calls(backend, "train") == ["PPO-0"]
    assert policies(outcome.results) == {"hover": 9, "PPO": 18, "FOCOPS": 18}
    assert not (folder / "outdated").exists()


def test_results_from_before_versions_were_recorded_are_outdated(folder: Path):
    (folder / "versions.json").unlink()
    report = write_report(folder)
    assert "Outdated: PPO (unknown versions); the suite runs it again" in report.problems
    assert calls(rerun(folder)[1], "train") == TRAINED


def test_versions_that_cannot_be_read_are_named(folder: Path):
    (folder / "versions.json").write_text('{"PPO-0": {"render": "new"}}')
    assert any(line.startswith("versions.json is not the versions of runs") for line in read_results(folder).skipped)
