"""Tests of the share of costs that end episodes."""

import dataclasses

import pytest
import torch

from tests.algos.planning.planning_fixtures import rollout_of
from thalweg.algos.planning.ending_costs import EndingCosts

T, N = 6, 2


def rollout(**costs_at: list[tuple[int, int]]) -> dict[str, torch.Tensor]:
    """Changes of a rollout; each keyword names (step, environment) of a first cost of 1, a second of 0.2, or an end."""
    costs, ends = torch.zeros(T, N, 2), torch.zeros(T, N, dtype=torch.bool)
    for step, env in costs_at.get("first", []):
        costs[step, env, 0] = 1.0
    for step, env in costs_at.get("second", []):
        costs[step, env, 1] = 0.2
    for step, env in costs_at.get("ends", []):
        ends[step, env] = True
    return {"costs": costs, "terminated": ends}


def shares_of(**changes) -> tuple[float, ...]:
    found = EndingCosts(2)
    found.update(dataclasses.replace(rollout_of(T, N, costs=2), **changes))
    return found.shares


def test_no_cost_and_no_steps_have_no_share():
    assert EndingCosts(2).shares == (0.0, 0.0)
    assert shares_of(**rollout(ends=[(3, 0)])) == (0.0, 0.0)


def test_costs_that_always_end_an_episode_have_the_whole_share_and_others_none():
    found = shares_of(**rollout(first=[(1, 0), (4, 1)], second=[(2, 0), (3, 1)], ends=[(1, 0), (4, 1)]))
    assert found == (pytest.approx(1.0), 0.0)


def test_a_share_is_at_most_whole_where_some_costs_are_negative():
    """Five steps that cost -0.1 and a last one that costs 1: twice what the episode cost, and no share of it."""
    costs, ends = torch.full((T, N, 2), -0.1), torch.zeros(T, N, dtype=torch.bool)
    costs[-1], ends[-1] = 1.0, True
    assert shares_of(costs=costs, terminated=ends) == (1.0, 1.0)


def test_a_cost_that_coincides_with_ends_by_chance_has_no_share():
    """Three of twelve steps are last ones, and of four costs one comes with them, as expected; then three of four."""
    ends, others = [(1, 0), (3, 0), (4, 1)], [(0, 0), (0, 1), (2, 1)]
    found = shares_of(**rollout(first=[ends[0], *others], second=[*ends, others[0]], ends=ends))
    assert found == (0.0, pytest.approx((0.75 - 0.25) / 0.75))


def test_a_truncation_ends_no_episode_and_skipped_steps_do_not_count():
    given = rollout(first=[(1, 0), (4, 1)], ends=[(4, 1)])
    cut = torch.zeros(T, N, dtype=torch.bool)
    cut[1, 0] = True
    assert shares_of(**given, truncated=cut)[0] == pytest.approx((0.5 - 1 / 12) / (11 / 12))
    valid = torch.ones(T, N, dtype=torch.bool)
    valid[1, 0] = False
    assert shares_of(**given, valid=valid)[0] == pytest.approx(1.0)


def test_shares_survive_a_checkpoint():
    found, again = EndingCosts(2), EndingCosts(2)
    steps = rollout(first=[(1, 0), (2, 0)], ends=[(1, 0)])
    found.update(dataclasses.replace(rollout_of(T, N, costs=2), **steps))
    again.load_state(found.state())
    assert again.shares == found.shares != (0.0, 0.0)
