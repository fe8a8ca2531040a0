"""Tests of SafeLOOP: losses and terminal values against values by hand and enumeration, and weights of candidates."""

import copy
import dataclasses
import itertools

import gymnasium as gym
import numpy as np
import pytest
import torch

from tests.algos.planning.planning_fixtures import BOX, OPTIONS, generator
from thalweg.algos.maths import planning
from thalweg.algos.planning.imagined_rollouts import PlanOutcomes
from thalweg.algos.planning.planner import Budget
from thalweg.algos.planning.safeloop import SafeARC, SafeLOOPConfig, actor_loss
from thalweg.algos.planning.soft_actor_critic import ContinuousSoftActorCritic
from thalweg.algos.policy.actions import Adapter, actions_of
from thalweg.algos.policy.distributions import LOG_STD_RANGE
from thalweg.algos.policy.mlp import StackedMLP

F64 = torch.float64


def method_for(space: gym.Space = OPTIONS, adapter: Adapter = "native", **settings) -> SafeARC:
    made = SafeARC(
        SafeLOOPConfig(hidden=(8,), **settings),
        actions_of(space, adapter, "squashed"),
        3,
        lambda: torch.tensor(2.0),
        generator(),
    )
    for parameter in made.modules.parameters():
        parameter.data += 0.5 * torch.randn(parameter.shape, generator=generator(1))
    return made


def test_actor_loss_equals_hand_computed_value():
    found = actor_loss(torch.tensor([1.0, 2.0]), torch.tensor([0.3, 0.5]), torch.tensor(0.2))
    assert float(found) == pytest.approx(-(1 + 0.06 + 2 + 0.1) / 2)


@torch.no_grad()
def test_discrete_terminal_value_is_the_sum_over_all_actions():
    method, obs = method_for(), torch.randn(4, 3, generator=generator(2))
    log_p = method.soft._policy(obs).log_p  # pyright: ignore
    critics = method.soft.critics.reference(obs)
    value = method.value()
    assert value is not None
    found = value(obs, torch.zeros(4, 2, dtype=torch.int64))
    for row in range(4):
        total = 0.0
        for number, (first, second) in enumerate(itertools.product(range(3), range(2))):
            probability = float((log_p[row, 0, first] + log_p[row, 1, second]).exp())
            total += probability * float(critics[:, row, number].min())
        assert float(found[row]) == pytest.approx(2.0 * total, rel=1e-5)  # in units of a reward of deviation 2


@torch.no_grad()
def test_stale_action_value_uses_the_previous_action():
    method, obs = method_for(stale_action_value=True), torch.randn(1, 3, generator=generator(2))
    value = method.value()
    assert value is not None
    found = value(obs, torch.tensor([[2, 1]]))
    assert float(found) == pytest.approx(2.0 * float(method.soft.critics.reference(obs)[:, 0, 5].min()), rel=1e-5)


@torch.no_grad()
def test_soft_value_of_the_next_state_equals_hand_computed_value():
    method, obs = method_for(), torch.randn(3, 3, generator=generator(2))
    soft, alpha = method.soft, torch.tensor(0.3)
    found = soft.next_values(soft.critics, obs, alpha, generator())
    log_p = soft._policy(obs).log_p  # pyright: ignore
    joint = (log_p[:, 0, :, None] + log_p[:, 1, None, :2]).flatten(1)
    wanted = (joint.exp() * (soft.critics.reference(obs).amin(0) - alpha * joint)).sum(-1)
    assert torch.allclose(found, wanted, atol=1e-5)


@torch.no_grad()
def test_continuous_terminal_value_uses_the_actors_mode():
    method, obs = method_for(BOX), torch.randn(3, 3, generator=generator(2))
    middle = method.soft.actor(obs).chunk(2, -1)[0].tanh()
    wanted = method.soft.critics.reference(torch.cat([obs, middle], -1)).squeeze(-1).amin(0)
    assert torch.allclose(method.soft.value(obs), wanted, atol=1e-6)


def sampled(soft: ContinuousSoftActorCritic, obs: torch.Tensor) -> tuple[np.ndarray, np.ndarray]:
    """Actions [R, 2] of the actor by the noise of `generator()`, and their log-densities [R]."""
    mean, log_std = np.split(soft.actor(obs).detach().double().numpy(), 2, axis=-1)
    log_std = log_std.clip(*LOG_STD_RANGE)
    noise = torch.randn(mean.shape, generator=generator()).double().numpy()
    actions = np.tanh(mean + np.exp(log_std) * noise)
    log_density = -0.5 * noise**2 - log_std - 0.5 * np.log(2 * np.pi) - np.log(1 - actions**2)
    return actions, log_density.sum(-1)


def least_value(critics: StackedMLP, obs: torch.Tensor, actions: np.ndarray) -> np.ndarray:
    """The smaller of the values [R] that two critics give to actions [R, 2]."""
    pairs = torch.cat([obs, torch.from_numpy(actions).float()], -1)
    return critics.reference(pairs).squeeze(-1).detach().double().numpy().min(0)


def middles(actions: np.ndarray) -> np.ndarray:
    """The numbers that three and two options stand for, -1, 0, 1 and -1, 1, to which actions [R, 2] are nearest."""
    return np.stack([np.round(actions[:, 0]), np.sign(actions[:, 1])], -1)


def continuous(space: gym.Space = OPTIONS, adapter: Adapter = "box_scaled") -> ContinuousSoftActorCritic:
    soft = method_for(space, adapter).soft
    assert isinstance(soft, ContinuousSoftActorCritic)
    return soft


@pytest.mark.parametrize(("space", "adapter"), [(BOX, "native"), (OPTIONS, "box_scaled")], ids=["box", "options"])
def test_a_continuous_value_of_the_next_state_is_that_of_one_executed_action(space: gym.Space, adapter: Adapter):
    soft, obs = continuous(space, adapter), torch.randn(40, 3, generator=generator(2))
    slow = copy.deepcopy(soft.critics)
    slow.flat.data += 0.3 * torch.randn(slow.flat.shape, generator=generator(3))
    found = soft.next_values(slow, obs, torch.tensor(0.3), generator())
    actions, log_density = sampled(soft, obs)
    executed = actions if adapter == "native" else middles(actions)
    assert found.detach().numpy() == pytest.approx(least_value(slow, obs, executed) - 0.3 * log_density, abs=1e-4)


def test_continuous_critics_learn_the_values_of_executed_actions():
    soft, obs = continuous(), torch.randn(40, 3, generator=generator(2))
    raw = 2.0 * torch.rand(40, 2, generator=generator(3)) - 1.0
    pairs = torch.cat([obs, torch.from_numpy(middles(raw.numpy())).float()], -1)
    torch.testing.assert_close(soft.q_values(obs, raw), soft.critics.reference(pairs).squeeze(-1), rtol=0, atol=1e-5)


def test_a_continuous_actor_raises_value_and_entropy_of_its_own_action():
    soft, obs = continuous(), torch.randn(40, 3, generator=generator(2))
    values, entropy = soft.objective(obs, generator())
    actions, log_density = sampled(soft, obs)
    assert values.detach().numpy() == pytest.approx(least_value(soft.critics, obs, actions), abs=1e-4)
    assert entropy.detach().numpy() == pytest.approx(-log_density, abs=1e-4)
    actor_loss(values, entropy, torch.tensor(0.3)).backward()
    gradients = [each.grad for each in (soft.actor.stack.flat, soft.critics.flat)]
    assert gradients[0] is not None and gradients[0].abs().max() > 0 and gradients[1] is None


def outcomes() -> PlanOutcomes:
    returns = torch.tensor([[3.0, 1.0, 2.0, 9.0]])
    return PlanOutcomes(returns, returns, torch.tensor([[0.1, 0.1, 0.1, 0.9]]).unsqueeze(-1))


def test_weights_do_not_depend_on_the_size_of_returns():
    method, budget = method_for(elites=2, samples=4), Budget(torch.tensor([0.5]), 10.0)
    weights = method.weights(outcomes(), budget)
    larger = dataclasses.replace(outcomes(), returns=100 * outcomes().returns)
    assert torch.allclose(method.weights(larger, budget), weights, atol=1e-5)
    deviation = (2 / 3) ** 0.5
    wanted = (2.0 * torch.tensor([1.0, -1.0, 0.0]) / deviation).softmax(-1)
    assert weights[0].tolist() == pytest.approx([*wanted.tolist(), 0], abs=1e-5)


def test_exceeded_tight_cost_outweighs_loose_cost_within_its_budget():
    """Of three candidates, of which fewer than E are feasible: 2, 0.5 and 0.2 tight budgets, 0.2, 0.9 and 1.2 loose."""
    costs = torch.tensor([[[0.02, 0.2], [0.005, 0.9], [0.002, 1.2]]])
    returns, budget = torch.zeros(1, 3), Budget(torch.tensor([0.01, 1.0]), 10.0)
    method = method_for(elites=2, samples=3, cost_limits=(0.1, 10.0))
    weights = method.weights(PlanOutcomes(returns, returns, costs), budget)
    total = torch.tensor([2.2, 1.4, 1.4])
    wanted = (-4.0 * (total - total.mean()) / total.std(correction=0)).softmax(-1)
    assert weights[0].tolist() == pytest.approx(wanted.tolist(), abs=1e-4)


def test_budget_of_a_single_cost_only_decides_feasibility():
    method, costs = method_for(elites=2, samples=4), outcomes().costs + torch.tensor([0.0, 0.1, 0.2, 0.3]).view(1, 4, 1)
    found = [
        method.weights(dataclasses.replace(outcomes(), costs=costs), Budget(torch.tensor([b]), 10.0))
        for b in (0.01, 0.07)
    ]
    wanted = -4.0 * planning.standardised_rows(costs.squeeze(-1), torch.ones(1, 4, dtype=torch.bool))
    assert torch.equal(found[0], found[1]) and torch.equal(found[0], wanted.softmax(-1))


def test_without_standardising_temperatures_multiply_sums_over_an_episode():
    method = method_for(elites=2, samples=4, standardise_returns=False, sharpness=0.1, cost_sharpness=0.5)
    weights = method.weights(outcomes(), Budget(torch.tensor([0.5]), 10.0))
    assert weights[0, :3].tolist() == pytest.approx(torch.tensor([3.0, 1.0, 2.0]).softmax(-1).tolist())
    none = method.weights(outcomes(), Budget(torch.tensor([0.01]), 10.0))
    assert none[0].tolist() == pytest.approx(torch.tensor([-0.5, -0.5, -0.5, -4.5]).softmax(-1).tolist())
