from dataclasses import asdict
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import pytest
import torch
import yaml

from tests.env.handmade import BlankRenderer, ring
from thalweg.algos.actions import actions_of
from thalweg.algos.policy import Policy
from thalweg.bench.baselines import BASELINES
from thalweg.encoder import VAE, EncoderFileError, EncoderInputError, VAEConfig, load_encoder, save_vae
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.render import RENDER_VERSION, Camera
from thalweg.train import river
from thalweg.train.errors import TrainingError
from thalweg.train.river import TrainingGround, check_sees_as_trained, load_fitting_encoder, mark


def encoder_file(path: Path, seed: int, version: int = RENDER_VERSION) -> Path:
    torch.manual_seed(seed)
    save_vae(path, VAE(VAEConfig()), {"render_version": version})
    return path


def test_a_policy_flies_only_through_the_encoder_it_was_trained_with(tmp_path: Path):
    own, other = (load_encoder(encoder_file(tmp_path / f"{seed}.safetensors", seed)) for seed in (0, 1))
    policy: Any = SimpleNamespace(about=SimpleNamespace(context={"encoder": mark(own)}))
    check_sees_as_trained(policy, own)
    with pytest.raises(TrainingError, match=f"encoder {mark(own)}, but this is encoder {mark(other)}"):
        check_sees_as_trained(policy, other)


def test_a_policy_that_tells_nothing_of_its_encoder_is_taken_at_its_word(tmp_path: Path):
    encoder = load_encoder(encoder_file(tmp_path / "0.safetensors", 0))
    check_sees_as_trained(BASELINES["hover"], encoder)


def test_an_encoder_of_another_renderer_is_refused(tmp_path: Path):
    path = encoder_file(tmp_path / "old.safetensors", 0, version=RENDER_VERSION + 1)
    with pytest.raises((EncoderFileError, EncoderInputError), match=str(RENDER_VERSION + 1)):
        load_fitting_encoder(path)


@pytest.mark.parametrize(
    ("obs_size", "space", "message"),
    [
        (8, gym.spaces.MultiDiscrete([3, 3, 3, 3]), "the policy sees 8 numbers, but the encoder gives 16"),
        (16, gym.spaces.MultiDiscrete([3, 3, 3]), r"counted from 0, not \(3, 3, 3\)"),
        (16, gym.spaces.MultiDiscrete([3, 3, 3, 2]), r"counted from 0, not \(3, 3, 3, 2\)"),
        (
            16,
            gym.spaces.MultiDiscrete([3, 3, 3, 3], start=[1, 1, 1, 1]),
            r"counted from 0, not \(3, 3, 3, 3\) from \(1, 1, 1, 1\)",
        ),
        (16, gym.spaces.Box(-1, 1, (4,)), r"counted from 0, not a Box of shape \(4,\)"),
        (16, gym.spaces.Discrete(81), r"counted from 0, not \(81,\)"),
    ],
)
def test_a_policy_that_does_not_fit_the_river_is_refused(tmp_path: Path, obs_size: int, space: gym.Space, message: str):
    encoder = load_encoder(encoder_file(tmp_path / "0.safetensors", 0))
    with pytest.raises(TrainingError, match=message):
        check_sees_as_trained(Policy(obs_size, actions_of(space)), encoder)


@pytest.mark.parametrize("head", ["native", "gaussian_discretised"])
def test_a_policy_of_the_rivers_own_spaces_fits(tmp_path: Path, head: Any):
    encoder = load_encoder(encoder_file(tmp_path / "0.safetensors", 0))
    check_sees_as_trained(Policy(16, actions_of(gym.spaces.MultiDiscrete([3, 3, 3, 3]), head)), encoder)


def test_a_run_says_on_what_it_was_trained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    told: dict[str, Any] = {}
    monkeypatch.setattr(river, "run", lambda *_, **given: told.update(given))
    monkeypatch.setattr(river, "load_or_build", lambda *_: ring())
    monkeypatch.setattr(river, "RiverVectorEnv", partial(RiverVectorEnv, renderer=BlankRenderer(128, 128)))
    encoder = load_encoder(encoder_file(tmp_path / "0.safetensors", 0))
    config = EnvConfig(max_steps=77, camera=Camera(fov_deg=50.0))
    TrainingGround("easy", 2, (3, 5), config).train("PPO", encoder, steps=9, seed=1, folder=tmp_path / "run")
    context = told["context"]
    assert (context["level"], context["world_seeds"], context["encoder"]) == ("Easy", [3, 5], mark(encoder))
    assert context["env"]["max_steps"] == 77
    assert context["env"]["camera"] == {**asdict(Camera()), "fov_deg": 50.0}
    assert yaml.safe_load(yaml.safe_dump(context)) == context
