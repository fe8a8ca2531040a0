"""Tests of runs whose critics see more than the policy: what they are given, what is recorded, and that they resume."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml

from tests.env.handmade import ring
from tests.train.small_runs import Stop, numbers
from tests.train.test_trainer import Scribe
from tests.train.toys import ToldWalk, Walk
from thalweg.algos import ALGORITHMS, AlgorithmError, Entry
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.onpolicy.config import OnPolicyConfig
from thalweg.core import versions
from thalweg.core.config import frozen_config
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.rivers import river_list
from thalweg.train import TrainingError, river, run
from thalweg.train.folder.run_record import made_with
from thalweg.train.river import RiverTraining
from thalweg.train.run_in_folder import open_folder


@frozen_config(AlgorithmError)
class AsymmetricConfig(OnPolicyConfig):
    """Settings of a learner that only writes down what it is given."""

    asymmetric_critics: bool = False


class Reader(Scribe):
    """Reports sums of what its critics see."""

    made: list["Reader"] = []  # noqa: RUF012

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self.task = task
        self.made.append(self)

    def act(self, obs: torch.Tensor, fresh: torch.Tensor) -> torch.Tensor:
        return torch.tensor([2, 0, 0, 1])[: self.policy.actions.count].repeat(len(obs), 1)

    def update(self, rollout: Rollout, feedback: Feedback) -> dict[str, float]:
        super().update(rollout, feedback)
        if rollout.critic_obs is None or rollout.final_critic_obs is None:
            return {"critics": 0.0}
        return {"critics": float(rollout.critic_obs.double().sum() + 1e3 * rollout.final_critic_obs.double().sum())}


@pytest.fixture(autouse=True)
def reader(monkeypatch: pytest.MonkeyPatch) -> list[Reader]:
    entry = Entry("READER", AsymmetricConfig, lambda config, task: Reader(task), "writes down what it is given")
    monkeypatch.setitem(ALGORITHMS, "READER", entry)
    monkeypatch.setattr(Reader, "made", [])
    monkeypatch.setattr(river_list, "load_or_plan", lambda *_: ring())
    return Reader.made


def read(folder: Path, env: Any = None, asymmetric: bool = True, **given: Any) -> Any:
    settings: dict[str, Any] = {"steps": 200, "seed": 1, "checkpoint_seconds": 0.0} | given
    config = {"asymmetric_critics": asymmetric}
    return run("reader", env or ToldWalk(), folder=folder, config=config, **settings)


def recorded(folder: Path) -> dict[str, Any]:
    return yaml.safe_load((folder / "config.yaml").read_text())["run"]


@pytest.mark.parametrize(("asymmetric", "kind", "size"), [(True, ToldWalk, 2), (False, ToldWalk, 0), (True, Walk, 0)])
def test_critics_are_told_what_the_environment_tells_if_the_setting_is_on(
    tmp_path: Path, reader: list[Reader], asymmetric: bool, kind: type[Walk], size: int
):
    read(tmp_path, kind(), asymmetric)
    assert reader[0].task.critic_size == size
    assert recorded(tmp_path).get("critic_size", 0) == size and ("critic_size" in recorded(tmp_path)) == (size > 0)
    for seen in reader[0].seen:
        assert ("critic_obs" in seen) == ("final_critic_obs" in seen) == (size > 0)
        if size:
            for obs, told in (("obs", "critic_obs"), ("final_obs", "final_critic_obs")):
                expected = torch.stack([seen[obs][..., 0] ** 2, 1 - seen[obs][..., 2]], -1)
                torch.testing.assert_close(seen[told], expected, rtol=1e-6, atol=0.0)


def test_a_folder_of_critics_that_saw_less_is_that_of_another_run(tmp_path: Path):
    read(tmp_path, Walk())
    with pytest.raises(TrainingError, match="critic_size is absent there and 2 here"):
        read(tmp_path, ToldWalk())


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("limited", [True, False])
def test_a_run_with_critics_of_costs_that_are_told_more_says_where_its_costs_end(told: bool, limited: bool):
    identity: dict[str, Any] = {"config": {"cost_limit": 0.1} if limited else {}}
    identity |= {"critic_size": 2} if told else {}
    ends = {"deadlines": versions.DEADLINES} if told and limited else {}
    assert made_with(identity, {"PPO": 1}) == {"PPO": 1, "training": versions.TRAINING} | ends


@pytest.mark.parametrize(
    ("identity", "names"),
    [
        ({"critic_size": 40}, {"privileged"}),
        ({}, set()),
        ({"config": {"auxiliary_weight": 0.5}}, {"privileged"}),
        ({"config": {"auxiliary_weight": 0.0}}, set()),
        ({"context": {"env": {"vehicle": "asv"}}}, {"vehicles"}),
    ],
)
def test_a_run_on_a_river_says_what_it_is_told_and_what_flies(identity: dict[str, Any], names: set[str]):
    made = made_with({"context": {"env": {"vehicle": "uav"}}} | identity, {"PPO": 1})
    assert made.keys() - {"PPO", "training", "rules", "world"} == names
    assert {name: made[name] for name in names} == {
        name: {"privileged": versions.PRIVILEGED, "vehicles": versions.VEHICLES}[name] for name in names
    }


def test_a_run_of_another_ideal_eye_is_not_resumed_and_one_that_did_not_record_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder = tmp_path / "run"
    identity: dict[str, Any] = {"algorithm": "PPO", "context": {"env": {"vehicle": "asv"}}, "critic_size": 40}
    open_folder(folder, identity, 1, {"PPO": 1})
    now = versions.PRIVILEGED
    monkeypatch.setattr(versions, "PRIVILEGED", now + 1)
    with pytest.raises(TrainingError, match=f"made with privileged {now}, not {now + 1}: it cannot be resumed"):
        open_folder(folder, identity, 1, {"PPO": 1})
    config = yaml.safe_load((folder / "config.yaml").read_text())
    del config["made_with"]["privileged"], config["made_with"]["vehicles"]
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    open_folder(folder, identity, 1, {"PPO": 1})
    del config["made_with"]["training"]
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    with pytest.raises(TrainingError, match="made with training unknown"):
        open_folder(folder, identity, 1, {"PPO": 1})


class StopsAt(ToldWalk):
    def step(self, actions: Any):
        if self.total == 37:
            raise Stop
        return super().step(actions)


def test_an_interrupted_run_resumes_with_what_critics_saw(tmp_path: Path):
    read(tmp_path / "whole")
    with pytest.raises(Stop):
        read(tmp_path / "broken", StopsAt())
    assert read(tmp_path / "broken").resumed_from == 140
    assert numbers(tmp_path / "broken") == numbers(tmp_path / "whole")


def on_rivers(folder: Path, asymmetric: bool) -> None:
    settings = {"asymmetric_critics": asymmetric}
    RiverTraining("Easy", 4).train("reader", None, steps=120, seed=3, folder=folder, settings=settings)


@pytest.mark.parametrize("asymmetric", [True, False])
def test_rivers_tell_critics_exactly_if_the_setting_is_on_and_the_task_is_the_same(
    tmp_path: Path, reader: list[Reader], asymmetric: bool
):
    on_rivers(tmp_path, asymmetric)
    assert reader[0].task.critic_size == (3 if asymmetric else 0)
    assert recorded(tmp_path)["context"]["env"] == EnvConfig(observation="privileged").as_data()
    assert all(("critic_obs" in seen) == asymmetric for seen in reader[0].seen)


@pytest.mark.parametrize("asymmetric", [True, False])
def test_what_a_config_says_of_critics_is_replaced_by_the_setting(asymmetric: bool):
    training = RiverTraining("Easy", 2, config=EnvConfig(critic_info=not asymmetric))
    env = training._envs(None, "cpu", critic_info=asymmetric)
    _, info = env.reset(seed=0)
    assert ("critic_obs" in info) == hasattr(env, "single_critic_space") == asymmetric


def test_episodes_on_rivers_do_not_depend_on_what_critics_are_told(tmp_path: Path):
    for asymmetric in (True, False):
        on_rivers(tmp_path / str(asymmetric), asymmetric)
    one, other = ((tmp_path / name / "episodes.csv").read_text() for name in ("True", "False"))
    assert one == other and len(one.splitlines()) > 2


def test_an_interrupted_run_on_rivers_resumes_with_what_critics_saw(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    class Breaks(RiverVectorEnv):
        steps = 0

        def step(self, actions: Any) -> Any:
            self.steps += 1
            if self.steps == 17:
                raise Stop
            return super().step(actions)

    monkeypatch.setattr(river, "run", partial(run, checkpoint_seconds=0.0))
    on_rivers(tmp_path / "whole", True)
    monkeypatch.setattr(river, "RiverVectorEnv", Breaks)
    with pytest.raises(Stop):
        on_rivers(tmp_path / "broken", True)
    monkeypatch.setattr(river, "RiverVectorEnv", RiverVectorEnv)
    on_rivers(tmp_path / "broken", True)
    assert numbers(tmp_path / "broken") == numbers(tmp_path / "whole")
    told = [float(row["critics"]) for row in numbers(tmp_path / "whole")[0]]
    assert len(told) == 6 and np.all(np.array(told) > 0)
