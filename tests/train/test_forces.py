"""Tests of training under wind, current and inertia: what its policies say, and where they may fly."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml

from tests.env.handmade import ring
from tests.env.winds import wind_of
from thalweg.algos.policy.actions import actions_of
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.evaluation import Label, evaluate
from thalweg.cli.evaluate import Evaluate
from thalweg.core import versions
from thalweg.env import EnvConfig
from thalweg.env.config import Dynamics
from thalweg.env.forces.options import ForceOptions
from thalweg.env.rivers import river_list
from thalweg.env.spaces import action_space
from thalweg.train import load_policy
from thalweg.train.errors import TrainingError
from thalweg.train.observations import check_policy_fits, forces_of
from thalweg.train.river import RiverTraining

SMALL = {"steps_per_update": 64, "minibatch": 32, "passes": 1, "hidden": [8], "critic_warmup_steps": 0}
WIND = ForceOptions(wind=wind_of(speed_m_per_s=(1.0, 3.0)), current_m_per_s=(0.1, 0.4))
INERTIA = ForceOptions(dynamics="inertial")


@pytest.fixture(autouse=True)
def rings(monkeypatch: pytest.MonkeyPatch) -> None:
    """All rivers are rings made by hand."""
    monkeypatch.setattr(river_list, "load_or_plan", lambda *_: ring())


def trained(folder: Path, forces: ForceOptions, steps: int = 128) -> Any:
    training = RiverTraining("Easy", 4, config=forces.applied(EnvConfig()))
    training.train("PPO", None, steps=steps, seed=3, folder=folder, settings=SMALL)
    return load_policy(folder)


def test_a_policy_says_under_which_forces_it_was_trained(tmp_path: Path):
    policy = trained(tmp_path, WIND)
    record = yaml.safe_load((tmp_path / "config.yaml").read_text())["run"]["context"]
    assert record["forces_version"] == versions.FORCES and record["env"]["wind"]["speed_m_per_s"] == [1.0, 3.0]
    assert forces_of(policy) == WIND
    with pytest.raises(TrainingError, match="env"):
        trained(tmp_path, ForceOptions(wind=WIND.wind))


def test_a_policy_of_still_air_says_nothing_of_them(tmp_path: Path):
    policy = trained(tmp_path, ForceOptions())
    record = yaml.safe_load((tmp_path / "config.yaml").read_text())["run"]["context"]
    assert "forces_version" not in record and "wind" not in record["env"] and forces_of(policy) == ForceOptions()


def test_a_policy_of_velocities_flies_with_inertia_only(tmp_path: Path):
    policy = trained(tmp_path, INERTIA)
    check_policy_fits(policy, None, action="continuous")
    with pytest.raises(TrainingError, match=r"takes four branches of 3 options, counted from 0, not a Box"):
        check_policy_fits(policy, None)
    config = EvaluationConfig(2, env=INERTIA.applied(EnvConfig(observation="none")))
    rows = evaluate(policy, Course.on(ring(), config), Label("PPO", 0, "Easy"), config)
    assert len(rows) == 2 and rows[0] != rows[1]


def test_a_policy_of_steps_is_refused_where_velocities_are_commanded(tmp_path: Path):
    with pytest.raises(TrainingError, match="the flight takes continuous actions, as inertial dynamics do"):
        check_policy_fits(trained(tmp_path, ForceOptions()), None, action="continuous")


@pytest.mark.parametrize(("trained_with", "flown_with"), [("inertial", "kinematic"), ("kinematic", "inertial")])
def test_continuous_steps_and_velocities_are_not_taken_for_one_another(trained_with: Dynamics, flown_with: str):
    rules = ForceOptions(dynamics=trained_with).applied(EnvConfig(action="continuous"))
    policy: Any = SimpleNamespace(
        about=SimpleNamespace(
            context={
                "observation": "privileged",
                "privileged_version": versions.PRIVILEGED,
                "forces_version": versions.FORCES,
                "env": rules.as_data(),
            }
        ),
        actions=actions_of(action_space("continuous"), "native", "gaussian"),
        obs_size=37,
        frame_stack=1,
    )
    check_policy_fits(policy, None, action="continuous", dynamics=trained_with)
    check_policy_fits(policy, None, action="continuous")  # to begin a training with, say
    with pytest.raises(TrainingError, match=f"with {trained_with} dynamics, but here it would fly with {flown_with}"):
        check_policy_fits(policy, None, action="continuous", dynamics=flown_with)


def test_a_policy_of_other_forces_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    policy = trained(tmp_path, WIND)
    monkeypatch.setattr(versions, "FORCES", versions.FORCES + 1)
    with pytest.raises(TrainingError, match="version 1 of the forces, but this is version 2"):
        check_policy_fits(policy, None)


def test_an_evaluation_is_under_the_forces_of_the_training_unless_others_are_given(tmp_path: Path):
    policy = trained(tmp_path, WIND)
    assert Evaluate("run").config_for(policy).env.wind == WIND.wind
    still = Evaluate("run", forces=type(Evaluate("run").forces)(wind=("none",), current=("none",)))
    assert still.config_for(policy).env.wind is None and still.config_for(policy).env.current_m_per_s is None


def test_only_policies_of_frames_name_the_version_of_what_stands_in_them():
    def context(task: Any, seen: str) -> dict[str, Any]:
        return RiverTraining("Easy", 2, config=EnvConfig(task=task))._context(seen, None)

    assert context("Swimmers", "rgb")["props_version"] == versions.PROPS
    assert "props_version" not in context("Swimmers", "privileged")
    assert "props_version" not in context("RacingLine", "rgb") and "props_version" not in context("River", "rgb")
