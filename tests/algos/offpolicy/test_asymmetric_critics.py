"""Tests of critics that see more than the policy: known answers, and that nothing changes without them."""

import dataclasses
from typing import Any

import pytest
import torch

from tests.algos import rollouts
from tests.algos.offpolicy.learners import NAMES, SPACES, C, D, N, T, learner_for, rollout_of
from tests.algos.offpolicy.test_learners import assert_same
from tests.algos.rollouts import feedback
from thalweg.algos import ALGORITHMS
from thalweg.algos.interface import Task

FEEDBACK = feedback(0.5)
HIDDEN = torch.tensor([-1.0, 1.0, -1.0, 1.0])
"""[N] a number of each environment that no observation shows: the reward of each of its steps."""


def hidden_number(learner: Any, seed: int) -> Any:
    """A rollout that pays the hidden number h and costs (1 + h) / 2 in each step, and tells critics h beside noise."""
    rollout, never = rollout_of(learner, seed), torch.zeros(T, N, dtype=torch.bool)
    told = torch.randn(T + 1, N, C, generator=torch.Generator().manual_seed(seed))
    told[..., 1] = HIDDEN
    costs = (1.0 + HIDDEN.expand(T, N).unsqueeze(-1)) / 2.0
    return dataclasses.replace(
        rollout,
        rewards=HIDDEN.expand(T, N),
        costs=costs,
        terminated=never,
        critic_obs=told,
        final_critic_obs=torch.zeros(0, C),
    )


@pytest.mark.parametrize("space", ["MultiDiscrete", "Box"])
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("critic_size", "least", "most"), [(C, 0.0, 0.05), (0, 0.8, 1.2)])
def test_critics_fit_returns_of_a_hidden_number_only_if_they_see_it(
    name: str, space: str, critic_size: int, least: float, most: float
):
    """With γ = ½ they are 2 h and 1 + h; without h the loss is half the variance of its targets, ½ and 1/8."""
    halves: dict[str, Any] = {"discount": 0.5, "cost_discount": 0.5, "target_rate": 0.3, "critic_learning_rate": 1e-2}
    plain = {"scale_returns": False, "bound_targets": False}
    learner = learner_for(name, SPACES[space], critic_size, **halves, **plain)
    for seed in range(8):
        metrics = learner.update(hidden_number(learner, seed), FEEDBACK)
    assert least <= metrics["q_loss"] / 0.5 <= most  # pyright: ignore[reportPossiblyUnbound]
    assert least <= metrics["cost_q_loss"] / 0.125 <= most  # pyright: ignore[reportPossiblyUnbound]
    if critic_size:
        assert values_by_hidden_number(learner) == pytest.approx([-2.0, 2.0, 0.0, 2.0], abs=0.1)


@torch.no_grad()
def values_by_hidden_number(learner: Any) -> list[float]:
    """Mean values of the reward for a hidden number of -1 and of 1, and those of the cost."""
    agent = learner.agent
    rows = next(agent.replay.batches(1, 500, agent.generator, learner.policy.normaliser, agent.critic_normaliser))
    batch = agent.replay.batch(rows)
    outputs_of_actions = agent.critics.stack.sizes[-1] > 1
    values = agent.critics.stack(batch.seen if outputs_of_actions else batch.seen_actions).mean(-1)
    hidden = batch.seen[:, D + 1] > 0
    return [float(values[k, hidden == high].mean()) for k in (0, -1) for high in (False, True)]


LIMIT, GAMMA = 8, 0.99


@pytest.mark.parametrize("name", NAMES)
def test_the_cost_of_critics_that_know_the_limit_ends_there(name: str):
    """Episodes pay and cost 0.2 as the limit cuts them off: the last step costs 0.2, and step t 0.2 γ^(7 - t). What the
    reward is taken to be worth at the limit returns to it, towards 0.2 / (1 - γ) = 20."""
    same: dict[str, Any] = {"discount": GAMMA, "cost_discount": GAMMA, "target_rate": 0.3, "updates_per_step": 1.0}
    plain = {"scale_returns": False, "bound_targets": False, "critic_learning_rate": 1e-2, "linear_decay": False}
    learner = learner_for(name, critic_size=1, **same, **plain)
    most = 0.0
    for seed in range(8):
        obs = torch.randn(T + 1, N, D, generator=torch.Generator().manual_seed(seed))
        actions = torch.stack([learner.act(each, torch.zeros(N, dtype=torch.bool)) for each in obs[:-1]])
        learner.update(rollouts.cut_off(obs, LIMIT, actions=actions), FEEDBACK)
        rewards, costs = values_by_step(learner)
        most = max(most, rewards[-1])
    assert costs == pytest.approx([0.2 * GAMMA ** (LIMIT - 1 - t) for t in range(LIMIT)], abs=0.05)  # pyright: ignore[reportPossiblyUnbound]
    assert most > 0.6


@torch.no_grad()
def values_by_step(learner: Any) -> tuple[list[float], list[float]]:
    """Mean values of the reward and of the cost by the step of an episode, of stored steps."""
    agent = learner.agent
    rows = next(agent.replay.batches(1, 500, agent.generator, learner.policy.normaliser, lambda told: told))
    step = (rows[:, D] * LIMIT).round()
    rows[:, D : D + 1] = agent.critic_normaliser(rows[:, D : D + 1])
    batch = agent.replay.batch(rows)
    values = agent.critics.stack(batch.seen if agent.critics.stack.sizes[-1] > 1 else batch.seen_actions).mean(-1)
    reward, cost = ([float(values[k, step == t].mean()) for t in range(LIMIT)] for k in (0, -1))
    return reward, cost


@pytest.mark.parametrize("name", NAMES)
def test_without_the_setting_critics_see_the_observation_alone_to_the_bit(name: str):
    """Whatever the environment tells; and with it, where the environment tells nothing."""
    states = []
    for asymmetric, told in ((False, 0), (False, C), (True, 0)):
        entry = ALGORITHMS[name]
        config = entry.config(minibatch=16, hidden=(8,), random_steps=0, asymmetric_critics=asymmetric)
        learner: Any = entry.make(config, Task(D, SPACES["Box"], N, 0, {}, critic_size=told))
        beside: Any = (
            {"critic_obs": torch.ones(T + 1, N, told), "final_critic_obs": torch.ones(0, told)} if told else {}
        )
        for seed in range(2):
            learner.update(rollout_of(learner, seed, **beside), FEEDBACK)
        states.append(learner.state())
    assert_same(states[0], states[1])
    assert_same(states[0], states[2])


@pytest.mark.parametrize("frame_stack", [1, 3])
def test_what_critics_see_is_normalised_by_the_statistics_of_all_valid_steps_and_not_stacked(frame_stack: int):
    learner = learner_for("SACLag", critic_size=C, frame_stack=frame_stack, minibatch=8)
    told: list[torch.Tensor] = []
    for seed in range(2):
        valid = torch.ones(T, N, dtype=torch.bool)
        valid[3] = False
        rollout = rollout_of(learner, seed, valid=valid)
        learner.update(rollout, FEEDBACK)
        assert rollout.critic_obs is not None
        told.append(rollout.critic_obs[:-1][valid])
    normaliser, seen = learner.agent.critic_normaliser, torch.cat(told)
    assert normaliser.count == len(seen) == 2 * (T - 1) * N
    assert torch.allclose(normaliser.mean.float(), seen.mean(0), atol=1e-5)
    assert torch.allclose(normaliser.scale, 1.0 / seen.std(0, correction=0), atol=1e-5)
    assert learner.agent.critics.stack.sizes[0] == frame_stack * D + C
    assert learner.policy.actor.stack.sizes[0] == frame_stack * D
    assert learner.agent.replay.rows.shape[1] == 2 * (frame_stack * D + C) + 1 + 2 + 2
