"""Tests of the first steps of a learner whose policy was given: it acts, and only the critics learn."""

from typing import Any

import numpy as np
import pytest
import torch

from tests.algos.offpolicy.learners import NAMES, D, N, learner_for, rollout_of
from tests.algos.offpolicy.test_learners import assert_same
from tests.algos.rollouts import feedback

FEEDBACK = feedback(0.5)
RANDOM, WARMUP = 2 * N, 6 * N
"""Random steps, and steps of the warm-up after them: two and six of all environments."""
SETTINGS: dict[str, Any] = {
    "random_steps": RANDOM,
    "critic_warmup_steps": WARMUP,
    "steps_per_update": N,
    "updates_per_step": 1.0,
    "minibatch": 8,
    "multiplier_initial": 0.25,
}


def begun(name: str, **settings: Any) -> Any:
    learner = learner_for(name, **(SETTINGS | settings))
    learner.warm_up_critics()
    return learner


def kept(learner: Any) -> dict[str, Any]:
    """What must stay while only the critics learn."""
    state, stack = learner.state(), learner.agent.target_actor
    names = ("actor", "policy_optimiser", "multipliers", "normaliser", "log_alpha", "alpha_optimiser")
    return {"target": stack.flat.detach().numpy().copy()} | {name: state[name] for name in names if name in state}


def changed(one: dict[str, Any], two: dict[str, Any]) -> set[str]:
    return {name for name in one if not same(one[name], two[name])}


def same(one: Any, two: Any) -> bool:
    if isinstance(one, dict):
        return one.keys() == two.keys() and all(same(one[key], two[key]) for key in one)
    return bool(np.array_equal(one, two))


@pytest.mark.parametrize("schedule", ["report", "gradient_step"])
@pytest.mark.parametrize("delay", [1, 3])
@pytest.mark.parametrize("name", NAMES)
def test_only_critics_and_their_targets_learn_until_the_warmup_ends(name: str, delay: int, schedule: str):
    learner = begun(name, policy_delay=delay, multiplier_schedule=schedule)
    agent, first, gradient_steps = learner.agent, kept(learner), []
    for step in range((RANDOM + WARMUP) // N):
        before = [agent.critics.stack.flat.detach().clone(), agent.target_critics.flat.detach().clone()]
        metrics = learner.update(rollout_of(learner, step, 1), FEEDBACK)
        gradient_steps.append(agent.gradient_steps)
        after = [agent.critics.stack.flat.detach(), agent.target_critics.flat.detach()]
        if step + 1 < (RANDOM + WARMUP) // N:
            assert_same(kept(learner), first)
            learns = step >= RANDOM // N
            assert [torch.equal(*pair) for pair in zip(before, after, strict=True)] == [not learns] * 2
            assert np.isnan(metrics["policy_loss"]) and np.isnan(metrics["q_loss"]) == (not learns)
    assert gradient_steps == [0, 0, 4, 8, 12, 16, 20, 24]
    alpha = {"log_alpha", "alpha_optimiser"} if name == "SACLag" else set()
    assert changed(kept(learner), first) == {"target", "actor", "policy_optimiser", "multipliers"} | alpha


@pytest.mark.parametrize("name", NAMES)
def test_the_given_policy_acts_from_the_first_step(name: str):
    still = {} if name == "SACLag" else {"exploration": 0.0, "exploration_temperature": 1e-3}
    learner, obs = begun(name, **still), torch.zeros(3000, D)
    with torch.no_grad():
        learner.policy.actor.stack.flat[-6:] = torch.tensor([90.0, 0.0, 0.0, 0.0, 0.0, 90.0])  # the last biases
    assert learner.act(obs, obs[:, 0] > 0).unique(dim=0).tolist() == [[0, 2]]


@pytest.mark.parametrize("name", NAMES)
def test_without_a_given_policy_the_warmup_does_nothing(name: str):
    states = []
    for warmup in (WARMUP, 0):
        learner = learner_for(name, **(SETTINGS | {"critic_warmup_steps": warmup}))
        for seed in range(4):
            learner.update(rollout_of(learner, seed, 1), FEEDBACK)
        states.append(learner.state())
    assert_same(*states)


@pytest.mark.parametrize("at", [1, 5, 8])
@pytest.mark.parametrize("name", NAMES)
def test_a_restored_warmup_continues_bit_identically(name: str, at: int):
    """A resumed run calls `warm_up_critics` too, and one that did not begin with a policy does not."""
    learner, other = begun(name), learner_for(name, **SETTINGS)
    for seed in range(at):
        learner.update(rollout_of(learner, seed, 1), FEEDBACK)
    other.load_state(learner.state())
    for seed in range(at, 12):
        ours, theirs = (one.update(rollout_of(one, seed, 1), FEEDBACK) for one in (learner, other))
        assert str(ours) == str(theirs)
    assert_same(learner.state(), other.state())


def test_the_multipliers_reach_counts_the_updates_after_the_warmup():
    still = {"multiplier_rate": 1e-3, "multiplier_gain": 0.0, "cost_limit": 0.5, "multiplier_initial": 0.0}
    learner = begun("DDPGLag", **still)
    metrics = learner.update(rollout_of(learner, 0, 1), feedback(0.5, steps_left=100))
    updates = (100 - (RANDOM + WARMUP - N)) / N
    assert metrics["multiplier_reach"] == pytest.approx(updates * 0.5e-3)


@pytest.mark.parametrize("name", NAMES)
def test_a_run_that_ends_before_the_policy_learns_is_warned_of(name: str):
    learner = begun(name)
    learner.update(rollout_of(learner, 0, 1), FEEDBACK)
    code, left = "policy_never_learns", RANDOM + WARMUP - N
    assert code not in learner.warnings(feedback(0.5, steps_left=left + 1))
    sentence = learner.warnings(feedback(0.5, steps_left=left))[code]
    assert "for the first 32 steps (random_steps + critic_warmup_steps), but the run has 32" in sentence
    usual = learner_for(name, **SETTINGS)
    usual.update(rollout_of(usual, 0, 1), FEEDBACK)
    assert code not in usual.warnings(feedback(0.5, steps_left=0))


@pytest.mark.parametrize("name", NAMES)
def test_weights_of_a_number_that_the_first_run_never_saw_vary_begin_at_zero(name: str):
    """In the policy, the critics and, once they learn, their copies."""
    first, then = (learner_for(name, **(SETTINGS | {"critic_warmup_steps": 0})) for _ in range(2))
    still = rollout_of(first)
    still.obs[..., 2] = still.final_obs[:, 2] = 0.0
    first.update(still, FEEDBACK)
    then.policy.initialise_from(first.policy)
    then.warm_up_critics()
    then.agent.targets.hard_update()  # as before the first gradient step
    agent = then.agent
    for stack in (agent.policy.actor.stack, agent.critics.stack, agent.target_actor, agent.target_critics):
        largest = stack.layers[0][0].abs().amax((0, 2))
        assert largest[2] == 0.0 and largest[[0, 1, 3, 4]].min() > 0.1
