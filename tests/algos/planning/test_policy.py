"""Tests of planning policies: decisions in a known model, plans between decisions, saved files, settings."""

import dataclasses
import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch

from tests.algos.planning.planning_fixtures import BOX, OPTIONS, generator
from thalweg.algos import AlgorithmError
from thalweg.algos.common.state import CPU
from thalweg.algos.planning.ccepets import CCEPETSConfig
from thalweg.algos.planning.planner import Planner
from thalweg.algos.planning.policy import METHODS, VALUES_BEFORE, PlannerPlayer, PlannerPolicy
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.player import to_tensors
from thalweg.algos.policy.policy_file import About, load_policy
from thalweg.algos.registry import ALGORITHMS
from thalweg.core.config import to_plain

PLANNERS = list(METHODS)
D, N = 3, 4


def policy_for(name: str = "CCEPETS", space: gym.Space = OPTIONS, adapter: Any = "native", **settings) -> PlannerPolicy:
    """A planner with a model of its own; an untrained actor, which proposes at random, has no part in initial plans."""
    given = {"size": "lite", "members": 3, "model_hidden": (8,), "hidden": (8,)}
    given |= {"proposal_share": 0.0} if name == "SafeLOOP" else {}
    config = ALGORITHMS[name].config(adapter=adapter, **(given | settings))
    actions = actions_of(space, adapter, "squashed")
    return PlannerPolicy(D, actions, config, About(name, to_plain(config)), generator())


def told(policy: PlannerPolicy, *, reward: float, cost: float = -1e3) -> PlannerPolicy:
    """Nothing ever changes or ends in its model; option 1 of the first branch (or a number of 1) pays `reward`, and has
    `cost` for the logit of a cost of 1, which option 0 (or a number of -1) never has."""
    ensemble = policy.ensemble
    ensemble.stack.flat.data.zero_()
    (first, _), (last, bias) = ensemble.stack.layers
    chosen = D + (1 if ensemble.actions.kind == "categorical" else 0)
    first[:, chosen, 0] = 20.0  # swish(20) is 20, and swish(0) is 0
    parts = ensemble.layout.slices
    last[:, 0, parts[1]] = reward / 20.0
    last[:, 0, parts[3]] = (cost + 1e3) / 20.0
    bias[..., parts[3]], bias[..., parts[4]], bias[..., parts[2]] = -1e3, -1e3, -1e3
    policy.refresh()
    return policy


def acts(policy: PlannerPolicy, steps: int = 3) -> np.ndarray:
    """[steps, N, A]."""
    player = policy.player(N, generator=generator(5))
    obs = np.random.default_rng(0).standard_normal((steps, N, D)).astype(np.float32)
    fresh = np.zeros(N, dtype=bool)
    return np.stack([player(obs[t], fresh | (t == 0)) for t in range(steps)])


@pytest.mark.parametrize("name", PLANNERS)
@pytest.mark.parametrize(
    ("space", "adapter"),
    [
        (OPTIONS, "native"),
        (OPTIONS, "box_scaled"),
        (OPTIONS, "box_literal"),
        (BOX, "native"),
        (gym.spaces.Discrete(4), "native"),
    ],
)
class TestEverySpace:
    def test_actions_belong_to_the_space(self, name, space, adapter):
        for action in acts(policy_for(name, space, adapter)).reshape(-1, *space.shape):
            assert space.contains(action if action.shape else np.int64(action))

    def test_a_saved_policy_acts_as_before(self, name, space, adapter, tmp_path):
        policy = policy_for(name, space, adapter)
        policy.ensemble.observed.update(torch.randn(50, D, generator=generator(1)) * 3)
        policy.ensemble.reward.update(torch.randn(50, 1, generator=generator(1)) * 3)
        policy.episode_length = 123.0
        policy.refresh()
        policy.ending_shares = (0.25,)
        policy.save(tmp_path / "policy.safetensors")
        loaded = load_policy(tmp_path / "policy.safetensors")
        assert isinstance(loaded, PlannerPolicy) and loaded.about == policy.about
        assert torch.equal(loaded.budget.costs, policy.budget.costs)
        assert np.array_equal(acts(loaded), acts(policy))


@pytest.mark.parametrize("name", PLANNERS)
class TestEveryPlanner:
    def test_chooses_the_rewarded_action(self, name):
        assert (acts(told(policy_for(name, iterations=4), reward=1.0))[..., 0] == 1).all()
        assert (acts(told(policy_for(name, iterations=4), reward=-1.0))[..., 0] != 1).all()

    def test_avoids_the_rewarded_action_if_it_exceeds_the_limit(self, name):
        policy = told(policy_for(name, iterations=4, horizon=7, episode_length=7), reward=1.0, cost=0.0)
        assert (acts(policy)[..., 0] != 1).all()  # half a cost a step, against a budget of 0.1 for 7

    def test_chooses_the_costly_action_if_the_limit_allows_it(self, name):
        policy = told(policy_for(name, iterations=4, horizon=7, episode_length=7, cost_limit=4.0), reward=1.0, cost=0.0)
        assert (acts(policy)[..., 0] == 1).all()

    def test_continuous_actions_move_towards_the_reward(self, name):
        found = acts(told(policy_for(name, BOX, iterations=6), reward=1.0))
        assert found[..., 0].min() > 0.6

    def test_decisions_do_not_depend_on_other_environments(self, name, monkeypatch):
        """With the draws of one environment repeated for each, all of them decide what it decides alone."""
        policy = policy_for(name, **{"shared_noise": False, **({"proposals": 0} if name == "SafeLOOP" else {})})
        obs = np.random.default_rng(3).standard_normal((1, D)).astype(np.float32)
        drawn = {"rand": torch.rand, "randn": torch.randn}

        def repeated(kind: str, axis_of_envs: int):
            def draw(*shape: Any, dtype: Any = None, generator: Any = None, device: Any = None) -> torch.Tensor:
                sizes = list(shape[0] if isinstance(shape[0], tuple) else shape)
                axis = 0 if kind == "rand" else axis_of_envs
                count, sizes[axis] = sizes[axis], 1
                return drawn[kind](sizes, dtype=dtype, generator=generator).repeat_interleave(count, axis)

            return draw

        monkeypatch.setattr(torch, "rand", repeated("rand", 0))
        monkeypatch.setattr(torch, "randn", repeated("randn", 2))  # noise is [H, M, N, ...]
        plans = []
        for envs in (1, 5):
            player = PlannerPlayer(policy, envs, generator(2))
            for step in range(2):
                player.raw(*to_tensors(obs.repeat(envs, 0), np.full(envs, step == 0), CPU))
            plans.append(player._plans)
        assert torch.allclose(plans[1], plans[0].expand_as(plans[1]), atol=1e-5)

    def test_frames_are_stacked(self, name):
        policy = policy_for(name, frame_stack=3)
        beside = PlannerPlayer(policy, N, generator(5), stacked=True)
        alone = policy.player(N, generator=generator(5))
        obs = np.random.default_rng(0).standard_normal((4, N, D)).astype(np.float32)
        shown = [np.concatenate([obs[max(t - 2, 0)], obs[max(t - 1, 0)], obs[t]], 1) for t in range(4)]
        for t in range(4):
            fresh = np.full(N, t == 0)
            assert np.array_equal(
                policy.actions.to_numpy(beside.raw(*to_tensors(shown[t], fresh, CPU))[0]), alone(obs[t], fresh)
            )


def test_a_plan_persists_until_its_episode_ends(monkeypatch):
    policy, guesses = policy_for(), []
    before = Planner.decide

    def decide(self, frozen, start, guess, budget, generator):
        guesses.append(guess.clone())
        return before(self, frozen, start, guess, budget, generator)

    monkeypatch.setattr(Planner, "decide", decide)
    player, obs = policy.player(N, generator=generator()), np.zeros((N, D), np.float32)
    player(obs, np.ones(N, bool))
    plans = player._plans.clone()
    player(obs, np.array([False, True, False, False]))
    first, shifted = policy.planner.distribution.first(N), policy.planner.distribution.shifted(plans)
    assert torch.equal(guesses[0], first)
    assert torch.equal(guesses[1][1], first[1])
    assert torch.equal(guesses[1][[0, 2, 3]], shifted[[0, 2, 3]])


def test_a_repeated_action_lasts_until_its_episode_ends():
    policy = policy_for(action_repeat=3)
    player, obs = policy.player(2, generator=generator()), np.zeros((2, D), np.float32)
    decided = []
    for t in range(6):
        decision = player.raw(*to_tensors(obs, np.array([t == 0, t in (0, 2)]), CPU))[1]
        decided.append(0 if decision is None else len(decision.reward))
    assert decided == [2, 0, 1, 1, 0, 1]


def test_budget_is_the_share_of_each_limit_within_the_horizon():
    policy = policy_for(cost_limits=(0.1, 0.2), horizon=5, action_repeat=2)
    policy.episode_length = 40.0
    assert policy.budget.costs.tolist() == pytest.approx([0.1 * 10 / 40, 0.2 * 10 / 40])
    assert policy.budget.per_episode == pytest.approx(4.0)


def test_budget_of_costs_that_end_episodes_is_the_whole_limit():
    budgets = []
    for kind in ("ends", "share"):
        policy = policy_for(cost_limits=(0.1, 0.2), horizon=5, action_repeat=2, plan_budget=kind)
        policy.episode_length = 40.0
        assert policy.budget.costs.tolist() == pytest.approx([0.025, 0.05])
        policy.ending_shares = (1.0, 0.5)
        budgets.append(policy.budget.costs.tolist())
    assert budgets == [pytest.approx([0.1, 0.1 + 0.025]), pytest.approx([0.025, 0.05])]


def test_a_file_without_newer_settings_plans_as_when_it_was_saved(tmp_path):
    policy = policy_for("SafeLOOP", proposal_share=0.5)
    for name in VALUES_BEFORE:
        del policy.about.config[name]
    policy.save(tmp_path / "policy.safetensors")
    loaded = load_policy(tmp_path / "policy.safetensors")
    assert isinstance(loaded, PlannerPolicy) and loaded.config.plan_budget == "share"
    assert loaded.planner.method.proposal_share == 0.0 and policy.planner.method.proposal_share == 0.5
    assert loaded.config.sizes.samples == 64


def test_terminal_value_affects_decisions():
    """A critic that loves what the model says will follow from option 1 draws the plan there, though nothing pays."""
    policy = told(policy_for(iterations=4), reward=0.0)
    (_, _), (last, _) = policy.ensemble.stack.layers
    last[:, 0, 0] = 1.0 / 20.0  # the first number grows by 1 with each option 1
    policy.refresh()
    critic: Any = policy.method
    critic.critic.forward = lambda obs: obs[:, :1].T
    assert (acts(policy)[..., 0] == 1).mean() > 0.9
    critic.critic.forward = lambda obs: -obs[:, :1].T
    assert (acts(policy)[..., 0] != 1).mean() > 0.9


@pytest.mark.parametrize("name", PLANNERS)
def test_observations_of_another_size_are_refused(name):
    with pytest.raises(AlgorithmError, match=r"takes observations \[N, 3\], got an array of shape \(4, 9\)"):
        policy_for(name).player(N)(np.zeros((N, 9), np.float32), np.ones(N, bool))


@pytest.mark.parametrize("name", PLANNERS)
def test_an_unsupported_space_is_refused(name):
    with pytest.raises(AlgorithmError, match="must be Discrete, MultiDiscrete"):
        policy_for(name, gym.spaces.MultiBinary(3))


def test_only_safeloop_refuses_too_many_joint_actions():
    space = gym.spaces.MultiDiscrete([3] * 10)
    with pytest.raises(AlgorithmError, match=r"59,049, more than 4,096: use adapter='box_scaled'"):
        policy_for("SafeLOOP", space)
    assert policy_for("SafeLOOP", space, "box_scaled").actions.count == 10
    assert policy_for("CCEPETS", space).actions.count == 10


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"elites": 49}, "elites must be from 1 to 48, the samples, got 49"),
        ({"horizon": -1}, "horizon must be a whole number of at least 0"),
        ({"hold_out": 0.0}, "hold_out must be a number above 0 and at most 0.5, got 0.0"),
        ({"hold_out": 0.6}, "hold_out must be a number above 0 and at most 0.5, got 0.6"),
        ({"rarity": 0.5}, "rarity must be a number of at least 1"),
        ({"hidden": (64, 0)}, "hidden.* must be a whole number from 1 to 65536"),
        ({"cost_limit": 0.0}, "cost_limit must be a finite number above 0 .a predicted chance is never 0., got 0.0"),
        ({"cost_limit": math.inf}, "cost_limit must be a finite number above 0"),
        ({"cost_limits": (0.1, 0.0)}, r"cost_limits\[1\] must be a finite number above 0 .a predicted chance"),
        ({"cost_limits": (0.1, math.inf)}, r"cost_limits\[1\] must be a finite number above 0"),
        ({"cost_limits": (0.1,)}, r"cost_limits must be two, tight and loose, got \[0.1\]"),
        ({"frame_stack": 0}, "frame_stack must be a whole number above 0"),
        (
            {"frame_stack": 2, "action_repeat": 2},
            "frame_stack must be 1 with an action_repeat, got 2: the model sees no frames",
        ),
    ],
)
def test_settings_out_of_range_are_refused_by_name(changes, words):
    with pytest.raises(AlgorithmError, match=words):
        CCEPETSConfig(**changes)


def test_full_sizes_are_the_published_ones_and_given_sizes_override_them():
    full = CCEPETSConfig(size="full", iterations=3).sizes
    assert dataclasses.astuple(full) == (512, 4, 3, 64, 7, (200, 200, 200, 200))
