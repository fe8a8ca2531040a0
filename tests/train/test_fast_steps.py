"""Policies that begin with one of another task, or fly there: what becomes of their moves forward."""

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
import yaml

from tests.image_policies import image_policy
from tests.train.small_runs import SMALL, rows_of, train
from thalweg.algos import AlgorithmError
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.networks import NetworkShape
from thalweg.algos.policy.policy import OptionCopy, Policy
from thalweg.algos.policy.policy_file import About, load_policy
from thalweg.env import EnvConfig
from thalweg.train import river
from thalweg.train.errors import TrainingError
from thalweg.train.fast_steps import fast_step_of, other_steps_in_words
from thalweg.train.river import RiverTraining

FAST = OptionCopy(branch=2, option=2, like=0, times_rarer=9.0)
OPTIONS, BOX = gym.spaces.MultiDiscrete([3, 3, 3, 3]), gym.spaces.Box(-1.0, 1.0, (4,), np.float32)
OBS = torch.randn(64, 5, generator=torch.Generator().manual_seed(0))


def policy(task: str = "River", space: Any = OPTIONS, adapter: Any = "native", **changes: Any) -> Policy:
    """A policy of numbers, whose network decides in every state otherwise."""
    about = About("PPO", {}, {"env": {"task": task}})
    shape, generator = NetworkShape((8,), initial="kaiming"), torch.Generator().manual_seed(1)
    found = Policy(5, actions_of(space, adapter), shape, generator=generator, about=about, **changes)
    with torch.no_grad():
        found.actor.stack.flat.mul_(5.0)
    return found


def log_probs(of: Policy) -> torch.Tensor:
    """Logarithmic probabilities [B, 4, 3] of the options."""
    with torch.no_grad():
        return of.distribution(OBS).log_p  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize("temperature", [1.0, 2.5])
def test_in_every_state_a_tenth_of_the_moves_forward_are_fast_and_nothing_else_changes(temperature: float):
    one = policy(temperature=temperature)
    before = log_probs(one)
    one.copy_option(FAST)
    after = log_probs(one)
    fast, forward = after[:, 2, 2].exp(), after[:, 2, 0].exp()
    assert torch.allclose(fast / (fast + forward), torch.tensor(0.1), atol=1e-5)
    assert torch.allclose(after[:, 2, 0] - after[:, 2, 1], before[:, 2, 0] - before[:, 2, 1], atol=1e-4)
    assert torch.equal(after[:, [0, 1, 3]], before[:, [0, 1, 3]])
    assert float((after[:, 2, 2] - before[:, 2, 2]).abs().max()) > 1.0


def test_a_policy_of_numbers_has_no_weights_of_options():
    with pytest.raises(AlgorithmError, match="the policy is gaussian: it has no weights of options"):
        policy(space=BOX).copy_option(FAST)


@pytest.mark.parametrize(
    ("trained_on", "task", "copied"),
    [
        *(("River", task, FAST) for task in ("Swimmers", "RacingLine")),
        *(("Nests", task, FAST) for task in ("Swimmers", "RacingLine")),
        *(("River", task, None) for task in ("River", "Nests", "Portage")),
        ("Swimmers", "Swimmers", None),
        ("Swimmers", "RacingLine", None),
    ],
)
def test_only_between_tasks_without_and_with_fast_steps_the_option_changes(trained_on: str, task: str, copied: Any):
    assert fast_step_of(policy(trained_on), task) == copied


@pytest.mark.parametrize("task", ["River", "Nests", "Portage"])
def test_a_policy_with_fast_steps_does_not_begin_where_there_are_none(task: str):
    with pytest.raises(TrainingError, match=f"was trained on RacingLine, which has fast steps, and {task} has none;"):
        fast_step_of(policy("RacingLine"), task)


@pytest.mark.parametrize("changes", [{"space": BOX}, {"adapter": "box_scaled"}], ids=str)
def test_a_policy_of_numbers_is_refused_where_they_would_be_other_moves(changes: dict[str, Any]):
    with pytest.raises(TrainingError, match="no fast step, and its actions are numbers: in Swimmers the same numbers"):
        fast_step_of(policy(**changes), "Swimmers")
    assert fast_step_of(policy(**changes), "Nests") is None


def test_a_policy_of_a_task_that_is_not_here_is_refused():
    with pytest.raises(TrainingError, match="trained on Nowhere and is to fly Swimmers: task must be one of 'River'"):
        fast_step_of(policy("Nowhere"), "Swimmers")


@pytest.mark.parametrize(
    ("trained_on", "space", "task", "told"),
    [
        (
            "RacingLine",
            OPTIONS,
            "River",
            "RacingLine, which has fast steps; River has none: where it would take one, it",
        ),
        ("RacingLine", BOX, "River", "RacingLine, which has fast steps; River has none: its moves forward are shorter"),
        (
            "River",
            OPTIONS,
            "RacingLine",
            "River, which has no fast step; in RacingLine its third option forward is one",
        ),
        ("River", BOX, "RacingLine", "River, which has no fast step; in RacingLine its moves forward are longer"),
        ("Swimmers", OPTIONS, "RacingLine", ""),
        ("River", OPTIONS, "Nests", ""),
        ("Nowhere", OPTIONS, "RacingLine", ""),
    ],
)
def test_it_is_told_what_becomes_of_moves_forward_in_another_task(trained_on: str, space: Any, task: str, told: str):
    found = other_steps_in_words(policy(trained_on, space), task)
    assert found.startswith(f"the policy was trained on {told}") if told else found == ""


def test_a_run_and_the_policy_that_it_stays_close_to_begin_with_the_copied_option(tmp_path: Path):
    """Actions of the walkers are left, stay and right: left becomes as probable as right, less ln 9."""
    train(tmp_path / "first", "PPO", steps=256)
    copied = OptionCopy(branch=0, option=0, like=2, times_rarer=9.0)
    settings = SMALL | {"critic_warmup_steps": 0, "imitation_kl": 1.0, "learning_rate": 0.0}
    given: dict[str, Any] = {"steps": 256, "config": settings, "begin_with": tmp_path / "first"}
    found = train(tmp_path / "then", "PPO", copied_option=copied, **given).policy
    seen = torch.randn(16, 3, generator=torch.Generator().manual_seed(0))
    of = [each.distribution(seen).log_p.detach() for each in (found, load_policy(policy_file(tmp_path / "first")))]
    assert torch.allclose(of[0][:, 0, 0], of[0][:, 0, 2] - math.log(9.0), atol=1e-5)
    assert not torch.allclose(of[0][:, 0, 0], of[1][:, 0, 0], atol=0.1)
    rows = rows_of(tmp_path / "then", "metrics.csv")
    assert [float(row["imitation_kl"]) for row in rows] == pytest.approx([0.0] * len(rows), abs=1e-3)  # statistics grow
    said = yaml.safe_load((tmp_path / "then" / "config.yaml").read_text())["run"]["begin_with"]
    assert said["copied_option"] == {"branch": 0, "option": 0, "like": 2, "times_rarer": 9.0}
    with pytest.raises(ValueError, match=r"belongs to another run: .*copied_option"):
        train(tmp_path / "then", "PPO", **given)


def policy_file(folder: Path) -> Path:
    return folder / "policy.safetensors"


@pytest.mark.parametrize(("task", "copied"), [("Swimmers", FAST), ("River", None)])
def test_training_on_a_task_with_fast_steps_says_what_they_begin_with(
    task: str, copied: OptionCopy | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
):
    given: list[Any] = []

    class Closes:
        def close(self) -> None: ...

    monkeypatch.setattr(river, "run", lambda *_, **how: given.append(how["copied_option"]))
    monkeypatch.setattr(RiverTraining, "_envs", lambda *_, **__: Closes())
    image_policy("rgb+mask").save(tmp_path / "river.safetensors")
    options: dict[str, Any] = {"steps": 64, "seed": 0, "folder": tmp_path / "run", "settings": {"policy": "cnn"}}
    training = RiverTraining("Easy", 2, config=EnvConfig(task=task))
    training.train("PPO", None, begin_with=tmp_path / "river.safetensors", **options)
    assert given == [copied]
    told = [line for line in capsys.readouterr().err.splitlines() if "begin with" in line]
    line = (
        "the policy to begin with was trained on River, which has no fast step: in Swimmers, 10% of its moves forward"
        " are fast at first"
    )
    assert told == ([] if copied is None else [line])


@pytest.mark.parametrize(("begun", "taught"), [({"imitation_version": 1}, True), ({"taught": True}, True), ({}, None)])
def test_what_begins_with_a_taught_policy_is_taught(
    begun: dict[str, Any], taught: bool | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    given: list[Any] = []
    monkeypatch.setattr(river, "run", lambda *_, **how: given.append(how["context"].get("taught")))
    monkeypatch.setattr(RiverTraining, "_envs", lambda *_, **__: SimpleNamespace(close=lambda: None))
    image_policy("rgb+mask", **begun).save(tmp_path / "first.safetensors")
    options: dict[str, Any] = {"steps": 64, "seed": 0, "folder": tmp_path / "run", "settings": {"policy": "cnn"}}
    RiverTraining("Easy", 2).train("PPO", None, begin_with=tmp_path / "first.safetensors", **options)
    assert given == [taught]


def test_training_without_fast_steps_refuses_a_policy_that_has_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(RiverTraining, "_envs", None)  # refused before there is anything to fly in
    image_policy("rgb+mask", env={"task": "Swimmers"}).save(tmp_path / "swimmers.safetensors")
    options: dict[str, Any] = {"steps": 64, "seed": 0, "folder": tmp_path / "run", "settings": {"policy": "cnn"}}
    with pytest.raises(TrainingError, match="was trained on Swimmers, which has fast steps, and River has none"):
        RiverTraining("Easy", 2).train("PPO", None, begin_with=tmp_path / "swimmers.safetensors", **options)
    assert not (tmp_path / "run").exists()
