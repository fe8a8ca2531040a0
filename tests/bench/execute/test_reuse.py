"""Trainings that a suite takes from other results: the same ones alone, and nothing else."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tests.bench.small_backend import SUITE, SmallBackend
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.execute.backend import RiverBackend
from thalweg.bench.execute.executors import is_evaluated
from thalweg.bench.execute.runner import run_suite
from thalweg.bench.results.results import read_runs
from thalweg.bench.results.run_versions import read_versions, write_versions
from thalweg.bench.suite.arms import Arm, Run, Stage
from thalweg.bench.suite.builtin import SUITES
from thalweg.bench.suite.config import Suite
from thalweg.cli.main import main
from thalweg.train.errors import TrainingError

pytestmark = pytest.mark.usefixtures("no_pictures")

OTHER = replace(SUITE, name="other", arms=(SUITE.arms[0], replace(SUITE.arms[1], name="FOCOPS-other")))
"""Another suite, with the arm PPO of the small one."""


class FinishingBackend(SmallBackend):
    """Leaves the status of a finished training."""

    def train(self, run: Run, folder: Path) -> None:
        super().train(run, folder)
        numbers = dict.fromkeys(("episodes", "return_mean", "cost_mean", "cost_rate"), 1.0)
        status = {"state": "finished", "algorithm": run.algorithm, "warnings": {}, "steps": 100, "seconds": 5.0}
        (folder / "status.json").write_text(json.dumps(status | numbers))


class CheckingBackend(SmallBackend):
    """Checks a copy as the rivers do: it refuses one, and does not train what is finished."""

    def train(self, run: Run, folder: Path) -> None:
        if (folder / "status.json").exists():
            if run.name == "PPO-1":
                raise TrainingError(f"{folder} is of another run: steps 9, not 100")
            self._call(f"check {run.name}")
        else:
            super().train(run, folder)


@pytest.fixture
def first(tmp_path: Path) -> Path:
    folder = tmp_path / "first"
    run_suite(SUITE, folder, FinishingBackend())
    for name in ("PPO-0", "PPO-1"):
        (folder / "runs" / name / "checkpoints").mkdir()
    return folder


def test_a_training_is_also_taken_after_an_attempt_that_failed_before_it_began(first: Path, tmp_path: Path):
    folder = tmp_path / "other"
    run_suite(OTHER, folder, CheckingBackend(broken=("PPO-0", "PPO-1")), only=("hover",))
    (folder / "runs" / "PPO-0").mkdir(parents=True)
    (folder / "runs" / "PPO-0" / "error.txt").write_text("no encoder")
    (folder / "runs" / "PPO-1").mkdir()
    (folder / "runs" / "PPO-1" / "config.yaml").write_text("")  # of a training that has begun
    place = CheckingBackend()
    run_suite(OTHER, folder, place, reuse=first)
    assert "check PPO-0" in place.calls and "train PPO-1" in place.calls
    assert not (folder / "runs" / "PPO-0" / "error.txt").exists()


def test_a_training_that_is_the_same_is_copied_and_flown(first: Path, tmp_path: Path, capsys: pytest.CaptureFixture):
    place, folder = CheckingBackend(), tmp_path / "other"
    run_suite(OTHER, folder, place, reuse=first)
    trained = [call for call in place.calls if call.startswith(("train", "check"))]
    assert trained == ["check PPO-0", "train PPO-1", "train FOCOPS-other-0", "train FOCOPS-other-1"]
    told = " ".join(capsys.readouterr().out.split())
    assert f"PPO-0: trained in {first}" in told and "PPO-1: not taken" in told and "steps 9, not 100" in told
    copied = {path.name for path in (folder / "runs" / "PPO-0").iterdir()}
    assert copied == {path.name for path in (first / "runs" / "PPO-0").iterdir()} - {"checkpoints"}
    assert [path.name for path in (folder / "runs").iterdir() if path.name.startswith(".")] == []
    (row,) = [row for row in read_runs(folder) if row.run == "PPO-0"]
    assert (row.status, row.steps, row.wall_s) == ("finished", 100, 5.0)
    assert all(is_evaluated(folder, Run("train", "PPO", 0), trial, 3) for trial in OTHER.trials(Run("train", "PPO", 0)))
    assert read_versions(folder)["PPO-0"] == read_versions(first)["PPO-0"]
    again = CheckingBackend()
    run_suite(OTHER, folder, again, reuse=first)
    assert again.calls == []


def test_a_training_of_other_versions_or_unfinished_is_not_copied(first: Path, tmp_path: Path):
    made = dict(read_versions(first))
    write_versions(first, made | {"PPO-0": {**made["PPO-0"], "world": 1}})
    (first / "runs" / "PPO-1" / "policy.safetensors").unlink()
    place = CheckingBackend()
    run_suite(OTHER, tmp_path / "other", place, reuse=first, only=("PPO",))
    assert [call for call in place.calls if call.startswith(("train", "check"))] == ["train PPO-0", "train PPO-1"]


def test_an_outdated_training_makes_room_for_one_of_today(first: Path, tmp_path: Path):
    folder = tmp_path / "other"
    run_suite(OTHER, folder, FinishingBackend(), only=("PPO-0",))
    made = dict(read_versions(folder))
    write_versions(folder, made | {"PPO-0": {**made["PPO-0"], "world": 1}})
    place = CheckingBackend()
    run_suite(OTHER, folder, place, reuse=first, only=("PPO-0",))
    assert [call for call in place.calls if call.startswith(("train", "check"))] == ["check PPO-0"]
    assert read_versions(folder)["PPO-0"] == read_versions(first)["PPO-0"]


def test_a_training_whose_earlier_stage_is_missing_is_not_copied(first: Path, tmp_path: Path):
    staged = replace(SUITE.arms[0], before=(Stage("PPO", "Easy", 100),), settings={"critic_warmup_steps": 0})
    place = CheckingBackend()
    run_suite(replace(OTHER, arms=(staged,)), tmp_path / "other", place, reuse=first, only=("PPO-0",))
    assert place.calls[0] == "train PPO-0"


def test_a_folder_without_results_is_refused_before_anything_is_claimed(tmp_path: Path):
    with pytest.raises(ResultsError, match="empty holds no results of another suite"):
        run_suite(OTHER, tmp_path / "other", SmallBackend(), reuse=tmp_path / "empty")
    assert not (tmp_path / "other").exists()


def test_nothing_is_taken_where_results_are_only_verified(tmp_path: Path, capsys: pytest.CaptureFixture):
    assert main(["bench", "quick", "--only", "PPO-0", "--verify", str(tmp_path), "--reuse", str(tmp_path)]) == 2
    assert "--reuse does not go with it" in " ".join(capsys.readouterr().err.split())


def test_the_complete_study_has_six_trainings_twice():
    """Those that docs/bench.md tells to take from the suite paper."""
    paper, shared = SUITES["paper"], list[str]()
    for suite in (SUITES["open"], SUITES["protocols"]):
        for arm in suite.arms:
            same = [each for each in paper.arms if each == arm and suite.level_of(arm) == paper.level_of(each)]
            shared += [f"{each.label}-{seed}" for each in same for seed in each.seeds]
        assert (suite.num_envs, suite.world_seeds, suite.encoder) == (paper.num_envs, (), paper.encoder)
        assert suite.training_rules == paper.training_rules
    assert shared == ["FOCOPS-0", "FOCOPS-1", "FOCOPS-2"] * 2


@pytest.mark.slow
def test_rivers_are_trained_on_once_and_other_settings_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture):
    """Settings are compared by the run's own config.yaml."""
    arm = Arm("PPO", seeds=(0,), steps=256, settings={"steps_per_update": 64})
    one = Suite(
        "one", (arm,), train_level="Easy", test_levels=("Easy",), episodes=1, num_envs=2, baselines=(), packaged=False,
        observation="privileged", film="none",
    )  # fmt: skip
    run_suite(one, tmp_path / "one", RiverBackend(one))
    same, other = replace(one, name="two", episodes=2), replace(one, arms=(replace(arm, steps=512),))
    for name, suite in (("same", same), ("other", other)):
        run_suite(suite, tmp_path / name, RiverBackend(suite), reuse=tmp_path / "one")
    told = " ".join(capsys.readouterr().out.split())
    assert told.count("PPO-0: trained in") == 1 and told.count("PPO-0: not taken from") == 1
    policies = {
        name: (tmp_path / name / "runs" / "PPO-0" / "policy.safetensors").read_bytes()
        for name in ("one", "same", "other")
    }
    assert policies["same"] == policies["one"] != policies["other"]
    assert [row.steps for row in read_runs(tmp_path / "other")] == [512]


def test_results_are_not_taken_from_the_folder_itself(tmp_path: Path):
    run_suite(SUITE, tmp_path, SmallBackend())
    with pytest.raises(ResultsError, match="holds no results of another suite"):
        run_suite(SUITE, tmp_path, SmallBackend(), reuse=tmp_path)
