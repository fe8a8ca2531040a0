"""A policy on the page flies as it does in an environment of its own, whatever the page shows."""

import gymnasium
import numpy as np
import pytest
import torch

import thalweg  # noqa: F401  # registers the environments
from tests.viewer.flight.conftest import Fly
from thalweg.bench.evaluate.baselines import BASELINES
from thalweg.bench.packaged import PACKAGED_POLICY
from thalweg.train import load_policy
from thalweg.train.errors import TrainingError
from thalweg.viewer.flight.policy_flyer import PolicyFlyer

STEPS = 8


@pytest.mark.parametrize("action", ["multidiscrete", "continuous"])
def test_the_packaged_policy_flies_as_in_an_environment_of_its_own(fly: Fly, action: str):
    flight = fly(seed=4, action=action)
    flyer = PolicyFlyer("packaged", load_policy(PACKAGED_POLICY), flight)
    for _ in range(STEPS):
        flight.step(flyer.action(flight), "packaged")

    env = gymnasium.make("thalweg/Easy-v0").unwrapped
    frame, info = env.reset(seed=4)
    player = load_policy(PACKAGED_POLICY).player(1, generator=torch.Generator().manual_seed(4))
    poses, fresh, seen = [info["pose"]], np.ones(1, bool), None
    for _ in range(STEPS):
        seen = frame
        frame, _, _, _, info = env.step(player(frame[None], fresh)[0])
        poses.append(info["pose"])
        fresh = np.zeros(1, bool)
    assert np.array_equal(flight.poses, poses)
    assert flyer.seen is not None and seen is not None
    assert np.array_equal(flyer.seen, seen)
    assert flyer.decoded() is None


def test_the_eye_of_a_flight_serves_the_next_one_in_the_same_environment(fly: Fly):
    flight, policy = fly(seed=4), load_policy(PACKAGED_POLICY)
    eye = PolicyFlyer("packaged", policy, flight).eye
    assert PolicyFlyer("packaged", policy, flight, eye).eye is eye
    assert PolicyFlyer("packaged", policy, fly(seed=4), eye).eye is not eye


def test_a_policy_of_another_vehicle_is_refused(fly: Fly):
    with pytest.raises(TrainingError, match="trained for the vehicle uav, not asv"):
        PolicyFlyer("packaged", load_policy(PACKAGED_POLICY), fly(vehicle="asv"))


def test_a_baseline_flies_without_an_image(fly: Fly):
    flight = fly()
    flyer = PolicyFlyer("forward", BASELINES["forward"], flight)
    assert flyer.action(flight).tolist() == [1, 1, 0, 1]
    assert flyer.seen is None
