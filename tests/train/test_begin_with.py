"""A run that begins with the policy of another: what it takes over, what it refuses, and that it can be broken off."""

import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml

from tests.train.bright_side import BrightSide
from tests.train.bright_side import Stop as BrightStop
from tests.train.bright_side import StopsAt as BrightStops
from tests.train.small_runs import SMALL, Stop, StopsAt, numbers, rows_of, small, train
from thalweg.algos import AlgorithmError
from thalweg.algos.interface import Feedback
from thalweg.algos.offpolicy.agent import Agent
from thalweg.algos.offpolicy.replay_buffer import Batch
from thalweg.algos.policy.policy import OptionCopy
from thalweg.algos.policy.policy_file import load_policy
from thalweg.algos.registry import algorithm_named
from thalweg.train import run
from thalweg.train.errors import TrainingError
from thalweg.train.trainer import Trainer

SEEN = torch.from_numpy(np.random.default_rng(0).standard_normal((4, 3)).astype(np.float32))


@pytest.fixture(scope="module")
def first(tmp_path_factory) -> Path:
    """A run of PPO."""
    folder = tmp_path_factory.mktemp("first")
    train(folder, "PPO")
    return folder


def at_once(algorithm: str = "FOCOPS") -> dict[str, Any]:
    """Settings with which the policy learns from the first update."""
    return {"config": small(algorithm) | {"critic_warmup_steps": 0}}


def shown(folder: Path) -> np.ndarray:
    """What the network of a run's policy says of some observations."""
    policy = load_policy(folder / "policy.safetensors")
    return policy.actor(policy.normaliser(SEEN)).detach().numpy()


@pytest.mark.parametrize("algorithm", ["PPOLag", "FOCOPS", "P3O", "CUP"])
def test_the_policy_starts_from_the_given_one(
    algorithm: str, first: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    begun = {}
    start = Trainer.start

    def look(trainer: Trainer, state=None) -> None:
        policy: Any = trainer.learner.policy
        begun["shown"] = policy.actor(policy.normaliser(SEEN)).detach().numpy()
        begun["count"] = policy.normaliser.count
        start(trainer, state)

    monkeypatch.setattr(Trainer, "start", look)
    train(tmp_path, algorithm, steps=64, begin_with=first, **at_once(algorithm))
    assert np.array_equal(begun["shown"], shown(first)) and begun["count"] > 1000
    said = yaml.safe_load((tmp_path / "config.yaml").read_text())["run"]["begin_with"]
    assert said["algorithm"] == "PPO" and len(said["content"]) == 16


@pytest.mark.parametrize("algorithm", ["DDPGLag", "SACLag"])
def test_slow_copies_follow_the_policy_that_was_taken_over(algorithm: str, tmp_path: Path, monkeypatch):
    train(tmp_path / "first", algorithm, steps=400)
    found = []
    learn = Agent.learn

    def look(agent: Agent, feedback: Feedback, step: Callable[[Batch], None]) -> None:
        def looked(batch: Batch) -> None:
            if not agent.gradient_steps:
                found.append(bool((agent.targets.target == agent.targets.online).all()))
            step(batch)

        learn(agent, feedback, looked)

    monkeypatch.setattr(Agent, "learn", look)
    config = small(algorithm) | {"critic_warmup_steps": 24}
    train(tmp_path / "then", algorithm, steps=256, config=config, begin_with=tmp_path / "first")
    assert found == [True]


@pytest.mark.parametrize("warmup", [300, 1000])
def test_a_run_that_began_with_another_is_gone_on_with_to_the_bit(warmup: int, first: Path, tmp_path: Path):
    """Interrupted after 800 steps, after the warm-up of critics or in it."""
    given: dict[str, Any] = {"begin_with": first, "config": SMALL | {"critic_warmup_steps": warmup}}
    train(tmp_path / "whole", **given)
    with pytest.raises(Stop):
        train(tmp_path / "cut", env=StopsAt(200), **given)
    train(tmp_path / "cut", **given)
    assert numbers(tmp_path / "whole") == numbers(tmp_path / "cut")
    train(tmp_path / "plain")
    assert numbers(tmp_path / "plain") != numbers(tmp_path / "whole")
    still = [float(row["kl"]) == 0.0 for row in rows_of(tmp_path / "whole", "metrics.csv")]
    assert still == [update < -(-warmup // 128) for update in range(len(still))]


@pytest.mark.parametrize(("warmup", "stays"), [(255, True), (128, False)])
def test_the_policy_stays_as_it_was_during_the_warmup_of_critics(
    warmup: int, stays: bool, first: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Two updates of 128 steps each, the second of which begins within 255 steps, but not within 128."""
    # It refuses a run that teaches the policy nothing. `thalweg.train.run` is the function, not its module.
    monkeypatch.setattr(importlib.import_module("thalweg.train.run"), "check_warmup", lambda *_: None)
    train(tmp_path, steps=256, begin_with=first, config=SMALL | {"critic_warmup_steps": warmup})
    assert np.array_equal(shown(tmp_path), shown(first)) == stays


@pytest.mark.parametrize("warmup", [129, 256])
def test_a_warmup_that_leaves_no_rollout_is_refused_before_anything_is_written(
    warmup: int, first: Path, tmp_path: Path
):
    words = (
        f"critic_warmup_steps must be at most 128 in a run of 256 steps that begins with another policy, got {warmup}"
    )
    with pytest.raises(TrainingError, match=words):
        train(tmp_path / "run", steps=256, begin_with=first, config=SMALL | {"critic_warmup_steps": warmup})
    assert not (tmp_path / "run").exists()
    train(tmp_path / "run", steps=256, config=SMALL | {"critic_warmup_steps": warmup})


@pytest.mark.parametrize(("algorithm", "most"), [("PPO", 98_304), ("SACLag", 95_840)])
def test_a_short_run_of_many_environments_is_told_of_the_warmup_that_follows_from_their_number(
    algorithm: str, most: int
):
    check_warmup = importlib.import_module("thalweg.train.run").check_warmup
    config = algorithm_named(algorithm).configure({}, "default", 256)
    words = (
        rf"critic_warmup_steps must be at most {most} .* 100000 steps .* got 160000 for 256 environments: .* set crit"
    )
    with pytest.raises(TrainingError, match=words):
        check_warmup(config, 100_000, 256)
    check_warmup(config, 200_000, 256)


def test_random_steps_that_leave_no_rollout_are_named_and_not_the_warmup():
    check_warmup = importlib.import_module("thalweg.train.run").check_warmup
    config = algorithm_named("SACLag").configure({"critic_warmup_steps": 0, "random_steps": 600}, "default", 8)
    with pytest.raises(TrainingError, match=r"random_steps must be at most 4\d\d in a run of 500 .* got 600: all"):
        check_warmup(config, 500, 8)


def test_an_option_of_a_policy_that_is_not_there_is_refused(tmp_path: Path):
    with pytest.raises(AlgorithmError, match=r"copied_option = \(0, 2, 1, 10.0\) is for a policy .* give begin_with"):
        train(tmp_path / "run", steps=256, config=SMALL, copied_option=OptionCopy(0, 2, 1, 10.0))
    assert not (tmp_path / "run").exists()


def test_a_run_belongs_to_what_it_began_with(first: Path, tmp_path: Path):
    train(tmp_path, steps=128, **at_once())
    with pytest.raises(ValueError, match=r"belongs to another run: .*begin_with"):
        train(tmp_path, steps=128, begin_with=first, **at_once())


@pytest.mark.parametrize(
    ("algorithm", "changes", "words"),
    [
        ("FOCOPS", {"hidden": (8,)}, r"hidden is \(8,\) here and \(16,\) there"),
        ("FOCOPS", {"frame_stack": 2}, "frame_stack is 2 here and 1 there"),
        ("FOCOPS", {"adapter": "box_scaled"}, "actions is Actions.*gaussian.* here and Actions.*categorical"),
        ("FOCOPS", {"normalise_observations": False}, "normalise_observations is False here and True there"),
        ("FOCOPS", {"memory": "gru", "memory_size": 8}, "memory_size is 8 here and 0 there"),
        ("CCEPETS", None, "CCEPETS is a planner and can't start from the policy of another run"),
    ],
)
def test_a_policy_of_another_kind_is_refused_before_anything_is_written(
    algorithm: str, changes: dict | None, words: str, first: Path, tmp_path: Path
):
    given: dict[str, Any] = {} if changes is None else {"config": SMALL | {"critic_warmup_steps": 0} | changes}
    with pytest.raises(AlgorithmError, match=words):
        train(tmp_path / "run", algorithm, begin_with=first, **given)
    assert not (tmp_path / "run").exists()


def test_a_planner_cannot_initialise_a_policy(tmp_path: Path):
    train(tmp_path / "planner", "CCEPETS", steps=256)
    with pytest.raises(AlgorithmError, match="CCEPETS is a planner: it has no policy network to start from"):
        train(tmp_path / "run", "FOCOPS", begin_with=tmp_path / "planner", **at_once())


def test_a_folder_without_a_policy_is_named(tmp_path: Path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(AlgorithmError, match=r"empty is not the folder of a run: it holds no policy\.safetensors"):
        train(tmp_path / "run", begin_with=tmp_path / "empty", **at_once())


EYES: dict[str, Any] = {"filters": (4,), "features": 8, "hidden": (12,), "activation": "relu"}
EYES |= {"memory": "gru", "memory_size": 6}
"""Settings of the network of a policy that sees images."""


@pytest.fixture(scope="module")
def imitated(tmp_path_factory) -> Path:
    """A run whose policy sees images, with a memory, as imitated ones do."""
    folder = tmp_path_factory.mktemp("imitated")
    see(folder, config=at_once("PPO")["config"] | {"policy": "cnn"} | EYES)
    return folder


def see(folder: Path, algorithm: str = "PPO", env: BrightSide | None = None, **given: Any):
    """Train on images; settings of the network follow from the policy that the run begins with."""
    config = small(algorithm) | {"policy": "cnn", "critic_warmup_steps": 128}
    del config["hidden"]
    usual: dict[str, Any] = {"steps": 512, "seed": 2, "config": config, "checkpoint_seconds": 0.0}
    usual["config"] = config | given.pop("changes", {})
    return run(algorithm, env or BrightSide(), folder=folder, **(usual | given))


@pytest.mark.parametrize("algorithm", ["PPO", "PPOLag", "FOCOPS", "P3O", "CPO"])
def test_a_policy_that_sees_images_is_taken_over_with_the_shape_of_its_network(
    algorithm: str, imitated: Path, tmp_path: Path
):
    found = see(tmp_path, algorithm, steps=256, begin_with=imitated, changes={"imitation_kl": 1.0})
    other, shape = load_policy(imitated / "policy.safetensors"), found.policy.shape
    assert shape.eyes == other.shape.eyes and (shape.hidden, shape.memory, shape.activation) == ((12,), 6, "relu")
    rows = rows_of(tmp_path, "metrics.csv")
    assert float(rows[0]["imitation_kl"]) == pytest.approx(0.0, abs=1e-6) and float(rows[1]["imitation_kl"]) > 0.0


def test_a_network_of_another_shape_that_is_asked_for_is_refused_by_name(imitated: Path, tmp_path: Path):
    words = r"memory_size is 0 here and 6 there; features is 9 here and 8 there"
    with pytest.raises(AlgorithmError, match=words):
        see(tmp_path / "run", begin_with=imitated, changes={"features": 9, "memory": "none"})
    assert not (tmp_path / "run").exists()


def test_policies_of_numbers_and_of_images_do_not_take_each_other_over(first: Path, imitated: Path, tmp_path: Path):
    with pytest.raises(AlgorithmError, match=r"obs_size is 66 here and 3 there; .*image is \(.*\) here and None there"):
        see(tmp_path / "run", begin_with=first)
    with pytest.raises(AlgorithmError, match="obs_size is 3 here and 66 there"):
        train(tmp_path / "run", "PPO", begin_with=imitated, **at_once())


@pytest.mark.parametrize("at", [20, 40])
def test_a_run_that_stays_close_to_an_imitated_policy_resumes_to_the_bit(at: int, imitated: Path, tmp_path: Path):
    """Interrupted in the warm-up of critics and after it."""
    given: dict[str, Any] = {"begin_with": imitated, "changes": {"imitation_kl": 0.5}}
    see(tmp_path / "whole", **given)
    with pytest.raises(BrightStop):
        see(tmp_path / "cut", env=BrightStops(at), **given)
    see(tmp_path / "cut", **given)
    assert numbers(tmp_path / "whole") == numbers(tmp_path / "cut")
    see(tmp_path / "free", begin_with=imitated)
    assert numbers(tmp_path / "free") != numbers(tmp_path / "whole")


def test_a_policy_of_numbers_may_stay_close_to_another_too(first: Path, tmp_path: Path):
    given: dict[str, Any] = {"begin_with": first, "steps": 1024}
    close, free = (
        train(tmp_path / name, "PPO", config=at_once("PPO")["config"] | {"imitation_kl": weight}, **given)
        for name, weight in (("close", 100.0), ("free", 0.0))
    )
    gaps = [float(np.abs(shown(found.folder) - shown(first)).max()) for found in (close, free)]
    assert gaps[0] < 0.5 * gaps[1]
