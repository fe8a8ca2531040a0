"""Contract of every on-policy algorithm with a cost limit: take the reward while the limit is kept, and stop when not.

One option of the first branch pays 1 and costs 1, the others nothing.
"""

import dataclasses
import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch

from tests.algos.rollouts import feedback, rollout_of
from thalweg.algos import ALGORITHMS, AlgorithmError
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.onpolicy.config import ConstrainedConfig, OnPolicyConfig
from thalweg.algos.onpolicy.cpo import CPOConfig
from thalweg.algos.onpolicy.natural_step import NaturalStep
from thalweg.algos.onpolicy.p3o import P3OConfig

N, T, D = 4, 64, 5
SPACES = {"MultiDiscrete": gym.spaces.MultiDiscrete([3, 3]), "Discrete": gym.spaces.Discrete(3)}
NAMES = [name for name, entry in ALGORITHMS.items() if issubclass(entry.config, ConstrainedConfig)]
MULTIPLIED = [name for name in NAMES if hasattr(ALGORITHMS[name].config, "multiplier_rate")]
LIMIT, KEPT, BROKEN = 1.0, 0.0, 5.0

NOTHING = dataclasses.replace(
    feedback(0.0, episodes=0, largest=0.0, lowest=math.nan, length=math.nan),
    new_costs=np.zeros((0, 1)),
    recent_costs=np.zeros((0, 1)),
)
"""What is known before any episode has ended."""


def learner_for(name: str, space: gym.Space = SPACES["MultiDiscrete"], **settings: Any) -> Any:
    entry = ALGORITHMS[name]
    given: dict[str, Any] = {"cost_limit": LIMIT, "cost_limit_schedule": ()} if name in NAMES else {}
    if name in MULTIPLIED:  # a few updates must do
        given |= {"multiplier_rate": 1.0, "multiplier_gain": 2.0, "multiplier_max": 2.0}
    config = entry.config(steps_per_update=N * T, minibatch=64, passes=4, hidden=(16, 16), **given | settings)
    return entry.make(config, Task(D, space, N, 0, {}))


def tempted(learner: Any, seed: int, costs: int = 1) -> Rollout:
    """Steps of the learner: option 0 of the first branch pays and costs; episodes end now and then."""
    generator = torch.Generator().manual_seed(seed)
    obs = torch.randn(T + 1, N, D, generator=generator)
    actions = torch.stack([learner.act(obs[t], torch.zeros(N, dtype=torch.bool)) for t in range(T)])
    chosen = (actions[..., 0] == 0).float()
    paid = torch.zeros(T, N, costs)
    paid[..., -1] = chosen
    ends = torch.rand(T, N, generator=generator) < 0.2
    return rollout_of(obs, actions=actions, rewards=chosen, costs=paid, terminated=ends)


def probability(learner: Any) -> float:
    """Of the option that pays and costs."""
    obs = torch.randn(256, D, generator=torch.Generator().manual_seed(9))
    with torch.no_grad():
        return float(learner.policy.distribution(obs).log_p[:, 0, 0].exp().mean())


def after(learner: Any, told: Feedback, updates: int = 12, costs: int = 1) -> float:
    for seed in range(updates):
        learner.update(tempted(learner, seed, costs), told)
    return probability(learner)


@pytest.mark.parametrize("space", SPACES.values(), ids=list(SPACES))
@pytest.mark.parametrize("name", NAMES)
class TestEveryConstrainedAlgorithm:
    def test_the_return_improves_while_the_limit_is_met(self, name: str, space: gym.Space):
        learner = learner_for(name, space)
        before = probability(learner)
        assert after(learner, feedback(KEPT)) > before + 0.15

    def test_it_leaves_what_costs_once_the_limit_is_broken(self, name: str, space: gym.Space):
        learner = learner_for(name, space)
        before = probability(learner)
        assert after(learner, feedback(BROKEN)) < before - 0.1

    def test_before_any_episode_it_takes_what_pays(self, name: str, space: gym.Space):
        learner = learner_for(name, space)
        before = probability(learner)
        assert after(learner, NOTHING) > before + 0.15


@pytest.mark.parametrize("settings", [{}, {"cost_limit_schedule": (8.0,)}], ids=["", "schedule"])
@pytest.mark.parametrize("name", NAMES)
def test_before_any_episode_parameters_and_losses_stay_finite(name: str, settings: dict[str, Any]):
    learner = learner_for(name, **settings)
    metrics = learner.update(tempted(learner, 0), NOTHING)
    unknown = {key for key, value in metrics.items() if not math.isfinite(value)}
    assert unknown == {"cost_mean"}
    weights = [*learner.policy.actor.parameters(), *learner.agent.critics.parameters()]
    assert all(bool(torch.isfinite(each).all()) for each in weights)


@pytest.mark.parametrize("name", NAMES)
def test_of_two_limits_the_broken_one_counts(name: str):
    """The second cost is the one that is paid; which of the two limits is broken decides."""
    ends = {}
    for which, told in {"its own": feedback(KEPT, BROKEN), "neither": feedback(KEPT, KEPT)}.items():
        learner = learner_for(name, cost_limits=(LIMIT, LIMIT))
        ends[which] = after(learner, told, costs=2)
    assert ends["its own"] < ends["neither"] - 0.2


@pytest.mark.parametrize("name", NAMES)
def test_each_of_two_costs_has_its_own_metrics(name: str):
    learner = learner_for(name, cost_limits=(0.1, 0.2))
    metrics = learner.update(tempted(learner, 0, 2), feedback(0.05, 0.3))
    assert (metrics["cost_mean_tight"], metrics["cost_mean_loose"]) == pytest.approx((0.05, 0.3))
    assert {"cost_tight_value_loss", "cost_loose_explained_variance", "limit_can_bind_loose"} <= set(metrics)


@pytest.mark.parametrize("name", MULTIPLIED)
def test_a_met_limit_leaves_its_multiplier_at_zero_and_an_exceeded_one_raises_its_multiplier(name: str):
    learner = learner_for(name, cost_limits=(0.1, 0.1), multiplier_rate=0.5, multiplier_gain=0.0)
    metrics = learner.update(tempted(learner, 0, 2), feedback(0.0, 0.5))
    # 0.5 (0.5 - 0.1) / 0.5
    assert (metrics["multiplier_tight"], metrics["multiplier_loose"]) == (0.0, pytest.approx(0.4))


@pytest.mark.parametrize("name", NAMES)
def test_the_limit_of_the_moment_decides(name: str):
    """A cost of 2 breaks the final limit of 1, and keeps the one that begins at 8."""
    settings = {"cost_limit_schedule": (8.0,), "cost_limit_share": 0.5}
    ends = [
        after(learner_for(name, **settings), feedback(2.0, progress=progress, lowest=2.0)) for progress in (0.1, 0.6)
    ]
    assert ends[0] > ends[1] + 0.2
    metrics = learner_for(name, **settings)
    found = metrics.update(tempted(metrics, 0), feedback(2.0, progress=0.25, lowest=2.0))
    assert found["cost_limit"] == pytest.approx(4.5)
    met = learner_for(name, **settings)
    found = met.update(tempted(met, 0), feedback(2.0, progress=0.25, lowest=1.0))
    assert found["cost_limit"] == 1.0


@pytest.mark.parametrize("name", NAMES)
def test_a_limit_that_is_never_met_is_named(name: str):
    learner = learner_for(name, cost_limit=0.1)
    assert "limit_never_met" in learner.warnings(feedback(0.5, lowest=0.2, progress=0.6))


@pytest.mark.parametrize("name", NAMES)
def test_a_limit_that_never_binds_is_named(name: str):
    learner = learner_for(name, cost_limit=25.0)
    assert "limit_never_binds" in learner.warnings(feedback(0.5))
    assert not learner.warnings(feedback(0.5, episodes=5))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("settings", [{"cost_limit": -0.1}, {"cost_limits": (0.1, -0.1)}, {"cost_discount": 1.5}])
def test_settings_that_make_no_sense_are_refused(name: str, settings: dict[str, Any]):
    with pytest.raises(AlgorithmError, match=rf"{next(iter(settings))}(\[1\])? must be "):
        ALGORITHMS[name].config(**settings)


@pytest.mark.parametrize("name", NAMES)
def test_a_nan_in_the_costs_stops_it(name: str):
    from thalweg.algos import NotFiniteError

    learner = learner_for(name)
    rollout = tempted(learner, 0)
    rollout.costs[3, 1] = math.nan
    with pytest.raises(NotFiniteError, match="has become nan"):
        learner.update(rollout, feedback(BROKEN))


def test_ppo_is_deaf_to_the_cost():
    learner = learner_for("PPO")
    before = probability(learner)
    assert after(learner, feedback(BROKEN)) > before + 0.15


@pytest.mark.parametrize("name", [n for n, e in ALGORITHMS.items() if issubclass(e.config, OnPolicyConfig)])
def test_a_cost_window_or_the_new_episodes_and_enough_are_what_the_mean_is_taken_over(name: str):
    if "cost_window" not in ALGORITHMS[name].config.__dataclass_fields__:
        pytest.skip("has no limit")
    lagging = dataclasses.replace(feedback(0.8), recent_costs=np.array([[0.0]] * 9 + [[0.8]]))
    new, window = (learner_for(name, cost_window=size, cost_episodes=3) for size in (0, 10))
    least = learner_for(name, cost_episodes=5)
    assert least.update(tempted(least, 0), lagging)["cost_mean"] == pytest.approx(0.16)
    assert new.update(tempted(new, 0), lagging)["cost_mean"] == pytest.approx(0.8)
    assert window.update(tempted(window, 0), lagging)["cost_mean"] == pytest.approx(0.08)


def test_oncrpo_rectifies_only_above_its_tolerance():
    for cost, rectifies in ((0.11, 0.0), (0.13, 1.0)):
        learner = learner_for("OnCRPO", cost_limit=0.1, tolerance=0.02)
        assert learner.update(tempted(learner, 0), feedback(cost))["rectifies"] == rectifies


def test_cpo_says_when_no_step_keeps_the_limit_and_when_every_one_does():
    for cost, feasible, binding in ((50.0, 0.0, 1.0), (0.0, 1.0, 0.0)):
        learner = learner_for("CPO", cost_limit=10.0)
        metrics = learner.update(tempted(learner, 0), feedback(cost))
        assert (metrics["feasible"], metrics["binding"]) == (feasible, binding)


def test_cup_projects_only_where_a_multiplier_is_above_zero():
    for cost, projects in ((KEPT, False), (BROKEN, True)):
        learner = learner_for("CUP")
        metrics = learner.update(tempted(learner, 0), feedback(cost))
        assert (metrics["projection_passes"] > 0) == projects and (metrics["projection_kl"] > 0) == projects


@pytest.mark.parametrize("name", MULTIPLIED)
def test_a_heavy_kl_holds_the_policy_where_it_began_while_a_limit_is_broken(name: str):
    found = {}
    for weight in (0.0, 300.0):
        origin, learner = (learner_for(name, imitation_kl=weight, learning_rate=1e-2) for _ in range(2))
        learner.policy.initialise_from(origin.policy)
        for seed in range(6):
            metrics = learner.update(tempted(learner, seed), feedback(BROKEN, progress=0.0))
        assert metrics["multiplier"] == 2.0 and metrics.get("projection_passes", 1) > 0
        obs = torch.randn(256, D, generator=torch.Generator().manual_seed(9))
        with torch.no_grad():
            found[weight] = float(learner.policy.distribution(obs).kl(origin.policy.distribution(obs)).mean())
    assert found[300.0] < 1e-3 < 0.2 < found[0.0]


def test_p3o_has_no_penalty_while_the_cost_is_below_the_limit():
    for cost, open_ in ((0.0, False), (0.9, True)):
        learner = learner_for("P3O", cost_limit=0.5, limit_scale="none", standardise_cost=False, penalty=20.0)
        metrics = learner.update(tempted(learner, 0), feedback(cost))
        assert (metrics["gate"] > 0.5) == open_ and (metrics["penalty"] > 1.0) == open_


@pytest.mark.parametrize(("limit_scale", "factor"), [("length", 1 / 8), ("discount", 0.2), ("none", 1.0)])
def test_p3o_scales_the_violation_of_an_episode_as_its_setting_says(limit_scale: str, factor: float):
    settings = {"limit_scale": limit_scale, "cost_discount": 0.8, "standardise_cost": False}
    learner = learner_for("P3O", cost_limit=0.5, penalty=2.0, learning_rate=0.0, **settings)
    metrics = learner.update(tempted(learner, 0), feedback(0.9, length=8.0))
    # The policy stays, so that the surrogate of centred advantages is 0 and κ k (J_c - d) is left.
    assert metrics["penalty"] == pytest.approx(2.0 * factor * 0.4, rel=1e-4)


@pytest.mark.parametrize(
    ("cost", "shift", "accepted"),
    [(0.0, 0.01, True), (0.0, 3.0, False), (0.0, -0.01, False), (5.0, -0.01, True), (5.0, 0.01, False)],
)
def test_cpo_accepts_what_keeps_the_limit_and_loses_nothing_unless_it_is_broken(
    cost: float, shift: float, accepted: bool, monkeypatch: pytest.MonkeyPatch
):
    """The option that pays and costs becomes more probable, or less."""
    learner, asked = learner_for("CPO"), []
    rollout = tempted(learner, 0)
    chosen = (rollout.actions[..., 0] == 0).flatten().float()

    def search(natural: NaturalStep, step: torch.Tensor, accepts: Any) -> int:
        asked.append(accepts(natural._drift.old_log_prob + shift * chosen, 0.0))
        return 0

    monkeypatch.setattr(NaturalStep, "search", search)
    learner.update(rollout, feedback(cost))
    assert asked == [accepted]


@pytest.mark.parametrize(
    ("config", "settings", "words"),
    [
        (P3OConfig, {"limit_scale": "discount", "cost_discount": 1.0}, "cost_discount must be below 1 with"),
        (CPOConfig, {"standardise_cost": True}, "standardise_cost must be off for CPO"),
    ],
)
def test_settings_that_make_no_sense_together_are_refused(config: Any, settings: dict[str, Any], words: str):
    with pytest.raises(AlgorithmError, match=words):
        config(**settings)
