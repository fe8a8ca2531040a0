"""Tests of the wrapper that replaces frames with the latents of an encoder."""

import numpy as np
import pytest

from tests.train.toys import Pictures, Walk
from thalweg.train import LatentVectorEnv, TrainingError


class Means:
    """Encodes an image as its mean and its mean squared; counts calls and images."""

    latent = 2

    def __init__(self) -> None:
        self.calls: list[int] = []

    def __call__(self, frames: np.ndarray) -> np.ndarray:
        self.calls.append(len(frames))
        mean = frames.astype(np.float32).mean((1, 2, 3))
        return np.stack([mean, mean**2], 1)


def test_latents_replace_frames_also_in_final_obs():
    env = LatentVectorEnv(Pictures(), Means())
    obs, _ = env.reset(seed=0)
    assert obs[:, 0].tolist() == [0, 10, 20]
    obs, _, terminated, _, info = env.step(np.zeros(3))
    assert obs[:, 0].tolist() == [1, 11, 21]
    assert terminated.tolist() == [False, True, False]
    assert info["final_obs"][0] is None and info["final_obs"][2] is None
    assert info["final_obs"][1].tolist() == [111, 111**2]
    assert info["cost"].tolist() == [0, 1, 0]


def test_a_step_calls_the_encoder_once_with_the_finished_frames_only():
    encoder = Means()
    env = LatentVectorEnv(Pictures(), encoder)
    env.reset(seed=0)
    env.step(np.zeros(3))
    assert encoder.calls == [3, 4]


def test_returned_latents_are_not_written_again():
    env = LatentVectorEnv(Pictures(), Means())
    first, _ = env.reset(seed=0)
    second, *_ = env.step(np.zeros(3))
    kept = (first.copy(), second.copy())
    env.step(np.zeros(3))
    assert np.array_equal(first, kept[0]) and np.array_equal(second, kept[1])


def test_spaces_are_those_of_the_latents():
    env = LatentVectorEnv(Pictures(), Means())
    assert env.single_observation_space.shape == (2,) and env.observation_space.shape == (3, 2)
    assert env.single_action_space == env.env.single_action_space


def test_what_the_environment_has_is_passed_through_and_nothing_else():
    env = LatentVectorEnv(Pictures(), Means())
    assert env.pilot_actions().tolist() == [0, 0, 0]
    assert not hasattr(env, "get_state")
    with pytest.raises(AttributeError, match="no fly"):
        env.fly  # noqa: B018


def test_vectors_need_no_encoder():
    with pytest.raises(TrainingError, match="needs images"):
        LatentVectorEnv(Walk(), Means())
