"""What on-policy algorithms share, by numbers."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch

from tests.algos import rollouts
from thalweg.algos import AlgorithmError
from thalweg.algos.interface import Rollout, Task
from thalweg.algos.onpolicy.agent import Agent
from thalweg.algos.onpolicy.samples import Samples, Signal
from thalweg.algos.ppo import PPOConfig

N, T, D = 2, 8, 3


def agent(critics: int = 2, **settings: Any) -> Agent:
    config = PPOConfig(hidden=(8,), **settings)
    return Agent("Some", critics, config, Task(D, gym.spaces.Discrete(3), N, 0, {"encoder": "mine"}))


def rollout(obs: torch.Tensor) -> Rollout:
    """Steps of which the last of each environment only reset it."""
    valid = torch.ones(T, N, dtype=torch.bool)
    valid[-1] = False
    return rollouts.rollout_of(obs, valid=valid)


def samples(one: Agent, steps: Rollout) -> Samples:
    return one.samples(steps, [Signal(steps.rewards, 0.9, 0.9), Signal(steps.costs[..., 0], 0.9, 0.9)])


def seen(one: Agent, steps: Rollout) -> torch.Tensor:
    """Normalised observations [B, D]."""
    inputs = samples(one, steps).inputs
    assert isinstance(inputs, torch.Tensor)
    return inputs


def observations(seed: int) -> torch.Tensor:
    return torch.randn(T + 1, N, D, generator=torch.Generator().manual_seed(seed)) * 3 + 1


def weights(module: torch.nn.Module) -> torch.Tensor:
    return torch.cat([value.detach().flatten() for value in module.parameters()])


def test_the_policy_says_where_it_comes_from():
    about = agent(adapter="box_scaled").policy.about
    assert about.algorithm == "Some" and about.context == {"encoder": "mine"}
    assert about.config["adapter"] == "box_scaled"


def test_the_first_rollout_is_seen_by_its_own_statistics_and_later_ones_by_those_that_acted():
    one, first, second = agent(), rollout(observations(1)), rollout(observations(2))
    now = seen(one, first)
    own = first.obs[:-1][first.valid]
    expected = (own - own.mean(0)) / own.std(0, correction=0)
    assert torch.allclose(now, expected.clamp(-5, 5), atol=1e-4)
    later = seen(one, second)
    expected = (second.obs[:-1][second.valid] - own.mean(0)) / own.std(0, correction=0)
    assert torch.allclose(later, expected.clamp(-5, 5), atol=1e-4)
    both = torch.cat([own, second.obs[:-1][second.valid]])
    assert one.policy.normaliser.count == len(both) == 2 * N * (T - 1)
    assert one.policy.normaliser.mean == pytest.approx(both.mean(0).numpy(), abs=1e-5)


def test_without_normalisation_observations_stay_as_they_are():
    one, steps = agent(normalise_observations=False), rollout(observations(1))
    assert torch.equal(seen(one, steps), steps.obs[:-1][steps.valid])


def test_a_long_gradient_is_shortened():
    one = agent(max_grad_norm=0.5)
    parameters = list(one.policy.actor.parameters())
    one.step(1e3 * sum((p.sum() for p in parameters), torch.zeros(())))
    lengths = [float(p.grad.norm()) for p in parameters if p.grad is not None]
    assert np.hypot.reduce(lengths) == pytest.approx(0.5, rel=1e-5)


def test_a_step_goes_down_at_the_policys_rate_and_leaves_the_critics():
    one = agent(learning_rate=0.01, critic_learning_rate=0.002)
    before = weights(one.policy.actor), weights(one.critics)
    loss = sum((p.sum() for p in [*one.policy.actor.parameters(), *one.critics.parameters()]), torch.zeros(()))
    told = one.step(loss)
    assert told == loss.detach() and not told.requires_grad
    # Adam's first step is as long as the rate, whatever the gradient.
    assert (weights(one.policy.actor) - before[0]).numpy() == pytest.approx(-0.01, rel=1e-3)
    assert torch.equal(weights(one.critics), before[1])


def test_critics_learn_beside_the_policy_as_they_would_after_it():
    """Whatever the policy does meanwhile: the same losses and weights, to the last bit."""
    both = [agent(2), agent(2)]
    for one, busy in zip(both, (False, True), strict=True):
        steps = rollout(observations(1))
        found = samples(one, steps)
        with one.critics_learning(found, 3):
            for _ in range(20 * busy):
                one.step(torch.stack([(p**2).sum() for p in one.policy.actor.parameters()]).sum())
    assert torch.equal(both[0].critic_losses(), both[1].critic_losses())
    assert torch.equal(weights(both[0].critics), weights(both[1].critics))
    assert not torch.equal(weights(both[0].policy.actor), weights(both[1].policy.actor))


def test_what_goes_wrong_with_the_critics_is_told():
    one, steps = agent(), rollout(observations(1))
    found = samples(one, steps)
    broken = type(found)(**{**vars(found), "targets": found.targets[:, :3]})
    with pytest.raises(IndexError), one.critics_learning(broken):
        pass


def test_the_gradient_before_is_forgotten():
    one = agent(max_grad_norm=1e9)
    parameters = list(one.policy.actor.parameters())
    for _ in range(2):
        one.step(sum((p.sum() for p in parameters), torch.zeros(())))
        assert all(p.grad is not None and torch.equal(p.grad, torch.ones_like(p)) for p in parameters)


@pytest.mark.parametrize(("linear", "expected"), [(True, 0.25e-3), (False, 1e-3)])
def test_only_the_policys_rate_falls(linear, expected):
    one = agent(learning_rate=1e-3, critic_learning_rate=5e-3, linear_decay=linear)
    assert one.decay(0.75) == pytest.approx(expected)
    assert [one.policy_optimiser.rate, one.critic_optimiser.rate] == pytest.approx([expected, 5e-3])


@pytest.mark.parametrize("memory", ["none", "gru"])
def test_everything_comes_back(memory: str):
    settings = {"memory": memory, "memory_size": 4, "adapter": "box_scaled"}
    one, other = agent(**settings), agent(**settings)
    steps = rollouts.rollout_of(observations(1), actions=torch.zeros(T, N, 1))
    samples(one, steps)
    one.step(weights_sum(one))
    never = np.zeros(N, dtype=bool)
    one.act(np.zeros((N, D), np.float32), never)
    other.load_state(one.state())
    for each in (one, other):
        each.step(weights_sum(each))
    assert torch.equal(weights(one.policy.actor), weights(other.policy.actor))
    assert torch.equal(weights(one.critics), weights(other.critics))
    obs = observations(3)[0].numpy()
    for _ in range(5):
        assert torch.equal(one.act(obs, never), other.act(obs, never))
    assert np.array_equal(one.policy.normaliser.mean, other.policy.normaliser.mean)


def weights_sum(one: Agent) -> torch.Tensor:
    parameters = [*one.policy.actor.parameters(), *one.critics.parameters()]
    return sum(((p**2).sum() for p in parameters), torch.zeros(()))


def test_the_state_of_another_number_of_critics_is_refused():
    with pytest.raises(AlgorithmError, match="a network of shapes"):
        agent(1).load_state(agent(2).state())


def test_with_a_memory_what_acts_and_what_is_learnt_from_are_in_the_same_state():
    one, never = agent(memory="gru", memory_size=4, sequence=3), np.zeros(N, dtype=bool)
    assert one._memory is not None and one._player.hidden is not None
    for number in range(3):  # the first rollout is seen by no statistics when acting, by its own when learning
        steps = rollout(observations(number))
        for obs in steps.obs[:-1].numpy():
            one.act(obs, never)
        acted = one._player.hidden.clone()
        samples(one, steps)
        if number:
            assert torch.allclose(one._memory.starts["actor"], acted, atol=1e-6)
        assert torch.allclose(one._memory.starts["actor"], one._player.hidden, atol=1e-6)
