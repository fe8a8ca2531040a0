"""A policy on the page flies as it does in an environment of its own, whatever the page shows."""

from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.spaces import MultiDiscrete

import thalweg  # noqa: F401  # registers the environments
from tests.train.test_proprioception import EYE, FELT
from tests.viewer.flight.conftest import Fly
from thalweg.algos import Policy
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.policy_file import About
from thalweg.bench.evaluate.baselines import BASELINES
from thalweg.bench.packaged import PACKAGED_POLICY
from thalweg.encoder import load_encoder
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.task.ideal_eye import FEATURES
from thalweg.env.task.proprioception import PROPRIOCEPTION
from thalweg.train import load_policy
from thalweg.train.errors import TrainingError
from thalweg.viewer.flight.policy_flyer import PolicyFlyer
from thalweg.world import World

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


def policy_of(size: int, context: dict[str, Any]) -> Policy:
    """An untrained policy whose actions depend on what it sees."""
    actions, generator = actions_of(MultiDiscrete([3, 3, 3, 3])), torch.Generator().manual_seed(0)
    policy = Policy(size, actions, generator=generator, about=About("PPO", {}, context))
    with torch.no_grad():
        policy.actor.stack.flat.mul_(10.0)
    return policy


@pytest.mark.parametrize("feels", [False, True], ids=["", "felt"])
@pytest.mark.parametrize("sees", ["codes", "privileged"])
def test_policies_of_numbers_fly_as_in_an_environment_of_their_own(sees: str, feels: bool, fly: Fly, easy_world: World):
    encoder = load_encoder()
    context: dict[str, Any] = {"observation": "frames"} if sees == "codes" else EYE
    parts: Any = ("rgb", "mask") if sees == "codes" else ("privileged",)
    size = encoder.latent if sees == "codes" else len(FEATURES)
    if feels:
        context, parts, size = context | FELT, (*parts, "proprioception"), size + len(PROPRIOCEPTION)
    flight, policy = fly(seed=4), policy_of(size, context)
    flyer, told = PolicyFlyer("mine", policy, flight), []
    play = flyer._play
    flyer._play = lambda obs, fresh: told.append((obs[0], fresh[0])) or play(obs, fresh)
    while flight.steps < STEPS and not flight.ended:
        flight.step(flyer.action(flight), "mine")

    env = RiverVectorEnv([easy_world], 1, EnvConfig(observation=parts), autoreset_mode="DISABLED")
    seen, info = env.reset(seed=4)
    player = policy.player(1, generator=torch.Generator().manual_seed(4))
    poses, fresh = [info["pose"][0]], np.ones(1, bool)
    for step in range(flight.steps):
        frames = np.concatenate([seen["rgb"], seen["mask"]], -1) if sees == "codes" else None
        numbers = [seen["privileged"] if frames is None else encoder(frames)]
        numbers += [seen["proprioception"]] if feels else []
        observed = np.concatenate(numbers, 1)
        assert np.array_equal(told[step][0], observed[0]) and told[step][1] == fresh[0]
        seen, *_, info = env.step(player(observed, fresh))
        poses.append(info["pose"][0])
        fresh = np.zeros(1, bool)
    assert flight.steps > 1 and np.array_equal(flight.poses, poses)


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
