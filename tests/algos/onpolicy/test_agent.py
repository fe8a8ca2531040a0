"""Tests of the code that on-policy algorithms share, by numbers."""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch

from tests.algos import rollouts
from thalweg.algos import ALGORITHMS, AlgorithmError
from thalweg.algos.interface import Rollout, Task
from thalweg.algos.onpolicy.agent import Agent, cost_signals, reward_signal
from thalweg.algos.onpolicy.kl_monitor import KLMonitor
from thalweg.algos.onpolicy.ppo import PPOConfig
from thalweg.algos.onpolicy.rollout_samples import Samples, Signal

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


def test_the_reward_and_each_cost_have_settings_of_their_own():
    config = ALGORITHMS["P3O"].configure({"discount": 0.9, "trace": 0.8, "cost_discount": 0.7, "cost_trace": 0.6})
    steps = rollouts.rollout_of(observations(1), costs=torch.stack([torch.ones(T, N), torch.zeros(T, N)], -1))
    paid, *costs = reward_signal(config, steps), *cost_signals(config, steps)
    assert (paid.discount, paid.trace) == (0.9, 0.8) and torch.equal(paid.values, steps.rewards)
    assert [(cost.discount, cost.trace) for cost in costs] == [(0.7, 0.6)] * 2
    assert [float(cost.values.mean()) for cost in costs] == [1.0, 0.0]


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


@pytest.mark.parametrize(
    ("settings", "scale"),
    [({"initial": "orthogonal"}, 1.0), ({"initial": "kaiming"}, 1.0), ({"activation": "relu"}, 1000.0)],
    ids=str,
)
def test_the_first_rollout_is_learnt_from_the_policy_that_acted(settings: dict[str, Any], scale: float):
    """Where an untrained policy already prefers something, observations are seen as acting saw them."""
    one, obs, never = agent(**settings), scale * observations(1), torch.zeros(N, dtype=torch.bool)
    acted = one.policy.distribution(obs[:-1].flatten(0, 1))
    assert torch.equal(one.act(obs[0], never) >= 0, torch.ones(N, 1, dtype=torch.bool))
    learnt = one.policy.distribution_of(samples(one, rollouts.rollout_of(obs)).inputs)
    assert float(acted.kl(learnt).detach().max()) < 1e-3
    assert one.policy.normaliser.count == N * T


def test_without_normalisation_observations_stay_as_they_are():
    one, steps = agent(normalise_observations=False), rollout(observations(1))
    assert torch.equal(seen(one, steps), steps.obs[:-1][steps.valid])


def loss_of(found: Samples) -> Callable[[Any], torch.Tensor]:
    """What the policy says of the actions taken, and how sure it is."""
    return lambda new: new.log_prob(found.actions).square().mean() - 0.3 * new.entropy().mean()


def gradients(one: Agent) -> torch.Tensor:
    return torch.cat([p.grad.flatten() for p in one.policy.actor.parameters() if p.grad is not None])


SPACES = {
    "Discrete": gym.spaces.Discrete(3),
    "MultiDiscrete": gym.spaces.MultiDiscrete([3, 2]),
    "Box": gym.spaces.Box(-1.0, 1.0, (2,), np.float32),
}


@pytest.mark.parametrize("settings", [{}, {"hidden": (200,)}, {"memory": "gru", "memory_size": 4}], ids=str)
@pytest.mark.parametrize("space", list(SPACES))
def test_the_gradient_of_a_step_is_the_one_that_torch_records(space: str, settings: dict[str, Any]):
    config = PPOConfig(**({"hidden": (8,), "max_grad_norm": 1e9} | settings))
    one = Agent("Some", 2, config, Task(D, SPACES[space], N, 0, {}))
    actions = torch.stack([one.act(obs, torch.zeros(N, dtype=torch.bool)) for obs in observations(2)[:-1]])
    found = samples(one, rollouts.rollout_of(observations(1), actions=actions))
    old = one.policy.actions.distribution(torch.randn(T * N, one.policy.actor(found.inputs).shape[1]))

    def loss(new: Any) -> torch.Tensor:
        return loss_of(found)(new) + (new.kl(old) * torch.arange(T * N)).sum()

    loss(one.policy.distribution_of(found.inputs)).backward()
    expected = gradients(one)
    measured = one.step(found.inputs, loss)
    assert torch.allclose(gradients(one), expected, rtol=1e-3, atol=1e-4) and expected.abs().max() > 1.0
    assert not measured.requires_grad


def test_a_long_gradient_is_shortened():
    one = agent(max_grad_norm=0.5)
    found = samples(one, rollout(observations(1)))
    one.step(found.inputs, lambda new: 1e3 * new.log_prob(found.actions).sum())
    assert float(gradients(one).norm()) == pytest.approx(0.5, rel=1e-5)


def test_a_step_goes_down_at_the_policys_rate_and_leaves_the_critics():
    one = agent(learning_rate=0.01, critic_learning_rate=0.002)
    found = samples(one, rollout(observations(1)))
    before = weights(one.policy.actor), weights(one.critics)
    measured = one.step(found.inputs, lambda new: new.log_prob(found.actions).mean())
    assert float(measured) == pytest.approx(-np.log(3), abs=0.1)
    # Adam's first step is as long as the rate, whatever the gradient.
    felt = gradients(one).abs() > 1e-4
    moved = (weights(one.policy.actor) - before[0])[felt]
    assert moved.numpy() == pytest.approx(-0.01 * gradients(one)[felt].sign().numpy(), rel=1e-3) and len(moved) > 10
    assert torch.equal(weights(one.critics), before[1])


def test_critics_learn_beside_the_policy_as_they_would_after_it():
    """Whatever the policy does meanwhile: the same losses and weights, to the last bit."""
    both = [agent(2), agent(2)]
    for one, busy in zip(both, (False, True), strict=True):
        found = samples(one, rollout(observations(1)))
        with one.critics_learning(found, 3):
            for _ in range(20 * busy):
                one.step(found.inputs, loss_of(found))
    assert torch.equal(both[0].critic_losses(), both[1].critic_losses())
    assert torch.equal(weights(both[0].critics), weights(both[1].critics))
    assert not torch.equal(weights(both[0].policy.actor), weights(both[1].policy.actor))


def test_an_error_in_the_thread_of_the_critics_is_raised():
    one, steps = agent(), rollout(observations(1))
    found = samples(one, steps)
    broken = type(found)(**{**vars(found), "targets": found.targets[:, :3]})
    with pytest.raises(IndexError), one.critics_learning(broken):
        pass


@pytest.mark.parametrize("memory", ["none", "gru"])
def test_the_gradient_before_is_forgotten(memory: str):
    one = agent(max_grad_norm=1e9, learning_rate=0.0, memory=memory, memory_size=4)
    found = samples(one, rollout(observations(1)))
    one.step(found.inputs, loss_of(found))
    first = gradients(one).clone()
    one.step(found.inputs, loss_of(found))
    assert torch.equal(gradients(one), first) and first.any()


@pytest.mark.parametrize("settings", [{}, {"activation": "relu"}, {"hidden": (130,)}], ids=str)
def test_critics_go_through_the_samples_as_torch_and_adam_would(settings: dict[str, Any]):
    """Also where the loops do it: `regress` and Adam of torch, step by step."""
    config = PPOConfig(**({"hidden": (8,), "minibatch": 5, "critic_decay": 0.01, "max_grad_norm": 0.05} | settings))
    both = [Agent("Some", 2, config, Task(D, gym.spaces.Discrete(3), N, 0, {})) for _ in range(2)]
    one, other = both
    found, _ = (samples(each, rollout(observations(1))) for each in both)
    with one.critics_learning(found, 4):
        pass
    measured = []
    for _ in range(4):
        for inputs, (targets,) in found.minibatches((found.targets.T,), 5, other._critic_generator):
            values = other.critics.stack.reference(inputs).squeeze(-1)  # pyright: ignore[reportArgumentType]
            errors = 0.5 * (values - targets.T).square().mean(-1)
            other.critic_optimiser.zero_grad()
            (errors.sum() + 0.01 * other.critics.stack.flat.square().sum()).backward()
            other.critic_optimiser.step(0.05)
            measured.append(errors.detach())
    assert torch.allclose(one.critic_losses(), torch.stack(measured).mean(0), rtol=1e-4)
    assert torch.allclose(weights(one.critics), weights(other.critics), atol=2e-5)
    states = [each.critic_optimiser.state()["0"] for each in both]
    assert states[0]["count"] == states[1]["count"] == 4 * 3
    assert states[0]["second"] == pytest.approx(states[1]["second"], rel=1e-2, abs=1e-9)


@pytest.mark.parametrize(("linear", "expected"), [(True, 0.25e-3), (False, 1e-3)])
def test_only_the_policys_rate_falls(linear, expected):
    one = agent(learning_rate=1e-3, critic_learning_rate=5e-3, linear_decay=linear)
    assert one.decay(0.75) == pytest.approx(expected)
    assert [one.policy_optimiser.rate, one.critic_optimiser.rate] == pytest.approx([expected, 5e-3])


@pytest.mark.parametrize("memory", ["none", "gru"])
def test_everything_comes_back(memory: str):
    settings = {"memory": memory, "memory_size": 4, "adapter": "box_scaled"}
    one, other = agent(**settings), agent(**settings)
    found = samples(one, rollouts.rollout_of(observations(1), actions=torch.zeros(T, N, 1)))

    def learn(each: Agent) -> None:
        with each.critics_learning(found):
            each.step(found.inputs, loss_of(found))

    learn(one)
    never = torch.zeros(N, dtype=torch.bool)
    one.act(torch.zeros(N, D), never)
    other.load_state(one.state())
    for each in (one, other):
        learn(each)
    assert torch.equal(weights(one.policy.actor), weights(other.policy.actor))
    assert torch.equal(weights(one.critics), weights(other.critics))
    obs = observations(3)[0]
    for _ in range(5):
        assert torch.equal(one.act(obs, never), other.act(obs, never))
    assert torch.equal(one.policy.normaliser.mean, other.policy.normaliser.mean)


def test_the_state_of_another_number_of_critics_is_refused():
    with pytest.raises(AlgorithmError, match=r"stack.flat has the shape .41,. here and .82,. in what is loaded"):
        agent(1).load_state(agent(2).state())


def test_with_a_memory_what_acts_and_what_is_learnt_from_are_in_the_same_state():
    one, never = agent(memory="gru", memory_size=4, sequence=3), torch.zeros(N, dtype=torch.bool)
    assert one._memory is not None and one._player.hidden is not None
    for number in range(3):  # the first rollout is seen by no statistics when acting, by its own when learning
        steps = rollout(observations(number))
        for obs in steps.obs[:-1]:
            one.act(obs, never)
        acted = one._player.hidden.clone()
        samples(one, steps)
        if number:
            assert torch.allclose(one._memory.starts["actor"], acted, atol=1e-6)
        assert torch.allclose(one._memory.starts["actor"], one._player.hidden, atol=1e-6)


def test_the_clip_fraction_is_the_share_of_ratios_outside_the_range():
    one = agent()
    monitor = KLMonitor(one, samples(one, rollout(observations(1))))
    ratio = torch.ones_like(monitor.old_log_prob)
    ratio[:3] = torch.tensor([1.3, 0.7, 1.1])
    monitor.log_prob = monitor.old_log_prob + ratio.log()
    assert monitor.clip_fraction(0.2) == pytest.approx(2 / len(ratio))
