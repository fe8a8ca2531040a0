"""Tests of both planners: learning, reports, exact resumption, and every setting that departs from the defaults."""

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch

from tests.algos.planning.planning_fixtures import BOX, OPTIONS, generator
from tests.train.toys import Walk
from thalweg.algos import ALGORITHMS, NotFiniteError
from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.planning.policy import METHODS
from thalweg.algos.planning.safeloop import SafeARC
from thalweg.train import load_policy, run

N, T, D = 4, 16, 5
PLANNERS = list(METHODS)
SMALL: Mapping[str, Any] = {
    "steps_per_collection": N * T,
    "steps_per_update": 2 * N * T,
    "random_steps": N * T,
    "samples": 16,
    "iterations": 2,
    "elites": 4,
    "horizon": 3,
    "members": 3,
    "model_hidden": (16,),
    "hidden": (16,),
    "minibatch": 32,
    "model_steps": 8,
    "critic_steps": 4,
}
FEEDBACK = Feedback(
    progress=0.1,
    steps_left=10_000,
    new_costs=np.array([[1.0], [0.0]]),
    recent_costs=np.array([[1.0], [0.0]]),
    episodes=30,
    largest_costs=(1.0,),
    lowest_costs=(0.5,),
    mean_length=100.0,
)


def learner_for(name: str, space: gym.Space = OPTIONS, seed: int = 0, **settings) -> Any:
    entry = ALGORITHMS[name]
    return entry.make(entry.configure(dict(SMALL) | settings), Task(D, space, N, seed, {}))


def rollout_of(learner: Any, seed: int = 0, **changes) -> Rollout:
    """A rollout with reward 1 for option 0 of the first branch or a positive number, and cost 1 otherwise."""
    gen, costs = generator(seed), len(learner.config.limits)
    newest, frames = torch.randn(T + 1, N, D, generator=gen), learner.config.frame_stack
    obs = torch.cat([newest[(torch.arange(T + 1) - k).clamp(min=0)] for k in reversed(range(frames))], -1)
    fresh = torch.zeros(T + 1, N, dtype=torch.bool)
    actions = torch.stack([learner.act(obs[t], fresh[t]) for t in range(T)])
    good = actions[..., 0] == 0 if actions.dtype == torch.int64 else actions[..., 0] > 0
    never = torch.zeros(T, N, dtype=torch.bool)
    fields = {
        "obs": obs,
        "fresh": fresh,
        "actions": actions,
        "rewards": good.float(),
        "costs": (~good).float().unsqueeze(-1).repeat(1, 1, costs),
        "terminated": torch.rand(T, N, generator=gen) < 0.2,
        "truncated": never,
        "valid": ~never,
        "final_index": torch.zeros(0, dtype=torch.int64),
        "final_obs": torch.zeros(0, obs.shape[-1]),
    }
    return Rollout(**(fields | changes))


def updated(learner: Any, count: int, first: int = 0) -> list[dict[str, float]]:
    return [learner.update(rollout_of(learner, seed), FEEDBACK) for seed in range(first, first + count)]


def same(one: Any, two: Any) -> bool:
    """Whether nested states are bit-identical."""
    if isinstance(one, Mapping):
        return one.keys() == two.keys() and all(same(one[key], two[key]) for key in one)
    if isinstance(one, np.ndarray):
        return one.dtype == two.dtype and one.shape == two.shape and bool((one == two).all())
    return one == two or str(one) == str(two)


@pytest.mark.parametrize("space", [OPTIONS, BOX], ids=["options", "numbers"])
@pytest.mark.parametrize("name", PLANNERS)
class TestEveryPlanner:
    def test_learns_the_rewarded_action(self, name, space):
        learner = learner_for(name, space, model_steps=60, iterations=3)
        updated(learner, 6)
        obs = np.random.default_rng(0).standard_normal((64, D)).astype(np.float32)
        chosen = learner.policy.player(64, generator=generator())(obs, np.ones(64, bool))[:, 0]
        good = (chosen == 0) if space is OPTIONS else (chosen > 0)
        assert good.mean() > 0.9

    def test_restored_learner_resumes_bit_identically(self, name, space):
        learner, other = learner_for(name, space), learner_for(name, space, seed=1)
        updated(learner, 3)
        other.load_state(learner.state())
        assert same(other.state(), learner.state())
        ours, theirs = (updated(one, 2, first=3) for one in (learner, other))
        assert str(ours) == str(theirs) and same(other.state(), learner.state())

    def test_reports_are_on_schedule_with_the_same_names(self, name, space):
        found = updated(learner_for(name, space), 6)
        assert [bool(metrics) for metrics in found] == [False, True] * 3
        assert list(found[1]) == list(found[3]) == list(found[5])
        assert all(math.isfinite(number) for number in found[5].values())

    def test_report_before_any_learning_has_the_same_names(self, name, space):
        learner = learner_for(name, space, drop_terminal=True, steps_per_update=N * T)
        nothing = rollout_of(learner, terminated=torch.ones(T, N, dtype=torch.bool))
        first, second = learner.update(nothing, FEEDBACK), learner.update(rollout_of(learner, 1), FEEDBACK)
        assert math.isnan(first["value_loss"]) and math.isfinite(second["value_loss"])
        assert list(first) == list(second)

    def test_last_update_reports(self, name, space):
        learner = learner_for(name, space)
        assert learner.update(rollout_of(learner), dataclasses.replace(FEEDBACK, steps_left=0))

    def test_nan_reward_raises(self, name, space):
        learner, rewards = learner_for(name, space), torch.zeros(T, N)
        rewards[3, 1] = math.nan
        with pytest.raises(NotFiniteError, match="has become nan"):
            learner.update(rollout_of(learner, rewards=rewards), FEEDBACK)

    def test_nan_in_the_model_raises(self, name, space):
        learner = learner_for(name, space)
        learner.update(rollout_of(learner), FEEDBACK)
        with torch.no_grad():
            learner.policy.ensemble.stack.flat[0] = math.nan
        with pytest.raises(NotFiniteError, match="model_state_loss has become nan"):
            learner.update(rollout_of(learner), FEEDBACK)

    def test_reset_steps_have_no_effect(self, name, space):
        states = []
        for junk in (0.0, 1e6):
            learner, valid = learner_for(name, space), torch.ones(T, N, dtype=torch.bool)
            valid[5::7] = False
            rollout = rollout_of(learner, valid=valid, terminated=~valid.roll(-1, 0))
            rewards = torch.where(valid, rollout.rewards, junk)
            learner.update(dataclasses.replace(rollout, rewards=rewards), FEEDBACK)
            states.append(learner.state())
        assert same(*states)

    def test_critics_wait_until_planning_starts(self, name, space):
        changed = []
        for waits in (False, True):
            learner = learner_for(name, space, critics_wait=waits, random_steps=2 * N * T)
            begin = {key: value.clone() for key, value in learner.policy.method.modules.state_dict().items()}
            for _ in range(2):
                learner.update(rollout_of(learner), FEEDBACK)
                now = learner.policy.method.modules.state_dict()
                changed.append(any(not torch.equal(now[key], value) for key, value in begin.items()))
        assert changed == [True, True, False, True]

    def test_the_budget_tightens_with_a_limit_that_does_and_resumes(self, name, space):
        learner, again = (learner_for(name, space, cost_limit_schedule=(3.0,), cost_limit_share=0.5) for _ in range(2))
        assert learner.policy.limits == pytest.approx((0.3,))
        learner.policy.limits = learner.config.limits_at(0.25)
        again.load_state(learner.state())
        for one in (learner, again):  # halfway from 3 to 1, of 0.1
            steps = one.config.sizes.horizon * one.config.action_repeat
            share = min(steps / one.policy.episode_length, 1.0)
            assert one.policy.budget.costs.tolist() == pytest.approx([0.2 * share])

    def test_a_limit_that_has_been_met_tightens_at_once(self, name, space):
        learner = learner_for(name, space, cost_limit=0.2, cost_limit_schedule=(3.0,), cost_limit_share=0.5)
        for lowest, limit in ((0.3, 0.52), (0.2, 0.2)):  # progress 0.1 of a share of 0.5: 0.2 (3 - 2 / 5)
            learner.update(rollout_of(learner), dataclasses.replace(FEEDBACK, lowest_costs=(lowest,)))
            assert learner.policy.limits == pytest.approx((limit,))

    def test_two_costs_have_separate_budgets(self, name, space):
        learner = learner_for(name, space, cost_limits=(0.1, 0.2), plan_budget="share")
        assert learner.separate_costs
        two = dataclasses.replace(
            FEEDBACK, new_costs=np.ones((2, 2)), recent_costs=np.ones((2, 2)), largest_costs=(1.0, 0.2)
        )
        for seed in range(2):
            metrics = learner.update(rollout_of(learner, seed), two)
        length = metrics["episode_length"]
        assert metrics["budget_tight"] == pytest.approx(0.1 * min(3 / length, 1))
        assert metrics["budget_loose"] == pytest.approx(2 * metrics["budget_tight"])
        assert "plan_cost_loose" in metrics and list(learner.warnings(two)) == ["limit_never_binds_loose"]


@pytest.mark.parametrize("name", PLANNERS)
def test_the_budget_follows_from_what_ended_episodes_and_resumes(name):
    """Episodes of ten steps cost something in the last one only; of the even share a plan could have three tenths."""
    learner, again = (learner_for(name, steps_per_update=N * T) for _ in range(2))
    last = (torch.arange(T) == 9).unsqueeze(-1).expand(T, N)
    rollout = rollout_of(learner, terminated=last, costs=last.float().unsqueeze(-1))
    assert learner.update(rollout, FEEDBACK)["budget"] == pytest.approx(0.1)
    again.load_state(learner.state())
    assert again.policy.budget.costs.tolist() == pytest.approx([0.1])


def test_predictions_are_compared_with_planned_steps_only():
    """The second rollout has none, since it begins before `random_steps` are over."""
    learner = learner_for("CCEPETS", random_steps=N * T * 3 // 2, steps_per_update=N * T)
    found = [math.isnan(metrics["predicted_reward"]) for metrics in updated(learner, 3)]
    assert found == [True, True, False]


@dataclasses.dataclass(frozen=True)
class Variant:
    """Settings that depart from the defaults."""

    settings: Mapping[str, Any]
    column: str
    """Column of the report that they must change."""
    common_settings: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """Settings of both runs."""


VARIANTS = {
    "horizon scale": Variant({"episode_length": 1000}, "feasible_share", {"cost_limit": 2.0}),
    "drop terminal": Variant({"drop_terminal": True}, "replay_size"),
    "no ends": Variant({"predict_end": False}, "plan_reward"),
    "independent noise": Variant({"shared_noise": False}, "plan_reward"),
    "undiscounted": Variant({"planning_discount": 1.0}, "plan_reward"),
    "greedy": Variant({"exploration": 0.0}, "realised_reward"),
    "refit": Variant({"fitting": "refit", "refit_steps": N * T}, "held_out_reward_loss", {"hold_out": 0.2}),
    "fixed bounds": Variant({"fixed_variance_bounds": True}, "held_out_state_loss"),
    "action repeat": Variant({"action_repeat": 5}, "replay_size"),
    "worst particle": Variant({"cost_over": "max"}, "plan_cost"),
    "bfloat16": Variant({"precision": "bfloat16"}, "plan_reward"),
    "literal": Variant({"adapter": "box_literal"}, "realised_reward"),
    "scaled": Variant({"adapter": "box_scaled"}, "realised_reward"),
    "stacked": Variant({"frame_stack": 2}, "held_out_state_loss"),
    "particles": Variant({"particles": 2}, "plan_reward"),
}
SAFELOOP_VARIANTS = {
    # Returns only matter if some candidates are feasible.
    "raw temperatures": Variant({"standardise_returns": False}, "plan_reward", {"cost_limit": 100.0}),
    "decaying alpha": Variant({"auto_alpha": False, "alpha_decay": 0.99}, "alpha"),
    "raw rewards": Variant({"standardise_rewards": False}, "value"),
    "no proposals": Variant({"proposals": 0}, "plan_reward"),
    "no prior": Variant({"proposal_share": 0.0}, "plan_reward", {"proposals": 2}),
}
ALONE = [(name, variant) for name in PLANNERS for variant in VARIANTS] + [
    ("SafeLOOP", variant) for variant in SAFELOOP_VARIANTS
]


@pytest.mark.parametrize(("name", "variant"), ALONE)
def test_each_variant_alone_changes_its_column(name, variant):
    tested = (VARIANTS | SAFELOOP_VARIANTS)[variant]
    found = []
    for settings in ({}, tested.settings):
        learner = learner_for(name, steps_per_update=N * T, **tested.common_settings, **settings)
        found.append(updated(learner, 3)[-1])
    assert all(math.isfinite(number) for metrics in found for number in metrics.values())
    assert found[0][tested.column] != found[1][tested.column]


def test_stale_value_uses_the_last_action_instead_of_the_policys():
    """As in OmniSafe: the state at the end of the horizon with the action that led there."""
    learner = learner_for("SafeLOOP")
    arc = SafeARC(learner.config, learner.policy.actions, D, lambda: torch.tensor(2.0), generator())
    stale = SafeARC(
        learner_for("SafeLOOP", stale_action_value=True).config, arc.actions, D, lambda: torch.tensor(2.0), generator()
    )
    obs, actions = torch.randn(7, D, generator=generator(1)), torch.tensor([[1, 2], [0, 1]]).repeat(4, 1)[:7]
    value, other = arc.value(), stale.value()
    assert value is not None and other is not None
    with torch.no_grad():
        assert torch.equal(value(obs, actions), 2.0 * arc.soft.value(obs))
        assert torch.equal(other(obs, actions), 2.0 * arc.soft.action_value(obs, actions))
        assert not torch.allclose(value(obs, actions), other(obs, actions))


def test_terminal_steps_are_dropped_only_on_request():
    """Terminal costs reach the replay buffer unless `drop_terminal` is set, as in OmniSafe."""
    for drop in (False, True):
        learner = learner_for("CCEPETS", drop_terminal=drop)
        rollout = rollout_of(learner)
        costs = rollout.terminated.float().unsqueeze(-1)
        paid = float(costs.sum())
        learner.update(dataclasses.replace(rollout, costs=costs), FEEDBACK)
        replay = learner.agent.replay
        kept = float(replay.rows(torch.arange(replay.size)).costs.sum())
        assert paid > 0.0
        assert kept == (0.0 if drop else paid)


@pytest.mark.parametrize("name", PLANNERS)
@pytest.mark.slow
def test_paper_preset_runs(name, tmp_path: Path):
    small = {key: SMALL[key] for key in ("samples", "iterations", "model_hidden", "hidden")}
    small |= {"random_steps": 100, "refit_steps": 200, "steps_per_collection": 100, "elites": 8}
    with pytest.warns(UserWarning, match="has not bound anything"):
        result = run(name, Walk(2), steps=600, seed=0, folder=tmp_path, config=small, preset="paper")
    assert result.steps == 600 and load_policy(tmp_path).config.drop_terminal


@pytest.mark.parametrize("name", PLANNERS)
def test_a_warning_names_a_mean_value_that_no_episode_can_pay(name: str):
    learner = learner_for(name, bound_targets=False, return_bounds=(0.0, 2.0), critic_learning_rate=0.0)
    reports = [report for report in updated(learner, 6) if report]
    unit = float(learner.agent.policy.ensemble.reward.std)
    assert learner.agent.value_bounds() == (0.0, 2.0) and math.isfinite(reports[-1]["value"])
    assert learner.agent._last_value == reports[-1]["value"]
    learner.agent._last_value = 1.9 / unit
    assert "impossible_value_of_reward" not in learner.warnings(FEEDBACK)
    learner.agent._last_value = 2.1 / unit
    found = learner.warnings(FEEDBACK)["impossible_value_of_reward"]
    assert (
        "value of the reward is 2.1, more than the 2 that an episode can pay" in found and "set bound_targets" in found
    )
    assert "impossible_value_of_reward" not in learner.warnings(dataclasses.replace(FEEDBACK, episodes=19))
    learner.agent._last_value = -0.1 / unit
    assert "less than the 0 that an episode must pay" in learner.warnings(FEEDBACK)["impossible_value_of_reward"]
    assert "impossible_value_of_reward" not in learner.agent.warnings(FEEDBACK, unit, below=0.2 / unit)


def test_the_warning_advises_bounds_where_none_are_given():
    learner = learner_for("CCEPETS")
    updated(learner, 6)
    learner.agent._last_value = 1e6
    assert learner.warnings(FEEDBACK)["impossible_value_of_reward"].endswith("or set return_bounds")


@pytest.mark.parametrize("name", PLANNERS)
def test_values_are_learnt_within_the_bounds_of_the_settings(name: str):
    learner = learner_for(name, return_bounds=(-1.0, 3.0))
    wild = torch.tensor([99.0, 0.5, -99.0])
    assert learner.agent.bounded(wild, 2.0).tolist() == [1.5, 0.5, -0.5]
    assert learner.agent.bounded(wild, 2.0, above=1.0).tolist() == [2.5, 0.5, -0.5]
    free = learner_for(name)
    assert free.agent.bounded(wild, 2.0).tolist() == wild.tolist()  # no episode has ended
    updated(free, 2)
    assert max(free.agent.bounded(wild, 1.0).tolist()) < 99.0


@pytest.mark.parametrize("bounds", [[1.0], [2.0, 1.0], [0.0, float("inf")]])
def test_bounds_that_are_none_are_refused(bounds: list[float]):
    with pytest.raises(AlgorithmError, match="return_bounds"):
        learner_for("CCEPETS", return_bounds=bounds)


@pytest.mark.parametrize(
    ("space", "entropy_in_targets", "below", "most"),
    [
        (OPTIONS, True, 0.0, math.log(6)),
        (OPTIONS, False, 0.0, math.log(6)),
        (BOX, True, math.inf, 2 * math.log(2)),
        (BOX, False, 0.0, 2 * math.log(2)),
    ],
)
@pytest.mark.parametrize(("discount", "decisions"), [(0.9, 10.0), (1.0, 1000.0)])
def test_soft_values_may_lie_beyond_what_an_episode_pays_by_the_entropy_of_its_decisions(
    space: gym.Space, entropy_in_targets: bool, below: float, most: float, discount: float, decisions: float
):
    """An entropy is between 0 and ln 6 for six joint actions, and at most ln 4 for two numbers in -1..1."""
    learner = learner_for("SafeLOOP", space, discount=discount, entropy_in_targets=entropy_in_targets)
    found = learner._entropy_slack(torch.tensor(0.5))
    assert (found[0], float(found[1])) == (below, pytest.approx(0.5 * most * decisions, rel=1e-5))
