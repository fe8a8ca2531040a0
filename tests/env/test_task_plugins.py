"""Tests of tasks from outside the package: other numbers for the rules of one of the four."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import thalweg  # noqa: F401  (registers the ids)
from tests.plugins import NESTS, no_plugins  # noqa: F401  (a fixture)
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.results.run_versions import current_sources, current_versions
from thalweg.bench.suite.arms import Arm, Run
from thalweg.bench.suite.config import Suite
from thalweg.core.plugins.lookup import VARIABLE, add_files
from thalweg.core.plugins.record import PluginError
from thalweg.env import ConfigError, EnvConfig, RiverVectorEnv, TaskPlugin
from thalweg.env.task.priced.eye import features_of
from thalweg.env.tasks import TASKS, Task, rules_like, task_named, task_names
from thalweg.train.river import RiverTraining
from thalweg.world import World

pytestmark = pytest.mark.usefixtures("no_plugins")


@pytest.fixture
def nests(tmp_path: Path) -> Path:
    """The task of docs/extend.md, which is used."""
    (tmp_path / "nests.py").write_text(NESTS)
    add_files([tmp_path / "nests.py"])
    return tmp_path / "nests.py"


def test_the_task_of_the_docs_is_a_task_with_the_rules_of_nests(nests: Path):
    assert task_names() == [*TASKS, "HighNests"]
    assert task_named("HighNests") == replace(TASKS["Nests"], reserve_share=0.5, reserve_height_m=9.0)
    assert (rules_like("HighNests"), rules_like("Portage")) == ("Nests", "Portage")
    assert features_of("HighNests") == features_of("Nests")
    config = EnvConfig(task="HighNests", observation="privileged")
    assert (config.limits.task.reserve_height, config.cost_kinds) == (9.0, ("tight", "loose", "nests"))


def test_more_reserves_cost_more_in_the_same_flight(nests: Path, easy_world: World):
    costs = []
    for task in ("Nests", "HighNests"):
        env = RiverVectorEnv([easy_world], 8, EnvConfig(task=task, observation="privileged"))
        env.reset(seed=0)
        infos = [env.step(env.pilot_actions("scripted"))[4] for _ in range(60)]
        costs.append(sum(float(np.sum(info["costs"][:, 2])) for info in infos))
    assert 0 < costs[0] < costs[1]


def test_gymnasium_makes_it_by_name(nests: Path):
    env = gymnasium.make("thalweg/Easy-v0", task="HighNests", observation="privileged")
    env.reset(seed=0)
    assert env.unwrapped.cost_kinds == ("tight", "loose", "nests")  # pyright: ignore[reportAttributeAccessIssue]


def test_without_its_file_it_is_unknown(nests: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(VARIABLE, "")
    with pytest.raises(ConfigError, match=r"task must be one of 'River', .*'Portage', got 'HighNests'"):
        EnvConfig(task="HighNests")
    with pytest.raises(ResultsError, match="unknown task 'HighNests'; known: River"):
        Suite("mine", (Arm("PPO"),), task="HighNests")


def test_runs_and_suites_bear_its_version_and_source(nests: Path):
    source = current_sources(["HighNests"])["HighNests"]
    training = RiverTraining("Easy", 2, config=EnvConfig(task="HighNests"))
    assert training._context("privileged", None)["task_plugin"] == {"version": 1, "source": source}
    suite = Suite("mine", (Arm("PPO"),), task="HighNests", observation="privileged")
    assert current_sources(suite.plugins_of(Run("train", "PPO", 0))) == {"HighNests": source}
    made = current_versions("train", ["PPO"], task="HighNests")
    assert (made["HighNests"], made["props"]) == (1, current_versions("train", ["PPO"], task="Nests")["props"])


def test_a_whole_number_of_metres_is_the_same_task():
    whole, real = (replace(TASKS["Nests"], reserve_height_m=metres) for metres in (6, 6.0))
    assert TaskPlugin("Mine", whole, "a test", 1).task == real
    assert [type(number) for number in whole.rules(hard=False)] == [type(number) for number in real.rules(hard=False)]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"name": "Nests"}, "the task 'Nests' comes with the package"),
        ({"version": 0}, "the task Mine has the version 0"),
        ({"task": "Nests"}, "the task of Mine is 'Nests'; it must be a thalweg.env.tasks.Task"),
        ({"task": replace(TASKS["Nests"], kind="tight")}, "kind of Mine is 'tight'; name the cost of its steps"),
        ({"task": Task(kind="own")}, "Mine has the rules of no task"),
        *[
            (
                {"task": replace(TASKS[base], **{field: value})},
                f"{field} of Mine is {value!r}; it must be {needed}",
            )
            for base, field, value, needed in (
                ("RacingLine", "clearance_m", -2.5, "a finite number of 0 or more"),
                ("RacingLine", "fast_step_m", float("inf"), "a finite number of 0 or more"),
                ("Nests", "view_height_m", float("nan"), "a finite number of 0 or more"),
                ("Nests", "reserve_share", 1.5, "a finite number from 0 to 1"),
                ("Nests", "reserve_period_m", 0.0, "a finite number above 0"),
                ("Nests", "reserve_height_m", "8", "a finite number of 0 or more"),
                ("Nests", "reserve_height_m", True, "a finite number of 0 or more"),
                ("Swimmers", "deadline_steps_per_m", -0.6, "a finite number of 0 or more"),
                ("Swimmers", "props", 24.0, "a whole number of 0 or more"),
                ("Swimmers", "props", -1, "a whole number of 0 or more"),
                ("Portage", "portage", 1, "true or false"),
                ("Nests", "kind", 3, "a text"),
            )
        ],
        ({"task": replace(TASKS["Nests"], clearance_m=2.0)}, "Mine has the rules of no task"),
    ],
)
def test_what_cannot_be_a_task_is_refused(changes: dict[str, Any], words: str):
    given: dict[str, Any] = {"name": "Mine", "task": TASKS["Nests"], "about": "a test", "version": 1}
    assert TaskPlugin(**given).task == TASKS["Nests"]
    with pytest.raises(PluginError, match=re.escape(words)):
        TaskPlugin(**(given | changes))
