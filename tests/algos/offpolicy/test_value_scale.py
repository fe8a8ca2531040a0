"""Tests of the units and bounds of critics' values."""

import dataclasses
from typing import Any

import numpy as np
import pytest
import torch

from tests.algos import rollouts
from tests.algos.offpolicy.learners import NAMES, SPACES, D, N, T, batch_of, learner_for, rollout_of
from tests.algos.rollouts import feedback
from thalweg.algos import AlgorithmError
from thalweg.algos.offpolicy.ddpglag import DDPGLagConfig
from thalweg.algos.offpolicy.value_scale import LEAST_UNIT, ValueScale

CPU = torch.device("cpu")


def scale_of(rewards: list[float], costs: list[float], **settings: Any) -> ValueScale:
    """The scale after one episode of one environment, without discounts."""
    given: dict[str, Any] = {"discount": 1.0, "cost_discount": 1.0} | settings
    scale = ValueScale(DDPGLagConfig(**given), 1, 1, CPU)
    obs = torch.zeros(len(rewards) + 1, 1, 1)
    ends = torch.zeros(len(rewards), 1, dtype=torch.bool)
    ends[-1] = True
    fields: dict[str, Any] = {"obs": obs, "rewards": torch.tensor(rewards)[:, None], "terminated": ends}
    scale.update(rollouts.rollout_of(**fields), torch.tensor(costs)[:, None, None])
    return scale


def test_units_are_the_deviation_of_returns_and_the_largest_cost_of_a_step():
    scale = scale_of([1.0, 1.0, 1.0], [0.0, 0.25, 0.5])
    assert scale.units[:, 0].tolist() == pytest.approx([(2 / 3) ** 0.5, 0.5])  # returns 3, 2, 1
    assert scale.scaled(torch.tensor([[2.0], [1.0]]))[:, 0].tolist() == pytest.approx([2.0 / (2 / 3) ** 0.5, 2.0])


def test_the_unit_of_a_cost_may_be_its_limit_where_that_is_greater():
    dense = {"cost_scale": "limit", "cost_limit": 4.0}
    scale = scale_of([1.0, 1.0, 1.0], [0.0, 0.25, 0.5], **dense)
    assert scale.units[:, 0].tolist() == pytest.approx([(2 / 3) ** 0.5, 4.0])
    assert float(scale.scaled(torch.tensor([[2.0], [1.0]]))[1, 0]) == 0.25
    assert float(scale_of([1.0], [5.0], **dense).units[1]) == 5.0


def test_each_cost_has_the_unit_of_its_own_limit():
    scale = ValueScale(DDPGLagConfig(cost_scale="limit", cost_limits=(0.1, 7.0)), 2, 1, CPU)
    fields: dict[str, Any] = {"obs": torch.zeros(2, 1, 1), "rewards": torch.ones(1, 1)}
    scale.update(rollouts.rollout_of(**fields, terminated=torch.ones(1, 1, dtype=torch.bool)), torch.ones(1, 1, 2))
    assert scale.units[1:, 0].tolist() == [1.0, 7.0]


def test_no_return_exceeds_ten_units():
    scale = scale_of([0.0] * 9999 + [1.0], [0.0] * 10_000, discount=0.0)  # deviation 0.01
    assert float(scale.units[0]) == pytest.approx(LEAST_UNIT)


def test_units_are_one_before_an_episode_has_finished_and_where_nothing_is_paid():
    empty = ValueScale(DDPGLagConfig(), 1, 1, CPU)
    assert empty.units.tolist() == [[1.0], [1.0]]
    assert scale_of([0.0, 0.0], [0.0, 0.0]).units.tolist() == [[1.0], [1.0]]
    off = scale_of([1.0, 5.0], [0.0, 1.0], scale_returns=False)
    assert off.units.tolist() == [[1.0], [1.0]] and torch.equal(off.scaled(torch.ones(2, 3)), torch.ones(2, 3))


def test_targets_are_held_within_the_widened_extremes():
    scale = scale_of([1.0, 1.0, 2.0], [0.0, 0.0, 1.0], scale_returns=False, bound_margin=0.25)
    wild = torch.tensor([[99.0, -99.0, 3.0], [99.0, -99.0, 0.5]])
    # returns 4, 3, 2 and 0: a quarter of 4 more on either side; costs 0..1
    assert scale.bounded(wild).tolist() == [[5.0, -1.0, 3.0], [1.25, -0.25, 0.5]]
    assert scale.bounded(wild, 0.5, torch.tensor(2.0)).tolist() == [[7.0, -1.5, 3.0], [1.25, -0.25, 0.5]]
    free = scale_of([1.0], [0.0], bound_targets=False)
    assert torch.equal(free.bounded(wild), wild)


def test_bounds_hold_in_units():
    scale = scale_of([1.0, 1.0, 1.0], [0.0, 0.0, 0.0], bound_margin=0.0)
    unit = (2 / 3) ** 0.5
    found = scale.bounded(torch.tensor([[99.0, -99.0], [0.0, 0.0]]))
    assert found[0].tolist() == pytest.approx([3.0 / unit, 0.0])


def test_nothing_is_held_before_an_episode_has_finished():
    wild = torch.tensor([[99.0], [-99.0]])
    assert torch.equal(ValueScale(DDPGLagConfig(), 1, 1, CPU).bounded(wild), wild)


def test_bounds_of_the_settings_take_the_place_of_learnt_ones():
    scale = scale_of([9.0], [9.0], scale_returns=False, return_bounds=[-1.0, 3.0], largest_costs=[0.5])
    wild = torch.tensor([[99.0, -99.0], [99.0, -99.0]])
    assert scale.bounded(wild).tolist() == [[3.0, -1.0], [0.5, 0.0]]


def test_a_warning_names_a_mean_value_that_no_episode_can_pay_or_cost():
    scale = scale_of([1.0, 1.0, 2.0], [0.0, 0.0, 1.0], bound_margin=0.25, bound_targets=False)
    assert scale.warnings([5.0, 1.25], feedback(0.5)) == {}
    found = scale.warnings([16.0, 1.5], feedback(0.5))
    assert list(found) == ["impossible_value_of_reward", "impossible_value_of_cost"]
    assert "is 16, more than the 5 that an episode can pay" in found["impossible_value_of_reward"]
    assert "or set bound_targets" in found["impossible_value_of_reward"]
    assert "is 1.5, more than the 1.25 that an episode can cost" in found["impossible_value_of_cost"]
    low = scale.warnings([-2.0, 0.0], feedback(0.5))
    assert "is -2, less than the -1 that an episode must pay" in low["impossible_value_of_reward"]
    assert scale.warnings([16.0, 0.0], feedback(0.5, episodes=19)) == {}
    assert scale_of([1.0], [0.0]).warnings([0.5, 9.0], feedback(0.0)) == {}  # no episode has cost anything
    assert scale.warnings([16.0, 0.0], feedback(0.5), above=11.0) == {}


@pytest.mark.parametrize("name", NAMES)
def test_learners_give_the_warning_after_a_report(name: str):
    learner = learner_for(name, bound_targets=False, critic_learning_rate=0.0)
    learner.update(rollout_of(learner), feedback(0.5))
    assert "impossible_value_of_reward" not in learner.warnings(feedback(0.5))
    last = learner.agent.critics.stack.flat.detach()[-len(learner.agent.critics.signal) :] if name != "SACLag" else None
    with torch.no_grad():
        if last is None:
            learner.agent.critics.stack.flat[-6 * 9 :] = 500.0  # the last biases
        else:
            last.fill_(500.0)
    learner.update(rollout_of(learner, 1), feedback(0.5))
    assert "impossible_value_of_reward" in learner.warnings(feedback(0.5))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("space", ["MultiDiscrete", "Box"])
def test_what_is_learnt_does_not_depend_on_the_units_of_reward_and_cost(name: str, space: str):
    ends = []
    for factor in (1.0, 1024.0):  # a power of two: no rounding differs
        learner = learner_for(name, SPACES[space], updates_per_step=0.25, multiplier_rate=0.0, multiplier_gain=0.0)
        learner.agent.multipliers.each[0].value = 0.5
        for seed in range(3):
            rollout = rollout_of(learner, seed)
            rewards, costs = rollout.rewards * factor, rollout.costs / factor
            metrics = learner.update(dataclasses.replace(rollout, rewards=rewards, costs=costs), feedback(0.5))
            learner.agent.multipliers.each[0].value = 0.5
        ends.append((learner.policy.actor.stack.flat.detach().clone(), metrics))  # pyright: ignore
    assert torch.equal(ends[0][0], ends[1][0])
    assert ends[1][1]["reward_unit"] == pytest.approx(1024.0 * ends[0][1]["reward_unit"], rel=1e-6)
    assert ends[1][1]["q_mean"] == pytest.approx(1024.0 * ends[0][1]["q_mean"], rel=1e-5)


def test_targets_of_a_batch_are_in_units_and_bounded():
    learner = learner_for("DDPGLag", SPACES["Box"], discount=0.5, bound_margin=0.0, learning_rate=0.0)
    obs = torch.zeros(T + 1, N, D)
    every = torch.ones(T, N, dtype=torch.bool)
    actions = torch.zeros(T, N, 2)
    rewards = torch.arange(T * N, dtype=torch.float32).view(T, N)
    learner.update(
        rollouts.rollout_of(
            obs, actions=actions, rewards=rewards, terminated=every, fresh=torch.ones(T + 1, N, dtype=torch.bool)
        ),
        feedback(0.5),
    )
    unit, most = float(rewards.double().std(correction=0)), T * N - 1.0
    batch = batch_of(learner, torch.zeros(3, 2), ends=1)
    batch.signals[0] = torch.tensor([10.0, 20.0, 120.0])
    grads: list[torch.Tensor] = []
    learner.agent.update_critics(torch.zeros(2, 3, 1), grads.append, batch, torch.full((2, 3), 1.0))
    found = (-3 * grads[0][0, :, 0]).tolist()  # (Q - y) / B with Q = 0
    assert found == pytest.approx([10 / unit, 20 / unit + 0.5, min(120 / unit + 0.5, most / unit)], rel=1e-5)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"return_bounds": [1.0]}, r"return_bounds must be two, the smaller one first, got \[1.0\]"),
        ({"return_bounds": [2.0, 1.0]}, r"return_bounds must be two, the smaller one first, got \[2.0, 1.0\]"),
        ({"return_bounds": [0.0, float("inf")]}, r"return_bounds"),
        ({"largest_costs": [1.0, 2.0]}, r"largest_costs must be 1, one per limit, got \[1.0, 2.0\]"),
        ({"bound_margin": -0.1}, "bound_margin must be"),
        (
            {"normalise_cost": True, "cost_floor": False, "scale_returns": False, "largest_costs": [1.0]},
            r"largest_costs must be left out with normalise_cost, got \[1.0\]",
        ),
        ({"normalise_cost": True, "cost_floor": False}, "scale_returns must be off with normalise_cost, got True"),
        ({"cost_scale": "limit", "scale_returns": False}, "cost_scale must be step without scale_returns, got limit"),
    ],
)
def test_bad_settings_are_errors_that_name_the_field(settings: dict[str, Any], words: str):
    with pytest.raises(AlgorithmError, match=words):
        DDPGLagConfig(**settings)


def test_metrics_have_units_and_bounds():
    scale = scale_of([1.0, 1.0, 2.0], [0.0, 0.0, 1.0], bound_margin=0.25, scale_returns=False)
    assert scale.metrics() == {"reward_unit": 1.0, "cost_unit": 1.0, "reward_value_max": 5.0, "cost_value_max": 1.25}
    assert np.isinf(ValueScale(DDPGLagConfig(), 1, 1, CPU).metrics()["reward_value_max"])
