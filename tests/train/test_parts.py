"""Tests of the parts of observations: what is an image, what are numbers, and in which order they stand."""

import gymnasium as gym
import numpy as np
import pytest
import torch

from thalweg.env.spaces import part_spaces
from thalweg.train.errors import TrainingError
from thalweg.train.parts import ObservationParts

SPACES = part_spaces(2, 3)


def parts(*names: str) -> ObservationParts:
    return ObservationParts(gym.spaces.Dict({name: SPACES[name] for name in names}))


def values(*names: str) -> dict[str, np.ndarray]:
    """Observations of two environments, each number another one."""
    random = np.random.default_rng(0)
    return {name: random.integers(0, 200, (2, *SPACES[name].shape)).astype(SPACES[name].dtype) for name in names}


@pytest.mark.parametrize("kind", [np.asarray, torch.from_numpy])
def test_rgb_and_mask_are_one_image_and_all_else_is_numbers(kind):
    names = ("proprioception", "mask", "privileged", "rgb")
    found, obs = parts(*names), values(*names)
    given = {name: kind(array) for name, array in obs.items()}
    assert (found.image_shape, found.size) == ((2, 3, 4), 46)
    np.testing.assert_array_equal(found.image(given), np.concatenate([obs["rgb"], obs["mask"]], -1))
    numbers = np.concatenate([obs["privileged"], obs["proprioception"]], -1)
    np.testing.assert_array_equal(found.numbers(given), numbers)
    one = {name: array[1] for name, array in given.items()}
    np.testing.assert_array_equal(found.numbers(one), numbers[1])


def test_one_image_or_one_vector_is_itself():
    image, vector = np.zeros((2, 4, 4, 1), np.uint8), np.zeros((2, 5))
    of_image = ObservationParts(gym.spaces.Box(0, 255, (4, 4, 1), np.uint8))
    of_vector = ObservationParts(gym.spaces.Box(-1, 1, (5,)))
    assert (of_image.image_shape, of_image.size) == ((4, 4, 1), 0)
    assert (of_vector.image_shape, of_vector.size) == (None, 5)
    assert of_image.image(image) is image and of_vector.numbers(vector) is vector
    assert parts("mask").image_shape == (2, 3, 1)
    assert parts("privileged").image_shape is None


def test_what_no_policy_sees_is_refused_by_name():
    with pytest.raises(TrainingError, match="the observations also have class, depth: leave that out"):
        parts("rgb", "depth", "class", "proprioception")
    with pytest.raises(TrainingError, match="a policy sees an image"):
        ObservationParts(gym.spaces.Discrete(3))
