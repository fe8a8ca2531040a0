"""The warm-up of critics beside a policy that another run has trained: the policy stays, critics learn."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
import torch

from tests.algos.onpolicy.test_learners import FIRST_ORDER, ON_POLICY, SPACES, N, T, learner_for, rollout_of
from tests.algos.rollouts import feedback
from thalweg.algos import ALGORITHMS
from thalweg.algos.interface import Rollout
from thalweg.algos.onpolicy.config import LagrangianConfig

FEEDBACK = feedback(0.5)
WARMUP = N * T + 1
"""Steps of one rollout and a bit, so that the second rollout begins within them, and the third does not."""
GRU = {"memory": "gru", "memory_size": 8, "sequence": 5}


def begun(name: str, **settings: Any) -> Any:
    """A learner whose policy has learnt something and whose critics have not."""
    settings = {"critic_warmup_steps": WARMUP} | settings
    first, then = (learner_for(name, SPACES["MultiDiscrete"], **settings) for _ in range(2))
    for seed in range(2):
        first.update(rollout_of(first, seed), FEEDBACK)
    then.policy.initialise_from(first.policy)
    then.warm_up_critics()
    return then


def exact(state: Any) -> Any:
    """A state with arrays as bytes, which are equal only if every bit is."""
    if isinstance(state, dict):
        return {name: exact(value) for name, value in state.items()}
    return state.tobytes() if isinstance(state, np.ndarray) else state


def of_policy(learner: Any) -> dict[str, Any]:
    """What the warm-up must leave as it is."""
    state, names = learner.state(), ("actor", "normaliser", "policy_optimiser", "multipliers")
    return {name: exact(state[name]) for name in names if name in state}


@pytest.mark.parametrize("settings", [{}, GRU, {"adapter": "box_scaled"}], ids=["plain", "gru", "gaussian"])
@pytest.mark.parametrize("name", ON_POLICY)
def test_only_critics_learn_until_its_end(name: str, settings: dict[str, Any]):
    learner, plain = begun(name, **settings), learner_for(name, SPACES["MultiDiscrete"], **settings)
    before, usual = of_policy(learner), set(plain.update(rollout_of(plain), FEEDBACK))
    critics = [learner.state()["critics"]]
    for seed in range(2):
        metrics = learner.update(rollout_of(learner, seed), FEEDBACK)
        assert of_policy(learner) == before
        assert metrics["kl"] == 0.0 and metrics["entropy"] > 0.1 and set(metrics) == usual
        assert metrics.get("learning_rate", 0.0) == metrics.get("clip_fraction", 0.0) == 0.0
        critics.append(learner.state()["critics"])
    assert all(abs(critics[i + 1][key] - critics[i][key]).max() > 1e-3 for i in range(2) for key in critics[0])
    learner.update(rollout_of(learner, 2), FEEDBACK)
    after = of_policy(learner)
    assert after["actor"] != before["actor"]
    assert name not in FIRST_ORDER or after["policy_optimiser"] != before["policy_optimiser"]
    assert after["normaliser"]["count"] == 3 * N * T  # two of the first run, one after the warm-up
    if issubclass(ALGORITHMS[name].config, LagrangianConfig):
        assert after["multipliers"]["0"]["updates"] == 1


@pytest.mark.parametrize("name", ON_POLICY)
def test_the_critics_learn_as_they_would_beside_a_policy_that_learns(name: str):
    """In the first update: the same losses and weights."""
    all_passes = {"target_kl": math.inf} if name in FIRST_ORDER else {}
    warm, cold = (begun(name, critic_warmup_steps=steps, **all_passes) for steps in (WARMUP, 0))
    metrics = [learner.update(rollout_of(learner), FEEDBACK) for learner in (warm, cold)]
    assert metrics[0]["value_loss"] == metrics[1]["value_loss"] and metrics[1]["kl"] > 0.0 == metrics[0]["kl"]
    critics = [exact(learner.state()["critics"]) for learner in (warm, cold)]
    assert critics[0] == critics[1]


def test_without_being_asked_for_it_does_nothing():
    one, other = (learner_for("PPO", SPACES["Discrete"], critic_warmup_steps=steps) for steps in (0, 10**6))
    metrics = [str(each.update(rollout_of(each), FEEDBACK)) for each in (one, other)]
    assert metrics[0] == metrics[1]
    assert exact(one.state()) == exact(other.state())


@pytest.mark.parametrize("name", ON_POLICY)
def test_what_is_left_of_it_comes_back_bit_for_bit(name: str):
    """In a learner that was told to warm up, as a run that resumes does, and in one that was not."""
    learner = begun(name)
    learner.update(rollout_of(learner), FEEDBACK)
    state = learner.state()
    metrics = [str(learner.update(rollout_of(learner, seed), FEEDBACK)) for seed in (1, 2)]
    for asked in (True, False):
        other = learner_for(name, SPACES["MultiDiscrete"], critic_warmup_steps=WARMUP)
        if asked:
            other.warm_up_critics()
        other.load_state(state)
        assert [str(other.update(rollout_of(other, seed), FEEDBACK)) for seed in (1, 2)] == metrics
        assert exact(other.state()) == exact(learner.state())


def test_a_state_that_says_nothing_of_it_is_of_a_run_without():
    """Of a version before there was a warm-up."""
    learner = begun("PPO")
    state = learner.state()
    del state["warmup_left"]
    learner.load_state(state)
    assert learner.update(rollout_of(learner), FEEDBACK)["kl"] > 0.0


def test_steps_that_only_reset_do_not_count():
    learner = begun("PPO", critic_warmup_steps=N * T)
    valid = torch.ones(T, N, dtype=torch.bool)
    valid[3, 1] = False
    moved = []
    for seed in range(3):
        steps = dataclasses.replace(rollout_of(learner, seed), valid=valid)
        moved.append(learner.update(steps, FEEDBACK)["kl"] > 0.0)
    assert moved == [False, False, True]


@pytest.mark.parametrize("name", ON_POLICY)
def test_a_run_that_ends_before_the_policy_learns_is_warned_of(name: str):
    learner, code = begun(name), "policy_never_learns"
    learner.update(rollout_of(learner), FEEDBACK)
    assert code not in learner.warnings(feedback(0.5, steps_left=2))
    sentence = learner.warnings(feedback(0.5, steps_left=1))[code]
    assert f"the critics warm up for the first {WARMUP} steps" in sentence and "no rollout begins after" in sentence
    for seed in (1, 2):
        learner.update(rollout_of(learner, seed), FEEDBACK)
    assert code not in learner.warnings(feedback(0.5, steps_left=0))


def test_losses_and_penalties_are_measured_meanwhile():
    """They are those of the policy as it is."""
    learner = begun("P3O", penalty=2.0)
    metrics = learner.update(rollout_of(learner), FEEDBACK)
    assert metrics["policy_loss"] != 0.0 and metrics["gate"] == 1.0 and metrics["penalty"] > 0.0
    learner = begun("CPO")
    metrics = learner.update(rollout_of(learner), FEEDBACK)
    assert metrics["steps_refused"] == 0 and metrics["passes"] == 1


@pytest.mark.parametrize("settings", [{}, GRU, {"asymmetric_critics": True}], ids=["plain", "gru", "asymmetric"])
def test_weights_of_a_number_that_the_first_run_never_saw_vary_begin_at_zero_and_learn(settings: dict[str, Any]):
    def still(rollout: Rollout) -> Rollout:
        rollout.obs[..., 2] = rollout.final_obs[:, 2] = 0.0
        return rollout

    first, then = (learner_for("PPO", SPACES["MultiDiscrete"], critic_warmup_steps=0, **settings) for _ in range(2))
    first.update(still(rollout_of(first)), FEEDBACK)
    then.policy.initialise_from(first.policy)
    then.warm_up_critics()

    def weights() -> list[float]:
        """The largest weight of that number and of the next one, in the policy and in its critics."""
        modules = (then.policy.actor, then.agent.critics)
        parts = [(module.stack.layers[0][0].transpose(1, 2), module.gru) for module in modules]
        found = [part for stack, gru in parts for part in (stack, gru and gru.weight_in.detach()) if part is not None]
        return [float(part[..., index].abs().max()) for part in found for index in (2, 3)]

    begun = weights()
    assert max(begun[::2]) == 0.0 < 0.1 < min(begun[1::2])
    then.update(rollout_of(then, 1), FEEDBACK)  # which includes it in the statistics of observations
    then.update(rollout_of(then, 2), FEEDBACK)
    assert min(weights()) > 1e-3
