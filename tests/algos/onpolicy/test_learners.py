"""Contract of every registered on-policy algorithm; a new one is tested the moment it is registered."""

import dataclasses
import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch

from tests.algos import rollouts
from tests.algos.rollouts import feedback
from thalweg.algos import ALGORITHMS, NotFiniteError
from thalweg.algos.interface import Rollout, Task
from thalweg.algos.onpolicy.config import FirstOrderConfig, OnPolicyConfig
from thalweg.algos.onpolicy.focops import FOCOPS

N, T, D, C = 4, 32, 5, 2
SPACES = {
    "MultiDiscrete": gym.spaces.MultiDiscrete([3, 3]),
    "Discrete": gym.spaces.Discrete(3),
    "Box": gym.spaces.Box(-1.0, 1.0, (2,), np.float32),
}
FEEDBACK = feedback(0.5)
VARIANTS: dict[str, dict[str, Any]] = {
    "plain": {},
    "literal": {"adapter": "box_literal"},
    "scaled": {"adapter": "box_scaled"},
    "frames": {"frame_stack": 3},
    "gru": {"memory": "gru", "memory_size": 8, "sequence": 5},
    "kaiming": {"initial": "kaiming", "activation": "relu", "critic_decay": 1e-3},
    "asymmetric": {"asymmetric_critics": True},
}
"""Settings that change what is learnt or remembered."""
ON_POLICY = [name for name, entry in ALGORITHMS.items() if issubclass(entry.config, OnPolicyConfig)]
FIRST_ORDER = [name for name in ON_POLICY if issubclass(ALGORITHMS[name].config, FirstOrderConfig)]


def learner_for(name: str, space: gym.Space, **settings: Any) -> Any:
    entry = ALGORITHMS[name]
    usual = {"steps_per_update": N * T, "minibatch": 32, "passes": 4, "hidden": (16, 16), "asymmetric_critics": False}
    config = entry.config(**(usual | settings))
    return entry.make(config, Task(D, space, N, 0, {}, critic_size=C))


def quick(name: str) -> dict[str, Any]:
    """Settings with which ten updates are enough to see that something is learnt."""
    return {"learning_rate": 1e-2, "target_kl": 0.5} if name in FIRST_ORDER else {"trust_radius": 0.1}


def rollout_of(learner: Any, seed: int = 0, **changes: Any) -> Rollout:
    """Steps whose reward is 1 for the first option or a positive number, and whose cost is 1 for the others."""
    generator = torch.Generator().manual_seed(seed)
    obs = torch.randn(T + 1, N, D * learner.config.frame_stack, generator=generator)
    ends = torch.rand(T, N, generator=generator) < 0.2
    fresh = torch.cat([torch.ones(1, N, dtype=torch.bool), ends])
    actions = torch.stack([learner.act(obs[t], fresh[t]) for t in range(T)])
    kind = learner.policy.actions
    good = kind.options(actions)[..., 0] == 0 if kind.sizes else actions[..., 0] > 0
    costs = (~good).float().unsqueeze(-1).expand(-1, -1, len(getattr(learner.config, "cost_limits", ())) or 1)
    fields = {"actions": actions, "rewards": good.float(), "costs": costs, "terminated": ends, "fresh": fresh}
    fields |= {"critic_obs": obs[..., :C] * 2 + 1, "final_critic_obs": torch.zeros(0, C)}
    return rollouts.rollout_of(obs, **(fields | changes))


def share_of_good(learner: Any) -> float:
    """Of what it does first in an episode."""
    obs = np.random.default_rng(9).standard_normal((512, D)).astype(np.float32)
    player = learner.policy.player(len(obs), generator=torch.Generator().manual_seed(0))
    actions = player(obs, np.ones(len(obs), dtype=bool)).reshape(len(obs), -1)
    return float(((actions[:, 0] == 0) if learner.policy.actions.sizes else (actions[:, 0] > 0)).mean())


def weights(learner: Any) -> list[torch.Tensor]:
    return list(learner.policy.actor.parameters())


@pytest.mark.parametrize("space", SPACES.values(), ids=list(SPACES))
@pytest.mark.parametrize("name", ON_POLICY)
class TestEveryAlgorithm:
    def test_it_learns_which_action_pays(self, name: str, space: gym.Space):
        learner = learner_for(name, space, **quick(name))
        before = share_of_good(learner)
        for seed in range(10):
            learner.update(rollout_of(learner, seed), FEEDBACK)
        assert share_of_good(learner) > before + 0.2

    def test_it_resumes_from_its_state_bit_for_bit(self, name: str, space: gym.Space):
        resumes_bit_for_bit(name, space)

    def test_a_nan_in_the_rewards_stops_it(self, name: str, space: gym.Space):
        learner = learner_for(name, space)
        rewards = torch.zeros(T, N)
        rewards[3, 1] = math.nan
        with pytest.raises(NotFiniteError, match="has become nan"):
            learner.update(rollout_of(learner, rewards=rewards), FEEDBACK)

    def test_steps_that_only_reset_change_nothing(self, name: str, space: gym.Space):
        reset_steps_change_nothing(name, space)


def resumes_bit_for_bit(name: str, space: gym.Space, **settings: Any) -> None:
    learner, other = learner_for(name, space, **settings), learner_for(name, space, **settings)
    learner.update(rollout_of(learner), FEEDBACK)
    other.load_state(learner.state())
    ours, theirs = (one.update(rollout_of(one, 1), feedback(0.1)) for one in (learner, other))
    assert ours == theirs or str(ours) == str(theirs)
    for one, two in zip(weights(learner), weights(other), strict=True):
        assert torch.equal(one, two)


def reset_steps_change_nothing(name: str, space: gym.Space, **settings: Any) -> None:
    """Steps 5, 12, 19 and 26 only reset; what they seem to pay and cost does not matter."""
    results = []
    for junk in (0.0, 1e6):
        learner = learner_for(name, space, **settings)
        valid = torch.ones(T, N, dtype=torch.bool)
        valid[5::7] = False
        ends = torch.zeros(T, N, dtype=torch.bool)
        ends[4::7] = True
        fresh = torch.cat([torch.ones(1, N, dtype=torch.bool), ~valid])
        rollout = rollout_of(learner, valid=valid, terminated=ends, fresh=fresh)
        rewards, costs = (torch.where(valid, paid, junk) for paid in (rollout.rewards, rollout.costs[..., 0]))
        changed = dataclasses.replace(rollout, rewards=rewards, costs=costs.unsqueeze(-1))
        results.append(learner.update(changed, FEEDBACK))
    assert results[0]["value_loss"] == results[1]["value_loss"]
    assert str(results[0]) == str(results[1])


@pytest.mark.parametrize("settings", VARIANTS.values(), ids=list(VARIANTS))
@pytest.mark.parametrize("name", ON_POLICY)
class TestEveryVariant:
    def test_it_learns_which_action_pays(self, name: str, settings: dict[str, Any]):
        learner = learner_for(name, SPACES["MultiDiscrete"], **quick(name), **settings)
        before = share_of_good(learner)
        for seed in range(10):
            learner.update(rollout_of(learner, seed), FEEDBACK)
        assert share_of_good(learner) > before + 0.2

    def test_it_resumes_from_its_state_bit_for_bit(self, name: str, settings: dict[str, Any]):
        resumes_bit_for_bit(name, SPACES["MultiDiscrete"], **settings)

    def test_steps_that_only_reset_change_nothing(self, name: str, settings: dict[str, Any]):
        reset_steps_change_nothing(name, SPACES["MultiDiscrete"], **settings)


@pytest.mark.parametrize("name", ON_POLICY)
def test_critics_with_a_memory_that_see_more_resume_bit_for_bit(name: str):
    resumes_bit_for_bit(name, SPACES["MultiDiscrete"], **VARIANTS["gru"], **VARIANTS["asymmetric"])


@pytest.mark.parametrize("name", FIRST_ORDER)
def test_the_learning_rate_falls_linearly_with_progress(name: str):
    learner = learner_for(name, SPACES["Discrete"], learning_rate=1e-3)
    late = feedback(0.5, progress=0.75)
    assert learner.update(rollout_of(learner), late)["learning_rate"] == pytest.approx(0.25e-3)


@pytest.mark.parametrize("name", FIRST_ORDER)
def test_passes_stop_at_the_target_kl(name: str):
    learner = learner_for(name, SPACES["Discrete"], learning_rate=0.05, target_kl=1e-6)
    metrics = learner.update(rollout_of(learner), FEEDBACK)
    assert metrics["passes"] == 1 and metrics["kl"] > 1e-6


def focops(**settings: Any) -> FOCOPS:
    return learner_for("FOCOPS", SPACES["Discrete"], **{"cost_limit_schedule": ()} | settings)


def test_the_multiplier_of_focops_moves_before_the_policy():
    learner = focops(cost_limit=0.1, multiplier_rate=0.5, multiplier_gain=0.0)
    # 0.5 (0.5 - 0.1) / 0.5
    assert learner.update(rollout_of(learner), FEEDBACK)["multiplier"] == pytest.approx(0.4)


def test_before_any_episode_the_multiplier_stays():
    learner = focops(multiplier_initial=0.3)
    assert learner.update(rollout_of(learner), feedback(0.5, count=0, episodes=0))["multiplier"] == 0.3


def test_a_multiplier_that_can_not_get_anywhere_is_named():
    settings = {"cost_limit": 0.1, "multiplier_rate": 1e-4, "multiplier_gain": 0.0}
    assert list(focops(**settings).warnings(FEEDBACK)) == ["multiplier_too_slow"]
    assert list(focops(**settings, multiplier_rule="adam").warnings(FEEDBACK)) == ["multiplier_too_slow"]
    assert not focops().warnings(FEEDBACK)


def test_updates_left_are_counted_over_all_environments():
    agent = focops().agent
    assert [agent.updates_left(feedback(0.5, steps_left=steps)) for steps in (0, 1, N * T, N * T + 1)] == [0, 1, 1, 2]


@pytest.mark.parametrize(("limits", "avoids_good"), [((0.1, 9.0), True), ((9.0, 0.1), False)])
def test_each_cost_is_avoided_by_the_weight_of_its_own_multiplier(limits: tuple[float, float], avoids_good: bool):
    fast = {"multiplier_rate": 0.5, "multiplier_max": 2.0}
    learner = focops(cost_limits=limits, learning_rate=1e-2, target_kl=0.5, trust_radius=0.5, **fast)
    before = share_of_good(learner)
    for seed in range(10):
        rollout = rollout_of(learner, seed)
        good = rollout.actions[..., 0] == 0
        apart = torch.stack([good, ~good], -1).float()  # the first option's cost is tight, the others' loose
        learner.update(
            dataclasses.replace(rollout, rewards=torch.zeros(T, N), costs=apart), feedback(0.5, 0.5, largest=10.0)
        )
    assert learner.multipliers.values == ((2.0, 0.0) if avoids_good else (0.0, 2.0))
    assert share_of_good(learner) < before - 0.2 if avoids_good else share_of_good(learner) > before + 0.2


def test_metrics_of_costs_apart_name_them():
    learner = focops(cost_limits=(0.1, 0.6))
    metrics = learner.update(rollout_of(learner), feedback(0.5, 0.25))
    assert (metrics["cost_mean_tight"], metrics["cost_mean_loose"], metrics["cost_episodes"]) == (0.5, 0.25, 3)
    assert (metrics["limit_can_bind_tight"], metrics["limit_can_bind_loose"]) == (1.0, 1.0)
    apart = ["cost_mean", "limit_can_bind", "multiplier", "multiplier_reach"]
    named = {f"{name}{which}" for name in apart for which in ("_tight", "_loose")}
    critics = {f"cost_{which}_{name}" for name in ("value_loss", "explained_variance") for which in ("tight", "loose")}
    assert named | critics <= set(metrics)
    together = focops()
    alone = together.update(rollout_of(together), FEEDBACK)
    assert not [name for name in alone if "tight" in name or "loose" in name]
    assert {*apart, "cost_value_loss", "cost_explained_variance"} <= set(alone)


def test_a_window_of_costs_is_what_the_metrics_tell_too():
    learner = focops(cost_window=50, multiplier_rate=0.5, multiplier_gain=0.0)
    told = dataclasses.replace(FEEDBACK, recent_costs=feedback(0.3, count=60).recent_costs)
    metrics = learner.update(rollout_of(learner), told)
    assert (metrics["cost_mean"], metrics["multiplier"]) == pytest.approx((0.3, 0.5 * 0.2 / 0.3))


def test_divided_by_one_plus_the_multiplier_advantages_are_those_of_a_higher_temperature():
    # (A_r - A_c) / 2 over λ = 0.5 is A_r - A_c over λ = 1
    still = {"multiplier_initial": 1.0, "multiplier_rate": 0.0, "multiplier_gain": 0.0}
    settings = [(True, 0.5), (False, 1.0), (False, 0.5)]
    ends = []
    for divided, temperature in settings:
        each = {"normalise_by_multiplier": divided, "temperature": temperature}
        learner = focops(**still, **each)
        learner.update(rollout_of(learner), FEEDBACK)
        ends.append(torch.cat([value.detach().flatten() for value in weights(learner)]))
    assert torch.allclose(ends[0], ends[1], atol=1e-6) and not torch.allclose(ends[0], ends[2], atol=1e-4)


@pytest.mark.parametrize("name", ON_POLICY)
def test_weights_of_the_critics_fall_by_their_decay(name: str):
    sizes = []
    for decay in (0.0, 10.0):
        learner = learner_for(name, SPACES["Discrete"], critic_decay=decay)
        learner.update(rollout_of(learner), FEEDBACK)
        sizes.append(sum(float(value.detach().square().sum()) for value in learner.agent.critics.parameters()))
    assert sizes[1] < 0.99 * sizes[0]


def test_updates_left_begin_after_the_warm_up():
    learner = focops(critic_warmup_steps=2 * N * T)
    learner.warm_up_critics()
    assert learner.agent.updates_left(feedback(0.5, steps_left=3 * N * T)) == 1
