"""Tests of codes as observations of single environments, against the wrapper of vectors."""

from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from tests.interop.small import actions, assert_same, single, vector
from thalweg.encoder import VAE, EncoderFileError, EncoderInputError, VAEConfig, load_encoder, save_vae
from thalweg.env import RiverVectorEnv
from thalweg.interop.errors import InteropError
from thalweg.interop.latent import LatentEnv
from thalweg.interop.vector_envs import vector_env
from thalweg.render import RENDER_VERSION, Camera
from thalweg.train import LatentVectorEnv, TrainingError


@pytest.mark.parametrize("observation", ["rgb+mask", "rgb,mask,proprioception"])
def test_codes_are_those_of_the_vector_wrapper_to_the_bit(observation: str):
    options = {"observation": observation, "camera": Camera(), "max_steps": 50}
    one = LatentEnv(single(**options))
    many = LatentVectorEnv(vector(2, **options), load_encoder())
    assert one.observation_space == many.single_observation_space
    found, expected = one.reset(seed=4), many.reset(seed=4)
    assert_same(found[0], expected[0][0])
    for action in actions(one.action_space, 5):
        found, expected = one.step(action)[0], many.step(np.stack([action, action]))[0]
        assert_same(found, expected[0])


def test_gymnasiums_checker_passes():
    env = LatentEnv(gymnasium.make("thalweg/Easy-v0").unwrapped)
    check_env(env, skip_render_check=True)
    obs, _ = env.reset(seed=0)
    assert env.observation_space.contains(obs)


def test_observations_without_images_and_images_of_another_size_are_refused():
    with pytest.raises(InteropError, match="an encoder needs images, the environment's observations are Box"):
        LatentEnv(single(observation="privileged"))
    with pytest.raises(EncoderInputError, match="takes frames of 128 x 128 pixels, not of 40 x 48"):
        LatentEnv(single())


def test_encoders_of_another_renderer_are_refused(tmp_path: Path):
    path = tmp_path / "old.safetensors"
    save_vae(path, VAE(VAEConfig()), {"render_version": RENDER_VERSION - 1})
    with pytest.raises(EncoderFileError, match=f"renderer version {RENDER_VERSION - 1}"):
        LatentEnv(single(camera=Camera()), path)
    with pytest.raises(EncoderFileError, match=f"renderer version {RENDER_VERSION - 1}"):
        vector_env("thalweg/Easy-v0", 2, path, {"max_steps": 12})


def test_vector_environments_with_an_encoder_observe_its_codes():
    expected = LatentVectorEnv(vector(2, camera=Camera()), load_encoder()).reset(seed=4)[0]
    options = {"camera": Camera(), "quality": "fast", "max_steps": 12}
    assert_same(vector_env("thalweg/Easy-v0", 2, "default", options).reset(seed=4)[0], expected)


def test_environments_that_an_encoder_cannot_see_are_closed(monkeypatch: pytest.MonkeyPatch):
    closed = []
    monkeypatch.setattr(RiverVectorEnv, "close_extras", lambda self, **_: closed.append(self))
    with pytest.raises(TrainingError) as caught:
        vector_env("thalweg/Easy-v0", 2, "default", {"observation": "none"})
    assert len(closed) == 1 and caught.tb
