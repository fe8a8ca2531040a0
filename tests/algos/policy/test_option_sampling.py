"""Compiled acting takes the options that the definition, a chain of calls of PyTorch, takes with the same draws."""

from typing import Any

import numpy as np
import pytest
import torch

from tests.algos.policy.test_policy import SPACES
from thalweg.algos import Policy
from thalweg.algos.policy import fast_path, option_sampling
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.networks import NetworkShape
from thalweg.algos.policy.normaliser import Normaliser

DISCRETE = ["MultiDiscrete", "uneven", "Discrete"]


def policy_for(space: str, **settings: Any) -> Policy:
    """A policy far from uniform, with statistics of observations."""
    generator = torch.Generator().manual_seed(1)
    shape = NetworkShape((24, 16), settings.pop("activation", "tanh"))
    policy = Policy(5, actions_of(SPACES[space]), shape, generator=generator, **settings)
    with torch.no_grad():
        policy.actor.stack.flat.normal_(0, 0.5, generator=generator)
    size = policy.frames * policy.obs_size
    policy.normaliser.update(torch.randn(50, size, generator=generator) * 2 + 0.5)
    return policy


def steps(policy: Policy, compiled: bool, deterministic: bool = False) -> tuple[np.ndarray, torch.Tensor]:
    """Return the actions [T, N, ...] of a player in 40 steps, and the state of its generator after them."""
    generator, random = torch.Generator().manual_seed(3), np.random.default_rng(0)
    with fast_path.switched(compiled):
        assert policy.draws_compiled == compiled
        player = policy.player(64, deterministic=deterministic, generator=generator)
        found = [player(random.normal(0, 3, (64, 5)).astype(np.float32), random.random(64) < 0.1) for _ in range(40)]
    return np.stack(found), generator.get_state()


@pytest.mark.parametrize("deterministic", [False, True])
@pytest.mark.parametrize("settings", [{}, {"activation": "relu"}, {"frames": 3}, {"normalise": False}], ids=str)
@pytest.mark.parametrize("space", DISCRETE)
def test_options_and_draws_are_those_of_the_definition(space, settings, deterministic):
    policy = policy_for(space, **settings)
    expected, drawn = steps(policy, compiled=False, deterministic=deterministic)
    found, drawn_too = steps(policy, compiled=True, deterministic=deterministic)
    assert len(np.unique(expected)) == len(np.unique(found)) > 1
    np.testing.assert_array_equal(found, expected)
    assert found.dtype == expected.dtype and torch.equal(drawn, drawn_too)


def test_more_rows_than_compiled_loops_are_for_take_the_same_options(monkeypatch):
    policy = policy_for("uneven")
    expected, _ = steps(policy, compiled=True)
    monkeypatch.setattr(option_sampling, "MAX_ROWS", 63)
    monkeypatch.setattr(option_sampling, "draw_options", None)
    found, _ = steps(policy, compiled=True)
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(("space", "memory"), [("Box", 0), ("MultiDiscrete", 4)])
def test_numbers_and_recurrent_policies_are_not_drawn_compiled(space, memory):
    assert not Policy(5, actions_of(SPACES[space]), NetworkShape((16,), memory=memory)).draws_compiled


@pytest.mark.parametrize("observations", [0, 40])
def test_the_scaling_is_that_of_the_normaliser(observations):
    normaliser = Normaliser(3)
    normaliser.update(torch.randn(observations, 3, generator=torch.Generator().manual_seed(0)) * 0.1 + 2)
    x = torch.tensor([[0.0, 2.0, 900.0]])
    shift, scale, clip = normaliser.arrays()
    expected = np.clip((x.numpy() - shift) * scale, -clip, clip)
    np.testing.assert_array_equal(normaliser(x).numpy(), expected)
    assert (expected[0, 2] == 900) == (observations == 0)
