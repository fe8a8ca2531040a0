"""Tests of the exact solutions, each against an independent computation."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from tests.known_answer.problems import ACTIONS, PROBLEMS, Problem
from tests.known_answer.solutions import best_deterministic, optimum, outcome, planned


@pytest.fixture(params=list(PROBLEMS))
def problem(request: pytest.FixtureRequest) -> Problem:
    return PROBLEMS[request.param]


def value_iteration(problem: Problem, reward: np.ndarray) -> float:
    """The most that episodes can pay by a reward [S, 9], without a linear programme."""
    value = np.zeros(problem.states)
    for _ in range(400):
        value = (reward + problem.flow @ value).max(1)
    return float(problem.start @ value)


def summed(problem: Problem, choice: tuple[int, ...]) -> tuple[float, np.ndarray]:
    """Return and costs [K] of a deterministic policy, step by step, without a system of equations."""
    there, reward, costs = problem.start, 0.0, np.zeros(problem.kinds)
    for _ in range(250):
        reward += sum(there[s] * problem.reward[s, a] for s, a in enumerate(choice))
        costs = costs + sum(there[s] * problem.risk[s, a] for s, a in enumerate(choice))
        there = sum((there[s] * problem.flow[s, a] for s, a in enumerate(choice)), np.zeros(problem.states))
    return reward, costs


def test_moves_and_starts_are_probabilities(problem: Problem):
    assert problem.start.sum() == pytest.approx(1.0)
    assert problem.move.sum(-1) == pytest.approx(np.ones((problem.states, ACTIONS)))


def test_the_linear_programme_agrees_with_value_iteration(problem: Problem):
    assert optimum(problem).reward == pytest.approx(value_iteration(problem, problem.reward), rel=1e-9)


def test_the_limited_optimum_agrees_with_its_dual(problem: Problem):
    """max R within C ≤ d is the least of max (R - λ (C - d)) over λ ≥ 0, found on a grid of multipliers."""
    limit = sum(problem.limits)
    total = problem.risk.sum(-1)
    bounds = [value_iteration(problem, problem.reward - m * total) + m * limit for m in np.arange(0.0, 12.0, 0.25)]
    best = optimum(problem, limit).reward
    assert best <= min(bounds) + 1e-9
    assert best == pytest.approx(min(bounds), rel=0.01)


def test_the_mixture_is_the_one_worked_out_by_hand():
    problem = PROBLEMS["mixture"]
    rapids = 1.0 / (1.0 - 0.9**2)
    share = 0.35 / (0.2 * rapids)
    best = optimum(problem, problem.limits)
    assert share == pytest.approx(0.3325)
    assert best.reward == pytest.approx(rapids * (0.4 + 0.6 * share + 0.45))
    assert best.reward == pytest.approx(5.523684, abs=1e-6)
    assert best.cost == pytest.approx(0.35)
    assert best.policy[0, [3, 6]] == pytest.approx([1.0 - share, share])
    assert (optimum(problem).reward, optimum(problem).cost) == pytest.approx((145 / 19, 20 / 19))
    assert best_deterministic(problem, problem.limits).reward == pytest.approx(85 / 19)


def test_every_limit_binds(problem: Problem):
    """Who ignores a limit breaks it by half, who takes it for two fifths of it misses nine tenths of the return."""
    best, limits = optimum(problem, problem.limits), problem.limits
    assert best.costs == pytest.approx(limits)
    for kind, limit in enumerate(limits):
        ignored = optimum(problem, (*limits[:kind], np.inf, *limits[kind + 1 :]))
        assert ignored.costs[kind] > 1.5 * limit
        careful = optimum(problem, (*limits[:kind], 0.4 * limit, *limits[kind + 1 :]))
        assert careful.reward < 0.9 * best.reward
    assert optimum(problem).reward > best.reward / 0.9
    assert (optimum(problem).costs > 1.5 * np.array(limits)).all()


def test_a_limit_on_the_sum_is_not_one_on_each():
    problem = PROBLEMS["two"]
    together = optimum(problem, sum(problem.limits))
    assert (together.costs / problem.limits).max() > 1.5


def test_limits_that_nobody_can_keep_are_refused():
    problem = replace(PROBLEMS["mixture"], risk=np.full((2, ACTIONS, 1), 0.5))
    for solve in (optimum, best_deterministic):
        with pytest.raises(ValueError, match="for mixture keeps the limit"):
            solve(problem, 0.1)
    with pytest.raises(ValueError, match="1 kinds of cost"):
        optimum(problem, (0.1, 0.1))


def test_the_best_deterministic_policy_is_the_best_of_all():
    problem = PROBLEMS["mixture"]
    every = [summed(problem, choice) for choice in itertools.product(range(ACTIONS), repeat=problem.states)]
    for limit in (0.0, 0.35, 0.9, 2.0):
        best = max(reward for reward, costs in every if costs.sum() <= limit + 1e-9)
        assert best_deterministic(problem, limit).reward == pytest.approx(best)


def test_no_deterministic_policy_tried_is_better(problem: Problem):
    best, generator = best_deterministic(problem, problem.limits), np.random.default_rng(0)
    assert (best.costs <= np.array(problem.limits) + 1e-9).all()
    assert best.reward <= optimum(problem, problem.limits).reward + 1e-9
    found = tuple(best.policy.argmax(1))
    assert summed(problem, found)[0] == pytest.approx(best.reward)
    for _ in range(30):
        # Neighbours: one state does something else.
        state, action = generator.integers(problem.states), int(generator.integers(ACTIONS))
        reward, costs = summed(problem, (*found[:state], action, *found[state + 1 :]))
        assert reward <= best.reward + 1e-9 or (costs > problem.limits).any()


def paths(problem: Problem, state: int, sequence: tuple[int, ...]) -> tuple[float, np.ndarray]:
    """Expected reward and costs [K] of a sequence of actions, path by path."""
    action, *rest = sequence
    reward, costs = problem.reward[state, action], problem.risk[state, action]
    if rest:
        for following in range(problem.states):
            chance = problem.flow[state, action, following]
            later, paid = paths(problem, following, tuple(rest))
            reward, costs = reward + chance * later, costs + chance * paid
    return reward, costs


@pytest.mark.parametrize("kind", ["mixture", "two"])
def test_a_planner_takes_the_first_action_of_the_best_sequence_within_its_budget(kind: str):
    problem, horizon, length = PROBLEMS[kind], 2, 10.0
    budget = np.array(problem.limits) * horizon / length
    policy = planned(problem, problem.limits, horizon, length=length).policy
    for state in range(problem.states):
        every = {s: paths(problem, state, s) for s in itertools.product(range(ACTIONS), repeat=horizon)}
        kept = {s: reward for s, (reward, costs) in every.items() if (costs <= budget + 1e-9).all()}
        best = [s for s in kept if kept[s] >= max(kept.values()) - 1e-9] or list(every)
        least = min(every[s][1].sum() for s in best)
        first = {s[0] for s in best if every[s][1].sum() <= least + 1e-9}
        assert set(np.flatnonzero(policy[state])) == first


def test_a_planner_that_sees_further_than_an_episode_lasts_keeps_the_limit_not_more():
    problem = PROBLEMS["mixture"]
    short, long = (planned(problem, 0.1, 3, length=length).policy for length in (0.5, 3.0))
    assert np.array_equal(short, long)
    assert short[0, 6] == 0.0  # full pace in the rapids costs 0.2: more than the limit, less than six of them


def test_a_planner_that_can_keep_no_budget_does_what_is_cheapest():
    problem = PROBLEMS["mixture"]
    risk = problem.risk.copy()
    risk[0] = np.arange(1, ACTIONS + 1)[:, None] / 10.0
    cheapest = planned(replace(problem, risk=risk), 0.01, 1, length=10.0).policy
    assert cheapest[0].argmax() == 0 and cheapest[0].max() == 1.0


def test_a_planner_without_limit_and_with_the_true_value_behind_its_horizon_is_the_best():
    problem = PROBLEMS["mixture"]
    best = optimum(problem)
    flow = np.einsum("sa,sak->sk", best.policy, problem.flow)
    value = np.linalg.solve(np.eye(problem.states) - flow, (best.policy * problem.reward).sum(1))
    assert planned(problem, np.inf, 2, length=10.0, terminal=value).reward == pytest.approx(best.reward)


def test_what_planners_are_held_against_keeps_the_limits(problem: Problem):
    best = optimum(problem, problem.limits)
    seen = planned(problem, problem.limits, 5, length=best.length)
    assert (seen.costs <= np.array(problem.limits) + 1e-9).all()
    assert seen.reward >= 0.75 * best.reward


def test_the_outcome_of_a_policy_agrees_with_its_steps(problem: Problem):
    choice = tuple(np.random.default_rng(1).integers(ACTIONS, size=problem.states))
    reward, costs = summed(problem, choice)
    exact = outcome(problem, np.eye(ACTIONS)[list(choice)])
    assert (exact.reward, *exact.costs) == pytest.approx((reward, *costs))
