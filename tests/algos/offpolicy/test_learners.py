"""Tests that every off-policy algorithm must pass."""

import dataclasses
import math
from typing import Any

import gymnasium as gym
import pytest
import torch

from tests.algos.offpolicy.learners import NAMES, SPACES, C, N, T, learner_for, rollout_of, share_of_rewarded
from tests.algos.rollouts import feedback
from thalweg.algos import AlgorithmError, NotFiniteError
from thalweg.algos.policy.actions import actions_of

FEEDBACK = feedback(0.5)
VARIANTS: dict[str, dict[str, Any]] = {
    "plain": {},
    "scaled": {"adapter": "box_scaled"},
    "literal": {"adapter": "box_literal"},
    "frames": {"frame_stack": 3},
    "two cost critics": {"cost_critics": 2},
    "separate costs": {"cost_limits": (0.1, 0.2), "cost_critics": 2},
    "kaiming": {"initial": "kaiming", "activation": "tanh", "normalise_observations": False},
    "unscaled": {"scale_returns": False, "bound_targets": False},
    "given bounds": {"return_bounds": (0.0, 40.0), "bound_margin": 0.0},
    "omnisafe": {
        "scale_returns": False,
        "bound_targets": False,
        "multiplier_schedule": "gradient_step",
        "normalise_cost": True,
        "cost_floor": False,
        "linear_decay": False,
    },
    "small replay": {"replay_size": 100},
    "delayed": {"policy_delay": 3, "updates_per_step": 0.3},
    "asymmetric critics": {"critic_size": C, "frame_stack": 2, "replay_size": 200},
}
"""Settings that change what is learnt or stored."""


def given(learner: Any, cost: float = 0.5, **others: Any):
    """Feedback with as many costs as the learner limits."""
    return feedback(*[cost] * len(learner.config.limits), **others)


def learns(name: str, space: gym.Space, *, first_rewarded: bool, **settings: Any) -> bool:
    """Whether eight rounds are enough to prefer the rewarded actions, be it the first option or the others."""
    usual = {"learning_rate": 1e-2, "critic_learning_rate": 3e-3, "updates_per_step": 0.25, "multiplier_max": 0.0}
    learner = learner_for(name, space, **(usual | settings))
    for seed in range(8):
        rollout = rollout_of(learner, seed)
        rewards = rollout.rewards if first_rewarded else 1.0 - rollout.rewards
        learner.update(dataclasses.replace(rollout, rewards=rewards), given(learner))
    return share_of_rewarded(learner) > 0.8 if first_rewarded else share_of_rewarded(learner) < 0.2


@pytest.mark.parametrize("space", SPACES.values(), ids=list(SPACES))
@pytest.mark.parametrize("name", NAMES)
class TestEveryAlgorithm:
    def test_it_learns_the_rewarded_action(self, name: str, space: gym.Space):
        assert learns(name, space, first_rewarded=True) and learns(name, space, first_rewarded=False)

    def test_a_restored_state_continues_bit_identically(self, name: str, space: gym.Space):
        assert_resumes_bit_identically(name, space)

    def test_nan_in_the_rewards_stops_it(self, name: str, space: gym.Space):
        learner = learner_for(name, space)
        rewards = torch.zeros(T, N)
        rewards[3, 1] = math.nan
        with pytest.raises(NotFiniteError, match="has become nan"):
            learner.update(rollout_of(learner, rewards=rewards), FEEDBACK)

    def test_a_loss_that_is_not_finite_stops_it_even_where_nothing_is_reported(self, name: str, space: gym.Space):
        learner = learner_for(name, space, steps_per_update=10**9, scale_returns=False, bound_targets=False)
        with pytest.raises(NotFiniteError, match=r"q_loss has become"):
            learner.update(rollout_of(learner, rewards=torch.full((T, N), 1e30)), FEEDBACK)

    def test_steps_that_only_reset_change_nothing(self, name: str, space: gym.Space):
        results = []
        for junk in (0.0, 1e6):
            learner = learner_for(name, space, steps_per_update=64)
            valid = torch.ones(T, N, dtype=torch.bool)
            valid[5::7] = False
            rollout = rollout_of(learner, valid=valid)
            rewards = torch.where(valid, rollout.rewards, junk)
            results.append(learner.update(dataclasses.replace(rollout, rewards=rewards), FEEDBACK))
        assert results[0]["replay"] == N * T - 4 * N == results[1]["replay"]
        assert results[0] == results[1]


def assert_resumes_bit_identically(name: str, space: gym.Space, **settings: Any) -> None:
    """Assert that a restored state continues bit-identically, after a round without a report."""
    learner, other = (learner_for(name, space, steps_per_update=N * T + 1, **settings) for _ in range(2))
    assert not learner.update(rollout_of(learner), given(learner))
    other.load_state(learner.state())
    for seed in (1, 2):
        ours, theirs = (one.update(rollout_of(one, seed), given(one, 0.3)) for one in (learner, other))
        assert str(ours) == str(theirs) and bool(ours) == (seed == 1)
    assert_same(learner.state(), other.state())


def assert_same(one: Any, two: Any) -> None:
    if isinstance(one, dict):
        assert one.keys() == two.keys()
        for key in one:
            assert_same(one[key], two[key])
    else:
        assert str(one) == str(two) and (not hasattr(one, "tobytes") or one.tobytes() == two.tobytes())


@pytest.mark.parametrize("settings", VARIANTS.values(), ids=list(VARIANTS))
@pytest.mark.parametrize("name", NAMES)
class TestEveryVariant:
    def test_a_restored_state_continues_bit_identically(self, name: str, settings: dict[str, Any]):
        assert_resumes_bit_identically(name, SPACES["MultiDiscrete"], **settings)

    def test_it_learns_the_rewarded_action(self, name: str, settings: dict[str, Any]):
        assert learns(
            name, SPACES["MultiDiscrete"], first_rewarded=settings.get("adapter") == "box_literal", **settings
        )


@pytest.mark.parametrize("name", NAMES)
def test_each_cost_acts_through_its_own_multiplier(name: str):
    ends = []
    for dear in (0, 1):
        still: dict[str, Any] = {"multiplier_rate": 0.0, "multiplier_gain": 0.0, "multiplier_initial": 0.0}
        learner = learner_for(name, cost_limits=(0.1, 0.1), learning_rate=1e-2, updates_per_step=0.5, **still)
        learner.agent.multipliers.each[dear].value = 20.0
        for seed in range(10):
            rollout = rollout_of(learner, seed)
            good = rollout.actions[..., 0] == 0
            separate = torch.stack([good, ~good], -1).float()  # the first option's cost is tight, the others' loose
            learner.update(dataclasses.replace(rollout, costs=separate, rewards=torch.zeros(T, N)), given(learner, 0.1))
            learner.agent.multipliers.each[dear].value = 20.0
        ends.append(share_of_rewarded(learner))
    assert ends[0] < 0.2 and ends[1] > 0.8


@pytest.mark.parametrize("name", NAMES)
def test_metrics_of_separate_costs_name_them(name: str):
    learner = learner_for(name, cost_limits=(0.1, 0.2))
    metrics = learner.update(rollout_of(learner), feedback(0.5, 0.25))
    numbers = ("cost_mean", "multiplier", "multiplier_reach", "limit_can_bind")
    expected = {f"{number}{which}" for number in numbers for which in ("_tight", "_loose")}
    expected |= {f"cost{which}_{number}" for number in ("q_loss", "q_mean") for which in ("_tight", "_loose")}
    assert expected <= set(metrics) and (metrics["cost_mean_tight"], metrics["cost_mean_loose"]) == (0.5, 0.25)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("temperature", [0.0, 0.25])
def test_a_saved_policy_keeps_its_algorithm_and_how_it_draws(name: str, temperature: float, tmp_path):
    settings = {} if name == "SACLag" else {"flight_temperature": temperature}
    learner = learner_for(name, SPACES["MultiDiscrete"], **settings)
    learner.policy.save(tmp_path / "policy.safetensors")
    again = type(learner.policy).load(tmp_path / "policy.safetensors")
    assert again.about.algorithm == name
    assert again.greedy == (name != "SACLag" and temperature == 0.0)
    assert again.temperature == (temperature if name != "SACLag" and temperature else 1.0)
    box = learner_for(name, SPACES["Box"], **settings).policy
    assert (box.greedy, box.temperature) == (name != "SACLag", 1.0)


@pytest.mark.parametrize("name", NAMES)
def test_an_unsupported_space_is_an_error(name: str):
    with pytest.raises(AlgorithmError, match="must be Discrete, MultiDiscrete"):
        learner_for(name, gym.spaces.MultiBinary(3))


def test_too_many_joint_actions_are_an_error_of_discrete_sac_alone():
    space = gym.spaces.MultiDiscrete([8] * 5)
    with pytest.raises(AlgorithmError, match="32,768, more than 4,096: use adapter='box_scaled'"):
        learner_for("SACLag", space)
    for name, settings in (("SACLag", {"adapter": "box_scaled"}), ("DDPGLag", {}), ("TD3Lag", {})):
        learner = learner_for(name, space, **settings)
        assert learner.policy.actions == actions_of(space, **settings, continuous="squashed")  # pyright: ignore
