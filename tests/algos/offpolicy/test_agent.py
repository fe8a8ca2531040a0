"""Tests of the agent of off-policy algorithms: update schedule, multipliers, critics and metrics."""

import dataclasses
import math
from typing import Any

import pytest
import torch

from tests.algos.offpolicy.learners import NAMES, SPACES, D, N, T, batch_of, learner_for, rollout_of
from tests.algos.rollouts import feedback
from thalweg.algos import AlgorithmError, NotFiniteError
from thalweg.algos.offpolicy.ddpglag import DDPGLagConfig
from thalweg.algos.offpolicy.mean_metrics import MeanMetrics

FEEDBACK = feedback(0.5)


def ddpg(**settings: Any) -> Any:
    return learner_for("DDPGLag", **({"minibatch": 4, "hidden": (4,)} | settings))


def rounds(learner: Any, count: int, steps: int = 1, given: Any = FEEDBACK) -> list[dict[str, float]]:
    return [learner.update(rollout_of(learner, seed, steps), given) for seed in range(count)]


def test_a_collection_is_at_least_one_step_of_each_environment():
    assert [ddpg(steps_per_collection=steps).rollout_steps for steps in (1, N, 2 * N - 1, 2 * N, 64)] == [
        1,
        1,
        1,
        2,
        16,
    ]


def test_gradient_steps_follow_the_steps_and_carry_fractions_over():
    learner, counts = ddpg(updates_per_step=0.3), []
    for seed in range(10):
        learner.update(rollout_of(learner, seed, 1), FEEDBACK)
        counts.append(learner.agent.gradient_steps)
    assert counts == [1, 2, 3, 4, 6, 7, 8, 9, 10, 12]  # 1.2 each time


def test_random_steps_earn_no_gradient_steps():
    learner = ddpg(random_steps=10, updates_per_step=1.0)
    counts = []
    for seed in range(5):
        learner.update(rollout_of(learner, seed, 1), FEEDBACK)
        counts.append(learner.agent.gradient_steps)
    assert counts == [0, 0, 2, 6, 10]  # 4 steps a round, the first 10 of them random


@pytest.mark.parametrize("name", NAMES)
def test_random_steps_are_uniform_and_later_ones_follow_the_policy(name: str):
    still = {} if name == "SACLag" else {"exploration": 0.0, "exploration_temperature": 1e-3}
    learner = learner_for(name, SPACES["MultiDiscrete"], random_steps=N, **still)
    obs = torch.zeros(3000, D)
    with torch.no_grad():
        learner.policy.actor.stack.flat[-6:] = torch.tensor([90.0, 0.0, 0.0, 0.0, 0.0, 90.0])  # the last biases
    drawn = learner.act(obs, obs[:, 0] > 0)
    assert [(drawn[:, 0] == k).float().mean().item() for k in range(3)] == pytest.approx([1 / 3] * 3, abs=0.03)
    learner.update(rollout_of(learner, 0, 1), FEEDBACK)
    assert learner.act(obs, obs[:, 0] > 0).unique(dim=0).tolist() == [[0, 2]]


def test_metrics_are_reported_every_steps_per_update_and_at_the_end():
    learner = ddpg(steps_per_update=10)
    assert [bool(found) for found in rounds(learner, 7)] == [False, False, True, False, False, True, False]
    assert rounds(learner, 1, given=feedback(0.5, steps_left=0))[0]["gradient_steps"] == 8


def test_the_multiplier_is_updated_at_each_report():
    learner = ddpg(steps_per_update=8, multiplier_rate=1.0, multiplier_gain=0.0, multiplier_max=9.0, cost_limit=0.1)
    moved = [learner.agent.multipliers.values[0] for _ in range(6) if rounds(learner, 1) is not None]
    assert moved == pytest.approx([0.0, 0.8, 0.8, 1.6, 1.6, 2.4])  # (0.5 - 0.1) / 0.5 each


def test_a_limit_that_begins_wide_is_final_once_it_has_been_met():
    settings = {"cost_limit": 0.1, "cost_limit_schedule": (9.0,), "steps_per_update": 4}
    found = [rounds(ddpg(**settings), 1, given=feedback(0.5, lowest=lowest))[0] for lowest in (0.2, 0.1)]
    # progress 0.1 of a share of 0.5: 0.1 (9 - 8 / 5)
    assert [each["cost_limit"] for each in found] == pytest.approx([0.74, 0.1])
    assert found[0]["multiplier"] < found[1]["multiplier"]


def test_the_multiplier_waits_for_the_first_gradient_step():
    learner = ddpg(steps_per_update=4, random_steps=8, multiplier_rate=1.0, multiplier_gain=0.0)
    assert [found["multiplier"] for found in rounds(learner, 3)] == pytest.approx([0.0, 0.0, 0.8])


def test_omnisafes_multiplier_is_updated_at_each_gradient_step_after_its_warmup():
    settings = {"multiplier_rule": "adam", "multiplier_rate": 1e-3, "multiplier_gain": 0.0, "multiplier_warmup": 5}
    learner = ddpg(multiplier_schedule="gradient_step", updates_per_step=1.0, steps_per_update=4, **settings)
    found = [each["multiplier"] for each in rounds(learner, 3)]
    assert found == pytest.approx([0.0, 3e-3, 7e-3], rel=1e-3)  # 4, 8 and 12 gradient steps, 5 of them too early


def test_the_multipliers_reach_counts_the_updates_left():
    given, settings = (
        feedback(0.5, steps_left=100),
        {"multiplier_rate": 1e-3, "multiplier_gain": 0.0, "cost_limit": 0.5},
    )
    by_report = rounds(ddpg(steps_per_update=4, **settings), 1, given=given)[0]
    assert by_report["multiplier_reach"] - by_report["multiplier"] == pytest.approx(25 * 0.5e-3)
    by_step = ddpg(steps_per_update=4, updates_per_step=0.5, multiplier_schedule="gradient_step", **settings)
    metrics = rounds(by_step, 1, given=given)[0]
    assert metrics["multiplier_reach"] - metrics["multiplier"] == pytest.approx(50 * 0.5e-3)


def test_warnings_name_a_limit_that_never_binds_and_a_multiplier_that_is_too_slow():
    assert list(ddpg(cost_limit=25.0).warnings(FEEDBACK)) == ["limit_never_binds"]
    slow = {"multiplier_rate": 1e-6, "multiplier_gain": 0.0}
    assert list(ddpg(**slow).warnings(FEEDBACK)) == ["multiplier_too_slow"]
    assert not ddpg().warnings(FEEDBACK)


def test_the_policys_learning_rate_falls_linearly_with_linear_decay():
    given = feedback(0.5, progress=0.75, steps_left=0)
    falling = ddpg(learning_rate=1e-3)
    assert rounds(falling, 1, given=given)[0]["learning_rate"] == pytest.approx(0.25e-3)
    constant = ddpg(learning_rate=1e-3, linear_decay=False)
    assert rounds(constant, 1, given=given)[0]["learning_rate"] == 1e-3


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("delay", "expected"), [(1, 4), (2, 2), (3, 1)])
def test_policy_and_target_networks_are_updated_every_policy_delay_steps(name: str, delay: int, expected: int):
    learner, calls = learner_for(name, policy_delay=delay, updates_per_step=1.0), []
    soft_update = learner.agent.targets.soft_update
    learner.agent.targets.soft_update = lambda rate: (calls.append(rate), soft_update(rate))
    before = learner.agent.targets.target.clone()
    learner.update(rollout_of(learner, 0, 1), FEEDBACK)
    assert calls == [learner.config.target_rate] * expected and not torch.equal(learner.agent.targets.target, before)


@pytest.mark.parametrize("name", NAMES)
def test_the_policys_step_changes_no_critic_and_the_critics_step_no_policy(name: str):
    for still, moving in (("learning_rate", "critic_learning_rate"), ("critic_learning_rate", "learning_rate")):
        settings: dict[str, Any] = {still: 0.0, moving: 1e-3}
        learner = learner_for(name, **settings)
        stacks = {"learning_rate": learner.policy.actor.stack, "critic_learning_rate": learner.agent.critics.stack}
        before = {key: stack.flat.detach().clone() for key, stack in stacks.items()}
        learner.update(rollout_of(learner), FEEDBACK)
        assert torch.equal(stacks[still].flat, before[still]) and not torch.equal(stacks[moving].flat, before[moving])


def test_normalise_cost_standardises_the_stored_costs():
    raw, scaled = ddpg(), ddpg(normalise_cost=True, cost_floor=False, scale_returns=False)
    for learner in (raw, scaled):
        rounds(learner, 1, steps=T)
    costs = torch.from_numpy(raw.agent.replay.state()["rows"])[:, -2]
    learnt = torch.from_numpy(scaled.agent.replay.state()["rows"])[:, -2]
    assert torch.allclose(learnt, (costs - costs.mean()) / costs.std(correction=0), atol=1e-5)
    assert learnt.min() < 0 <= costs.min()


@pytest.mark.parametrize(("floor", "lowest"), [(True, 0.0), (False, -0.9)])
def test_cost_floor_clips_the_next_values_of_costs_at_zero(floor: bool, lowest: float):
    learner = ddpg(cost_floor=floor, discount=0.9, cost_discount=0.9, learning_rate=0.0)
    batch = batch_of(learner, learner.policy.actions.uniform(5, learner.agent.generator), ends=0)
    batch.signals.zero_()
    grads: list[torch.Tensor] = []
    learner.agent.update_critics(torch.zeros(2, 5, 1), grads.append, batch, -torch.ones(2, 5))
    reward, cost = (-5 * grads[0][..., 0]).tolist()  # (Q - y) / B with Q = 0
    assert reward == pytest.approx([-0.9] * 5) and cost == pytest.approx([lowest] * 5)


@pytest.mark.parametrize("name", NAMES)
def test_a_rollout_of_resets_alone_stores_nothing(name: str):
    learner = learner_for(name)
    learner.update(rollout_of(learner, steps=1, valid=torch.zeros(1, N, dtype=torch.bool)), FEEDBACK)
    assert learner.agent.steps == learner.agent.replay.filled == 0


def test_a_negative_cost_is_an_error_with_cost_floor():
    learner = ddpg()
    rollout = rollout_of(learner)
    rollout.costs[3, 1] = -0.5
    with pytest.raises(AlgorithmError, match=r"a step cost -0\.5; with cost_floor none may be negative"):
        learner.update(rollout, FEEDBACK)
    ddpg(cost_floor=False).update(rollout, FEEDBACK)
    with pytest.raises(AlgorithmError, match="cost_floor must be off with normalise_cost"):
        ddpg(normalise_cost=True)


def test_gradients_are_clipped_to_max_grad_norm():
    learner = ddpg(max_grad_norm=1e-3, updates_per_step=1.0)
    rounds(learner, 1)
    for optimiser in (learner.agent.policy_optimiser, learner.agent.critic_optimiser):
        (parameter,) = optimiser.parameters
        assert float(parameter.grad.norm()) <= 1e-3 * (1 + 1e-5)


def test_metrics_count_steps_and_are_nan_before_learning():
    learner = ddpg(steps_per_update=N * T)
    metrics = rounds(learner, 1, steps=T)[0]
    assert (metrics["gradient_steps"], metrics["replay"]) == (N * T // 4, N * T)
    assert {"q_loss", "cost_q_loss", "q_mean", "cost_q_mean", "policy_loss", "cost_mean", "cost_episodes"} <= set(
        metrics
    )
    nothing = rounds(ddpg(random_steps=10**6, steps_per_update=4), 1)[0]
    assert math.isnan(nothing["q_loss"]) and nothing["gradient_steps"] == 0 and nothing.keys() == metrics.keys()


def test_mean_metrics_average_each_group():
    means = MeanMetrics(("a", "b"), ("c",))
    for number in (1.0, 3.0):
        means.add(0, torch.tensor([number, 10.0 * number]))
        means.count(0)
    assert str(means.report()) == str({"a": 2.0, "b": 20.0, "c": math.nan})
    means.add(1, torch.tensor([5.0]))
    means.count(1)
    other = MeanMetrics(("a", "b"), ("c",))
    other.load_state(means.state())
    assert str(means.report()) == str({"a": math.nan, "b": math.nan, "c": 5.0}) == str(other.report())


def test_mean_metrics_name_a_number_that_is_nan():
    means = MeanMetrics(("a", "b"))
    means.add(0, torch.tensor([1.0, math.nan]))
    with pytest.raises(NotFiniteError, match="b has become nan"):
        means.require_finite()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"steps_per_collection": 0}, "steps_per_collection must be a whole number above 0, got 0"),
        ({"updates_per_step": 0.0}, "updates_per_step must be a finite number above 0"),
        ({"target_rate": 0.0}, "target_rate must be a number above 0 and at most 1"),
        ({"cost_critics": 3}, "cost_critics must be a whole number from 1 to 2"),
        ({"discount": 1.1}, "discount must be a number from 0 to 1"),
        ({"multiplier_initial": 99.0}, "multiplier_initial must be at most multiplier_max = 3.0, got 99.0"),
        ({"cost_limit": -1.0}, "cost_limit must be a finite number of at least 0"),
        ({"exploration": 1.5}, "exploration must be a number from 0 to 1"),
        ({"relaxation": 0.0}, "relaxation must be a finite number above 0"),
    ],
)
def test_bad_settings_are_errors_that_name_the_field(settings: dict[str, Any], words: str):
    with pytest.raises(AlgorithmError, match=words):
        DDPGLagConfig(**settings)


@pytest.mark.parametrize(("ending", "value"), [("terminated", 1.0), ("truncated", 2.0)])
def test_q_is_the_reward_where_each_step_terminates_and_bootstraps_where_each_step_is_truncated(
    ending: str, value: float
):
    learner = ddpg(discount=0.5, updates_per_step=2.0, critic_learning_rate=1e-2, hidden=(16,), target_rate=0.1)
    every = torch.ones(T, N, dtype=torch.bool)
    for seed in range(4):
        rollout = rollout_of(learner, seed)
        ends = {"terminated": ~every, "truncated": ~every} | {ending: every}
        final = {"final_index": torch.arange(N * T), "final_obs": rollout.obs[1:].flatten(0, 1)}
        rollout = dataclasses.replace(rollout, rewards=torch.ones(T, N), costs=torch.ones(T, N, 1), **ends, **final)
        metrics = learner.update(rollout, FEEDBACK)
    assert metrics["q_mean"] == pytest.approx(value, abs=0.1)  # pyright: ignore[reportPossiblyUnbound]
