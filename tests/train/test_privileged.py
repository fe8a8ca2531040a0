"""Tests of training on the privileged observation: nothing is drawn, and policies of frames and of it are not mixed."""

from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import yaml

from tests.env.handmade import ring
from thalweg.algos import Policy
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.policy_file import About
from thalweg.core import versions
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.rivers import river_list
from thalweg.env.task.ideal_eye import FEATURES
from thalweg.render import compilation
from thalweg.train import load_policy, river, run
from thalweg.train.errors import TrainingError
from thalweg.train.observations import check_policy_fits, observation_of
from thalweg.train.river import RiverTraining

SMALL = {"steps_per_update": 64, "minibatch": 32, "passes": 1, "hidden": [8], "critic_warmup_steps": 0}
EYE = EnvConfig(observation="privileged")
ACTIONS = actions_of(gym.spaces.MultiDiscrete([3, 3, 3, 3]))


@pytest.fixture(autouse=True)
def rings(monkeypatch: pytest.MonkeyPatch) -> None:
    """All rivers are rings made by hand, of which no frame can be drawn."""

    def drawn(*_: object, **__: object) -> None:
        raise AssertionError("frames were drawn, or kernels compiled for them")

    monkeypatch.setattr(river_list, "load_or_plan", lambda *_: ring())
    monkeypatch.setattr(compilation, "begin", drawn)
    monkeypatch.setattr("thalweg.render.Renderer", drawn)


def train(folder: Path, algorithm: str = "PPO", steps: int = 192, **options: Any) -> Any:
    training = RiverTraining("Easy", 4)
    return training.train(algorithm, None, steps=steps, seed=3, folder=folder, settings=SMALL, **options)


def tensors(folder: Path) -> np.ndarray:
    return load_policy(folder).actor.stack.flat.detach().numpy()


def test_it_is_the_run_on_environments_of_that_observation(tmp_path: Path):
    train(tmp_path / "river")
    told = EYE.with_options(critic_info=True)
    run("PPO", RiverVectorEnv([ring()], 4, told), steps=192, seed=3, folder=tmp_path / "plain", config=SMALL)
    episodes = [(tmp_path / name / "episodes.csv").read_text() for name in ("river", "plain")]
    assert episodes[0] == episodes[1] and len(episodes[0].splitlines()) > 2
    np.testing.assert_array_equal(tensors(tmp_path / "river"), tensors(tmp_path / "plain"))
    assert load_policy(tmp_path / "river").obs_size == len(FEATURES)


def test_the_run_records_the_observation_and_neither_encoder_nor_renderer(tmp_path: Path):
    train(tmp_path)
    recorded = yaml.safe_load((tmp_path / "config.yaml").read_text())["run"]["context"]
    seed = river.level_named("Easy").default_seed
    seen = {"observation": "privileged", "privileged_version": versions.PRIVILEGED, "env": EYE.as_data()}
    assert recorded == {"level": "Easy", "world_seeds": [seed], **seen}
    assert load_policy(tmp_path).about.context == recorded


def test_an_interrupted_run_resumes_to_the_same_policy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    class Breaks(RiverVectorEnv):
        steps = 0

        def step(self, actions: Any) -> Any:
            self.steps += 1
            if self.steps == 40:
                raise InterruptedError
            return super().step(actions)

    monkeypatch.setattr(river, "run", partial(run, checkpoint_seconds=0.0))
    train(tmp_path / "whole")
    monkeypatch.setattr(river, "RiverVectorEnv", Breaks)
    with pytest.raises(InterruptedError):
        train(tmp_path / "broken")
    monkeypatch.setattr(river, "RiverVectorEnv", RiverVectorEnv)
    assert train(tmp_path / "broken").resumed_from == 128
    for name in ("episodes.csv", "policy.safetensors"):
        assert (tmp_path / "broken" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


@pytest.mark.slow
def test_a_planner_takes_the_privileged_observation(tmp_path: Path):
    training = RiverTraining("Easy", 2)
    settings = {"random_steps": 64, "steps_per_collection": 32}
    training.train("CCEPETS", None, steps=64, seed=0, folder=tmp_path, settings=settings)
    policy = load_policy(tmp_path)
    assert (policy.obs_size, observation_of(policy)) == (len(FEATURES), "privileged")


def test_on_a_gpu_the_environments_are_tensors_of_that_observation(monkeypatch: pytest.MonkeyPatch):
    made: list[Any] = []

    def tensor_envs(worlds: Any, num_envs: int, config: EnvConfig, *, device: str) -> Any:
        made.append((len(worlds), num_envs, config, device))
        return made

    monkeypatch.setattr("thalweg.env.torch_env.TensorRiverEnv", tensor_envs)
    assert RiverTraining("Easy", 4)._envs(None, "cuda:1") is made
    assert made == [(1, 4, EYE, "cuda:1")]


def policy_with(size: int, context: dict[str, Any]) -> Policy:
    return Policy(size, ACTIONS, about=About("PPO", {}, context))


ENCODER: Any = SimpleNamespace(latent=16, about={"path": __file__})
PRIVILEGED = {"observation": "privileged", "privileged_version": versions.PRIVILEGED}


@pytest.mark.parametrize(
    ("policy", "encoder", "message"),
    [
        (
            policy_with(37, PRIVILEGED),
            ENCODER,
            "was trained on the privileged observation, but here it would see frames through an encoder; choose the"
            " privileged observation, or another policy",
        ),
        (
            policy_with(16, {"encoder": "ab"}),
            None,
            "was trained on frames through an encoder, but here it would see the privileged observation",
        ),
        (
            policy_with(37, {"observation": "privileged"}),  # from before there was a version
            None,
            f"trained on version 1 of the privileged observation, but this is version {versions.PRIVILEGED}; train it",
        ),
        (policy_with(36, PRIVILEGED), None, "the policy takes 36 numbers, but the privileged observation has 37"),
        (policy_with(16, {}), None, "the policy takes 16 numbers, but the privileged observation has 37"),
        (
            policy_with(9, {"observation": "lidar"}),
            None,
            "trained on the observation 'lidar'; on rivers policies see frames, privileged, rgb",
        ),
        (
            Policy(37, actions_of(gym.spaces.Discrete(3)), about=About("PPO", {}, PRIVILEGED)),
            None,
            r"takes four branches of 3 options, counted from 0, not \(3,\)",
        ),
    ],
)
def test_a_policy_of_another_observation_is_refused(policy: Policy, encoder: Any, message: str):
    with pytest.raises(TrainingError, match=message):
        check_policy_fits(policy, encoder)


@pytest.mark.parametrize(
    ("context", "observation"),
    [({}, "frames"), ({"encoder": "ab", "render_version": 3}, "frames"), (PRIVILEGED, "privileged")],
)
def test_a_policy_that_does_not_name_its_observation_sees_frames(context: dict[str, Any], observation: str):
    assert observation_of(policy_with(5, context)) == observation


def test_a_policy_of_unknown_origin_fits_by_its_size():
    check_policy_fits(policy_with(37, {}), None)
    check_policy_fits(policy_with(16, {}), ENCODER)


def test_a_run_begins_with_a_policy_of_the_same_observation_only(tmp_path: Path):
    train(tmp_path / "first", steps=64)
    train(tmp_path / "then", "FOCOPS", steps=64, begin_with=tmp_path / "first")
    begun = yaml.safe_load((tmp_path / "then" / "config.yaml").read_text())["run"]["begin_with"]
    assert begun["algorithm"] == "PPO"
    policy_with(37, {"encoder": "ab"}).save(tmp_path / "frames.safetensors")
    with pytest.raises(TrainingError, match="was trained on frames through an encoder, but here it would see the priv"):
        train(tmp_path / "refused", begin_with=tmp_path / "frames.safetensors")
    assert not (tmp_path / "refused").exists()


def test_a_run_on_frames_does_not_resume_on_the_privileged_observation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    train(tmp_path, steps=64)
    context = {"level": "Easy", "world_seeds": [1], "encoder": "ab", "render_version": 3, "env": {}}
    monkeypatch.setattr(RiverTraining, "_context", lambda *_: context)
    with pytest.raises(TrainingError, match=r"context\.observation is 'privileged' there and absent here"):
        train(tmp_path, steps=64)


@pytest.mark.parametrize("name", ["tasks", "vehicles", "props"])
def test_a_policy_of_another_version_is_refused(name: str):
    policy = policy_with(37, PRIVILEGED | {f"{name}_version": 0})
    now = getattr(versions, name.upper())
    with pytest.raises(TrainingError, match=f"trained on version 0 of the {name}, but this is version {now}; train"):
        check_policy_fits(policy, None)
