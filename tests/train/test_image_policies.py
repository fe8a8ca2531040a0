"""Tests of the policies of images that fit the river task, and of what is said to those that do not."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import pytest

from tests.image_policies import ACTIONS, image_policy
from thalweg.algos import Policy
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.networks import NetworkShape
from thalweg.algos.policy.policy_file import About
from thalweg.algos.policy.vision import Eyes
from thalweg.core import versions
from thalweg.render import RENDER_VERSION
from thalweg.train.errors import TrainingError
from thalweg.train.observations import IMAGES, check_policy_fits, observation_of
from thalweg.train.river import RiverTraining

ENCODER: Any = SimpleNamespace(latent=16, about={"path": __file__})
PRIVILEGED = {"observation": "privileged", "privileged_version": versions.PRIVILEGED}


def of_numbers(size: int, context: dict[str, Any]) -> Policy:
    return Policy(size, ACTIONS, about=About("PPO", {}, context))


def of_one_branch() -> Policy:
    eyes = Eyes((128, 128, 3), (4,), 8)
    about = About("PPO", {}, {"observation": "rgb", "render_version": RENDER_VERSION})
    return Policy(eyes.pixels + 1, actions_of(gym.spaces.Discrete(3)), NetworkShape((8,), eyes=eyes), about=about)


@pytest.mark.parametrize("observation", IMAGES)
def test_a_policy_of_images_fits_without_an_encoder(observation: str):
    policy = image_policy(observation)
    assert observation_of(policy) == observation
    check_policy_fits(policy, None)
    check_policy_fits(policy, None, offered=observation)


NEWER = RENDER_VERSION + 1


@pytest.mark.parametrize(
    ("policy", "encoder", "offered", "message"),
    [
        (
            image_policy("rgb"),
            ENCODER,
            None,
            r"was trained on images \(rgb\), but here it would see frames through an encoder; choose images \(rgb\), or"
            " another policy",
        ),
        (image_policy("rgb"), None, "privileged", r"on images \(rgb\), but here it would see the privileged observ"),
        (image_policy("rgb"), None, "mask", r"trained on images \(rgb\), but here it would see images \(mask\)"),
        (
            of_numbers(16, {"encoder": "ab"}),
            None,
            "rgb",
            r"was trained on frames through an encoder, but here it would see images \(rgb\)",
        ),
        (of_numbers(37, PRIVILEGED), None, "rgb", r"privileged observation, but here it would see images \(rgb\)"),
        (of_numbers(16, {}), None, "rgb", r"takes 16 numbers, but the images \(rgb\) have the shape \(128, 128, 3\)"),
        (
            of_numbers(37, {"observation": "mask", "render_version": RENDER_VERSION}),
            None,
            None,
            r"takes 37 numbers, but the images \(mask\) have the shape \(128, 128, 1\)",
        ),
        (
            image_policy("rgb+mask", observation="rgb"),
            None,
            None,
            r"takes images of the shape \(128, 128, 4\), but the images \(rgb\) have the shape \(128, 128, 3\)",
        ),
        (
            image_policy("mask", 64),
            None,
            None,
            r"takes images of the shape \(64, 64, 1\), but the images \(mask\) have",
        ),
        (
            image_policy(render_version=NEWER),
            None,
            None,
            f"trained on images of renderer version {NEWER}, but the renderer is version {RENDER_VERSION}; train it ag",
        ),
        (image_policy(render_version=None), None, None, "trained on images of renderer version None, but"),
        (of_one_branch(), None, None, r"takes four branches of 3 options, counted from 0, not \(3,\)"),
    ],
)
def test_a_policy_of_other_images_or_of_none_is_refused(
    policy: Policy, encoder: Any, offered: str | None, message: str
):
    with pytest.raises(TrainingError, match=message):
        check_policy_fits(policy, encoder, offered=offered)


@pytest.mark.parametrize(("observation", "named"), [(None, "frames"), ("privileged", "privileged")])
def test_a_policy_that_takes_images_must_say_which(observation: str | None, named: str):
    message = f"takes images, but does not say which: its context has the observation '{named}' instead of one of rgb"
    with pytest.raises(TrainingError, match=message):
        observation_of(image_policy(observation=observation))


@pytest.mark.parametrize(
    ("encoder", "seen"), [(None, "the privileged observation"), (ENCODER, "frames through an encoder")]
)
def test_no_run_on_numbers_begins_with_a_policy_of_images(
    encoder: Any, seen: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    image_policy("rgb").save(tmp_path / "images.safetensors")
    monkeypatch.setattr(RiverTraining, "_envs", None)  # refused before there is anything to fly in
    training = RiverTraining("Easy", 2)
    options: dict[str, Any] = {"steps": 64, "seed": 0, "folder": tmp_path / "run"}
    with pytest.raises(TrainingError, match=rf"on images \(rgb\), but here it would see {seen}"):
        training.train("PPO", encoder, begin_with=tmp_path / "images.safetensors", **options)
    assert not (tmp_path / "run").exists()
