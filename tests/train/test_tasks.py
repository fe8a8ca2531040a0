"""Tests of training and evaluation on tasks beside the paper's, whose privileged observations differ."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.env.handmade import ring
from thalweg.bench.evaluate.baselines import BASELINES
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.evaluation import Label, evaluate
from thalweg.bench.results.run_versions import current_versions
from thalweg.bench.suite.arms import Arm
from thalweg.bench.suite.config import Suite
from thalweg.core import versions
from thalweg.env import EnvConfig
from thalweg.env.rivers import river_list
from thalweg.env.task.priced.eye import features_of
from thalweg.train import load_policy
from thalweg.train.errors import ResumeWarning, TrainingError
from thalweg.train.observations import check_policy_fits, task_of
from thalweg.train.river import RiverTraining

SMALL = {"steps_per_update": 64, "minibatch": 32, "passes": 1, "hidden": [8], "critic_warmup_steps": 0}
SWIMMERS = EnvConfig(task="Swimmers")


@pytest.fixture(autouse=True)
def rings(monkeypatch: pytest.MonkeyPatch) -> None:
    """All rivers are rings made by hand."""
    monkeypatch.setattr(river_list, "load_or_plan", lambda *_: ring())


def train(folder: Path, config: EnvConfig = SWIMMERS, algorithm: str = "PPOLag", **settings: Any) -> Any:
    training = RiverTraining("Easy", 4, config=config)
    return training.train(algorithm, None, steps=384, seed=3, folder=folder, settings=SMALL | settings)


def test_a_policy_says_its_task_and_flies_no_other(tmp_path: Path):
    train(tmp_path)
    record = yaml.safe_load((tmp_path / "config.yaml").read_text())["run"]["context"]
    assert record["env"]["task"] == "Swimmers" and record["tasks_version"] == versions.TASKS
    policy = load_policy(tmp_path)
    assert task_of(policy) == "Swimmers" and policy.obs_size == len(features_of("Swimmers"))
    check_policy_fits(policy, None, task="Swimmers")
    with pytest.raises(TrainingError, match=r"takes 47 numbers, but the privileged observation has 37"):
        check_policy_fits(policy, None)
    assert task_of(BASELINES["pilot"]) == "River"
    rows = (tmp_path / "episodes.csv").read_text().splitlines()
    assert len(rows) > 4  # the deadline of a ring is 76 steps


def test_the_run_of_another_task_is_not_resumed(tmp_path: Path):
    train(tmp_path)
    with pytest.raises(TrainingError, match="env"):
        train(tmp_path, EnvConfig(task="Swimmers", hard=True))


def test_a_policy_of_another_version_of_the_tasks_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    train(tmp_path)
    monkeypatch.setattr(versions, "TASKS", versions.TASKS + 1)
    with pytest.raises(TrainingError, match="version 1 of the tasks, but this is version 2"):
        check_policy_fits(load_policy(tmp_path), None, task="Swimmers")


def test_a_run_from_before_deadlines_ended_learning_is_not_resumed(tmp_path: Path):
    train(tmp_path)
    config = yaml.safe_load((tmp_path / "config.yaml").read_text())
    assert config["made_with"].pop("deadlines") == versions.DEADLINES
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(config))
    with pytest.warns(ResumeWarning, match=f"made with deadlines unknown, not {versions.DEADLINES}; train it again"):
        assert train(tmp_path).already_finished
    status = json.loads((tmp_path / "status.json").read_text())
    (tmp_path / "status.json").write_text(json.dumps(status | {"state": "interrupted"}))
    with pytest.raises(TrainingError, match=r"made with deadlines unknown, .*: it cannot be resumed"):
        train(tmp_path)


def test_limits_of_tight_and_loose_costs_do_not_fit_three_kinds(tmp_path: Path):
    with pytest.raises(TrainingError, match="this task has also swimmers: set cost_limit, that of their sum"):
        train(tmp_path, cost_limits=[0.1, 0.1])


def test_asymmetric_critics_are_told_of_the_task(tmp_path: Path):
    env = RiverTraining("Easy", 2, config=EnvConfig(task="Portage", critic_info=True))._envs(
        None, "cpu", seen="none", critic_info=True
    )
    assert env.single_critic_space.shape == (3 + len(features_of("Portage")),)


def test_an_evaluated_episode_belongs_to_its_start_whichever_others_are_flown():
    rules = EnvConfig(observation="none", task="Swimmers")
    config = EvaluationConfig(3, env=rules)
    course = Course.on(ring(), config)
    rows = evaluate(BASELINES["random"], course, Label("random", 0, "Easy"), config)
    alone = evaluate(BASELINES["random"], course.only(2), Label("random", 0, "Easy"), config)
    assert rows[2] == alone[0] and sum(row.cost for row in rows) > 0
    hover = evaluate(BASELINES["hover"], course, Label("hover", 0, "Easy"), config)
    assert all(row.cost == 0.2 and row.reason == "Idle" for row in hover)  # a cost of its own it has not
    hard = replace(config, env=replace(rules, hard=True))
    ends = [row.reason for row in evaluate(BASELINES["random"], course, Label("random", 0, "Easy"), hard)]
    assert "CostIncurred" in ends


def test_suites_have_a_task_and_results_depend_on_the_version_of_tasks():
    suite = Suite("own", (Arm("PPO"),))
    assert "task" not in suite.as_data() and replace(suite, task="Nests").as_data()["task"] == "Nests"
    assert "tasks" not in current_versions("train", ["PPO"])
    assert current_versions("train", ["PPO"], task="Nests")["tasks"] == versions.TASKS
    with pytest.raises(ValueError, match="unknown task 'Lake'; known: River, "):
        Suite("own", (Arm("PPO"),), task="Lake")  # pyright: ignore[reportArgumentType]


def test_frames_of_evaluated_flights_hold_the_objects_of_the_task():
    seen = []
    config = EvaluationConfig(2, env=EnvConfig(observation="none", task="Nests"))
    course = Course.on(ring(), config)
    evaluate(BASELINES["hover"], course, Label("hover", 0, "Easy"), config, on_step=seen.append)
    assert seen[0].props.shape == (2, 24, 6) and np.unique(seen[0].props[..., 0]).tolist() in ([3.0], [0.0, 3.0])
