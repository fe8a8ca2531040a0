"""Tests of the actions of deterministic policies: their encoding, gradients and exploration."""

import gymnasium as gym
import numpy as np
import pytest
import torch

from thalweg.algos.maths import gumbel_softmax
from thalweg.algos.offpolicy.ddpglag import DDPGLagConfig
from thalweg.algos.offpolicy.deterministic import (
    ContinuousActions,
    DeterministicConfig,
    DiscreteActions,
    policy_grads,
    policy_loss,
)
from thalweg.algos.policy.actions import actions_of

MANY = 20_000
UNEVEN = gym.spaces.MultiDiscrete([3, 2])


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def continuous(adapter: str = "native", **settings) -> ContinuousActions:
    space = gym.spaces.Box(-2.0, 2.0, (2,), np.float32) if adapter == "native" else gym.spaces.MultiDiscrete([3, 3])
    return ContinuousActions(actions_of(space, adapter, "point"), DeterministicConfig(**settings))  # pyright: ignore


def discrete(**settings) -> DiscreteActions:
    return DiscreteActions(actions_of(UNEVEN), DeterministicConfig(**settings))


def test_scaled_numbers_are_encoded_as_the_middle_of_their_bin():
    raw = torch.tensor([[-1.0, -0.51], [-0.49, 0.49], [0.51, 1.0]])
    assert continuous("box_scaled").encode(raw).tolist() == [[-1.0, -1.0], [0.0, 0.0], [1.0, 1.0]]


@pytest.mark.parametrize("adapter", ["native", "box_literal"])
def test_other_numbers_are_encoded_unchanged(adapter: str):
    raw = torch.tensor([[-1.0, -0.3], [0.2, 0.7]])
    assert torch.equal(continuous(adapter).encode(raw), raw)


def test_the_greedy_action_is_encoded_as_executed():
    outputs = torch.tensor([[0.2, 5.0]])  # tanh: 0.197, 1.0
    assert continuous("box_scaled").greedy(outputs).tolist() == [[0.0, 1.0]]
    assert continuous("native").greedy(outputs).flatten().tolist() == pytest.approx([0.19738, 0.99991], abs=1e-5)


def test_discrete_actions_are_encoded_as_one_hot_vectors():
    assert discrete().width == 6
    assert discrete().encode(torch.tensor([[2, 1], [0, 0]])).tolist() == [[0, 0, 1, 0, 1, 0], [1, 0, 0, 1, 0, 0]]
    assert discrete().greedy(torch.tensor([[0.0, 3.0, 1.0, 2.0, 1.0]])).tolist() == [[0, 1, 0, 1, 0, 0]]


def test_a_continuous_action_has_the_gradient_of_tanh():
    point, backward = continuous("box_scaled").rsample_and_backward(torch.tensor([[0.5, -1.0]]), generator())
    assert point.flatten().tolist() == pytest.approx(np.tanh([0.5, -1.0]))
    found = backward(torch.tensor([[1.0, 3.0]])).flatten().tolist()
    assert found == pytest.approx([1 - np.tanh(0.5) ** 2, 3 - 3 * np.tanh(1.0) ** 2])


def test_a_discrete_action_has_the_gradient_of_the_softmax_at_its_temperature():
    logits, weight = torch.randn(7, 5, generator=generator(1)), torch.randn(7, 6, generator=generator(2))
    gradients = []
    for relaxation in (0.5, 2.0):
        drawn, backward = discrete(relaxation=relaxation).rsample_and_backward(logits, generator())
        assert torch.equal(drawn.view(7, 2, 3).sum(-1), torch.ones(7, 2))
        found = backward(weight)
        again = logits.clone().requires_grad_()
        log_p = torch.stack([again[:, :3].log_softmax(-1), torch.cat([again[:, 3:].log_softmax(-1)] * 2, 1)[:, :3]], 1)
        absent = torch.tensor([[False] * 3, [False, False, True]])
        noise = gumbel_softmax.gumbel(torch.rand(7, 2, 3, generator=generator()))
        soft = ((log_p.masked_fill(absent, -1e9) + noise) / relaxation).softmax(-1)
        (soft.flatten(1) * weight).sum().backward()
        assert again.grad is not None and torch.allclose(found, again.grad, atol=1e-6)
        gradients.append(found)
    assert not torch.allclose(*gradients, atol=1e-3)


def test_policy_grads_equal_autograd():
    values, outputs = torch.randn(3, 7, generator=generator(1)), torch.randn(7, 5, generator=generator(2))
    config = DDPGLagConfig(output_decay=0.2)
    found = policy_grads(config, values, outputs, (2.0, 0.5))
    leaves = values.requires_grad_(), outputs.requires_grad_()
    policy_loss(config, *leaves, (2.0, 0.5)).backward()
    for grad, leaf in zip(found, leaves, strict=True):
        assert leaf.grad is not None and torch.allclose(grad, leaf.grad, atol=1e-7)


def test_a_smoothed_continuous_action_stays_within_clip_and_bounds():
    outputs = torch.tensor([[0.0, 10.0]]).expand(MANY, 2)
    found = continuous().smoothed(outputs, generator(), noise=0.2, clip=0.3, temperature=9.0)
    assert found[:, 0].std() == pytest.approx(0.17, abs=0.01)  # a normal of 0.2 cut off at 0.3
    assert found[:, 0].abs().max() <= 0.3 + 1e-6 and found[:, 0].mean().abs() < 0.01
    assert found[:, 1].min() >= 0.7 - 1e-6 and found[:, 1].max() == 1.0


def test_a_smoothed_discrete_action_is_sampled_at_the_temperature():
    p = torch.tensor([[0.25, 0.75, 0.0, 0.5, 0.5]]).clamp(min=1e-12).log().expand(MANY, 5)
    found = discrete().smoothed(p, generator(), noise=9.0, clip=0.0, temperature=0.5).mean(0)
    # p² normed: 1/16 : 9/16
    assert found.tolist() == pytest.approx([0.1, 0.9, 0.0, 0.5, 0.5, 0.0], abs=0.015)
    assert torch.equal(discrete().smoothed(p, generator(), noise=9.0, clip=0.0, temperature=0.0), discrete().greedy(p))


def test_continuous_actions_explore_by_noise_and_uniform_actions():
    outputs = torch.zeros(MANY, 2)
    still = continuous(exploration=0.0, exploration_noise=0.0).explore(outputs, generator())
    assert torch.equal(still, torch.zeros(MANY, 2))
    noisy = continuous(exploration=0.0, exploration_noise=0.3).explore(outputs, generator())
    assert noisy.std() == pytest.approx(0.3, abs=0.01)
    rare = continuous(exploration=0.2, exploration_noise=0.0).explore(outputs, generator())
    elsewhere = (rare != 0).all(1)
    assert elsewhere.float().mean() == pytest.approx(0.2, abs=0.01)
    assert torch.equal(elsewhere, (rare != 0).any(1))  # a whole action at a time
    assert rare[elsewhere].std() == pytest.approx(1 / np.sqrt(3), abs=0.02)
    far = continuous(exploration=0.0, exploration_noise=0.3).explore(outputs + 9.0, generator())
    assert far.max() == 1.0 and far.min() >= -1.0


def test_discrete_actions_explore_by_temperature_and_uniform_actions():
    p = torch.tensor([[0.25, 0.75, 1e-12, 0.5, 0.5]]).log().expand(MANY, 5)
    drawn = discrete(exploration=0.0, exploration_temperature=0.5).explore(p, generator())
    assert (drawn[:, 0] == 1).float().mean() == pytest.approx(0.9, abs=0.01)
    certain = torch.tensor([[99.0, 0.0, 0.0, 99.0, 0.0]]).expand(MANY, 5)
    assert (discrete().explore(p, generator(), 0.0)[:, 0] == 1).all()
    mixed = discrete(exploration=0.3).explore(certain, generator())
    assert (mixed[:, 0] != 0).float().mean() == pytest.approx(0.3 * 2 / 3, abs=0.01)
    assert (mixed[:, 1] != 0).float().mean() == pytest.approx(0.3 / 2, abs=0.01)


def test_uniform_actions_reach_everything_alike():
    drawn = discrete().actions.uniform(MANY, generator())
    assert [(drawn[:, 0] == k).float().mean().item() for k in range(3)] == pytest.approx([1 / 3] * 3, abs=0.015)
    assert [(drawn[:, 1] == k).float().mean().item() for k in range(2)] == pytest.approx([1 / 2] * 2, abs=0.015)
    spread = continuous().actions.uniform(MANY, generator())
    assert spread.min() < -0.99 and spread.max() > 0.99 and abs(float(spread.mean())) < 0.01


def test_exploration_fades_over_the_run_only_if_told():
    for fades, expected in ((True, [1.0, 0.75, 0.0]), (False, [1.0, 1.0, 1.0])):
        config = DeterministicConfig(exploration_fades=fades)
        assert [config.exploration_at(progress) for progress in (0.0, 0.25, 1.0)] == expected
