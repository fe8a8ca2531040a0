"""What every registered algorithm must do; a new one is tested the moment it is registered."""

import dataclasses
import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch

from thalweg.algos import ALGORITHMS, NotFiniteError
from thalweg.algos.focops import FOCOPS, FOCOPSConfig
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.multiplier import Multiplier
from thalweg.algos.networks import Critics
from thalweg.algos.normaliser import Normaliser
from thalweg.algos.onpolicy import Signal, samples_of

N, T, D = 4, 32, 5
SPACES = {
    "MultiDiscrete": gym.spaces.MultiDiscrete([3, 3]),
    "Discrete": gym.spaces.Discrete(3),
    "Box": gym.spaces.Box(-1.0, 1.0, (2,), np.float32),
}
FEEDBACK = Feedback(progress=0.1, updates_left=10, cost_mean=0.5, cost_episodes=3, episodes=30, largest_cost=1.0)


def learner_for(name: str, space: gym.Space, **settings) -> Any:
    entry = ALGORITHMS[name]
    config = entry.config(steps_per_update=N * T, minibatch=32, passes=4, hidden=(16, 16), **settings)
    return entry.make(config, Task(D, space, N, 0, {}))


def rollout_of(learner: Any, seed: int = 0, **changes) -> Rollout:
    """Steps whose reward is 1 for the first option or a positive number, and whose cost is 1 for the others."""
    generator = torch.Generator().manual_seed(seed)
    obs = torch.randn(T + 1, N, D, generator=generator)
    actions = torch.stack([learner.act(obs[t].numpy()) for t in range(T)])
    good = actions[..., 0] == 0 if actions.dtype == torch.int64 else actions[..., 0] > 0
    ends = torch.rand(T, N, generator=generator) < 0.2
    never = torch.zeros_like(ends)
    fields = {
        "obs": obs,
        "actions": actions,
        "rewards": good.float(),
        "costs": (~good).float(),
        "terminated": ends,
        "truncated": never,
        "valid": ~never,
        "final_index": torch.zeros(0, dtype=torch.int64),
        "final_obs": torch.zeros(0, D),
    }
    return Rollout(**(fields | changes))


def probability_of_good(learner: Any) -> float:
    obs = torch.randn(256, D, generator=torch.Generator().manual_seed(9))
    with torch.no_grad():
        distribution = learner.policy.distribution(obs)
    if hasattr(distribution, "log_p"):
        return float(distribution.log_p[:, 0, 0].exp().mean())
    return float((distribution.mean[:, 0] > 0).float().mean())


@pytest.mark.parametrize("space", SPACES.values(), ids=list(SPACES))
@pytest.mark.parametrize("name", ALGORITHMS)
class TestEveryAlgorithm:
    def test_it_learns_which_action_pays(self, name: str, space: gym.Space):
        learner = learner_for(name, space, learning_rate=1e-2, target_kl=0.5)
        before = probability_of_good(learner)
        for seed in range(10):
            learner.update(rollout_of(learner, seed), FEEDBACK)
        assert probability_of_good(learner) > before + 0.2

    def test_from_its_state_it_goes_on_to_the_last_bit(self, name: str, space: gym.Space):
        learner, other = learner_for(name, space), learner_for(name, space)
        learner.update(rollout_of(learner), FEEDBACK)
        other.load_state(learner.state())
        calm = dataclasses.replace(FEEDBACK, cost_mean=0.1)
        ours, theirs = (one.update(rollout_of(one, 1), calm) for one in (learner, other))
        assert ours == theirs or str(ours) == str(theirs)
        for one, two in zip(learner.policy.actor.parameters(), other.policy.actor.parameters(), strict=True):
            assert torch.equal(one, two)

    def test_a_nan_in_the_rewards_stops_it(self, name: str, space: gym.Space):
        learner = learner_for(name, space)
        rewards = torch.zeros(T, N)
        rewards[3, 1] = math.nan
        with pytest.raises(NotFiniteError, match="has become nan"):
            learner.update(rollout_of(learner, rewards=rewards), FEEDBACK)

    def test_steps_that_only_reset_change_nothing(self, name: str, space: gym.Space):
        results = []
        for junk in (0.0, 1e6):
            learner = learner_for(name, space)
            valid = torch.ones(T, N, dtype=torch.bool)
            valid[5::7] = False
            rollout = rollout_of(learner, valid=valid)
            ends = torch.zeros(T, N, dtype=torch.bool)
            ends[4::7] = True
            rewards = torch.where(valid, rollout.rewards, junk)
            metrics = learner.update(Rollout(**(vars(rollout) | {"terminated": ends, "rewards": rewards})), FEEDBACK)
            results.append(metrics["value_loss"])
        assert results[0] == results[1]


@pytest.mark.parametrize("name", ALGORITHMS)
def test_the_learning_rate_falls_linearly_with_progress(name: str):
    learner = learner_for(name, SPACES["Discrete"], learning_rate=1e-3)
    late = dataclasses.replace(FEEDBACK, progress=0.75)
    assert learner.update(rollout_of(learner), late)["learning_rate"] == pytest.approx(0.25e-3)


@pytest.mark.parametrize("name", ALGORITHMS)
def test_passes_stop_at_the_target_kl(name: str):
    learner = learner_for(name, SPACES["Discrete"], learning_rate=0.05, target_kl=1e-6)
    metrics = learner.update(rollout_of(learner), FEEDBACK)
    assert metrics["passes"] == 1 and metrics["kl"] > 1e-6


def test_a_truncated_step_is_worth_its_final_observation():
    critics, normaliser = Critics(1, D, (8,), torch.Generator().manual_seed(0)), Normaliser(D, enabled=False)
    learner = learner_for("PPO", SPACES["Discrete"])
    cut = torch.zeros(T, N, dtype=torch.bool)
    cut[6, 2] = True
    final = torch.full((1, D), 0.7)
    rollout = rollout_of(
        learner,
        terminated=torch.zeros(T, N, dtype=torch.bool),
        truncated=cut,
        final_index=torch.tensor([6 * N + 2]),
        final_obs=final,
    )
    samples = samples_of(rollout, critics, normaliser, [Signal(rollout.rewards, 0.9, 0.0)])
    with torch.no_grad():
        expected = rollout.rewards[6, 2] + 0.9 * critics(final)[0, 0]
        elsewhere = rollout.rewards[6, 1] + 0.9 * critics(rollout.obs[7])[0, 1]
    assert samples.targets.view(T, N)[6, 2].item() == pytest.approx(expected.item(), abs=1e-6)
    assert samples.targets.view(T, N)[6, 1].item() == pytest.approx(elsewhere.item(), abs=1e-6)


def test_critics_computed_together_are_those_computed_alone():
    critics = Critics(2, D, (8, 8), torch.Generator().manual_seed(0))
    x = torch.randn(7, D)
    for k in range(2):
        hidden = x
        for layer, (weight, bias) in enumerate(zip(critics.weights, critics.biases, strict=True)):
            hidden = hidden @ weight[k] + bias[k]
            hidden = hidden.tanh() if layer < 2 else hidden
        assert torch.allclose(critics(x)[k], hidden.squeeze(-1), atol=1e-6)


def focops(**settings) -> FOCOPS:
    return learner_for("FOCOPS", SPACES["Discrete"], **settings)


def test_the_multiplier_of_focops_moves_before_the_policy():
    learner = focops(cost_limit=0.1, multiplier_rate=0.5, multiplier_gain=0.0)
    assert learner.update(rollout_of(learner), FEEDBACK)["multiplier"] == pytest.approx(0.2)


def test_before_any_episode_the_multiplier_stays():
    learner = focops(multiplier_initial=0.3)
    nothing = dataclasses.replace(FEEDBACK, cost_mean=math.nan, cost_episodes=0, episodes=0)
    assert learner.update(rollout_of(learner), nothing)["multiplier"] == 0.3


def test_a_limit_that_can_not_bind_is_named():
    found = focops(cost_limit=25.0).warnings(FEEDBACK)
    assert list(found) == ["limit_never_binds"] and "none of 30 episodes cost more than 1" in found["limit_never_binds"]


def test_a_multiplier_that_can_not_get_anywhere_is_named():
    settings = {"cost_limit": 0.1, "multiplier_rate": 1e-4, "multiplier_gain": 0.0}
    assert list(focops(**settings).warnings(FEEDBACK)) == ["multiplier_too_slow"]
    assert list(focops(**settings, multiplier_rule="adam").warnings(FEEDBACK)) == ["multiplier_too_slow"]
    assert not focops().warnings(FEEDBACK)


def test_too_few_episodes_say_nothing_about_the_limit():
    few = dataclasses.replace(FEEDBACK, episodes=5)
    assert not focops(cost_limit=25.0).warnings(few)


def test_the_reach_of_a_multiplier():
    multiplier = Multiplier(FOCOPSConfig(cost_limit=0.5, multiplier_rate=0.1, multiplier_gain=0.0))
    assert multiplier.reach(10, 1.0) == pytest.approx(0.5)
    assert multiplier.reach(1000, 1.0) == 2.0
