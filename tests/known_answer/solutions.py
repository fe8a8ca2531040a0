"""Exact outcomes of given policies and of the best policies, by linear programmes and by enumeration.

A limit is one number for the total cost or K numbers, one for each kind; `np.inf` asks for nothing.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import linprog

from tests.known_answer.problems import ACTIONS, Problem

Limit = float | Sequence[float]
SLACK = 1e-9
"""Tolerance of rounding errors, for limits and for equal values."""


@dataclass(frozen=True)
class Outcome:
    """Expected return, costs and length of an episode of a policy."""

    policy: np.ndarray
    """[S, 9] probabilities of actions."""
    reward: float
    """Undiscounted return."""
    costs: np.ndarray
    """[K] undiscounted cost of each kind."""
    length: float
    """Number of steps of an episode."""

    @property
    def cost(self) -> float:
        """Total cost of all kinds."""
        return float(self.costs.sum())


def outcome(problem: Problem, policy: np.ndarray) -> Outcome:
    """Return the outcome of a policy [S, 9] from its visits x = start + Fᵀ x, F the policy's transitions."""
    flow = np.einsum("sa,sak->sk", policy, problem.flow)
    visits = np.linalg.solve(np.eye(problem.states) - flow.T, problem.start)
    taken = visits[:, None] * policy
    costs = np.einsum("sa,sak->k", taken, problem.risk)
    return Outcome(policy, float((taken * problem.reward).sum()), costs, float(visits.sum()))


def optimum(problem: Problem, limit: Limit = np.inf) -> Outcome:
    """Return the best policy whose expected cost is within the limit.

    The linear programme over visits x(s, a) ≥ 0 (Altman 1999, chapter 3):
    max Σ x r,  Σ_a x(s', a) - Σ_{s,a} x(s, a) p(s' | s, a) = start(s'),  Σ x c_k ≤ limit_k
    """
    table, bounds = _limited(problem, limit)
    finite = np.isfinite(bounds)
    leaving = np.kron(np.eye(problem.states), np.ones(ACTIONS))
    found = linprog(
        -problem.reward.ravel(),
        A_ub=table.reshape(-1, len(bounds)).T[finite] if finite.any() else None,
        b_ub=bounds[finite] if finite.any() else None,
        A_eq=leaving - problem.flow.reshape(-1, problem.states).T,
        b_eq=problem.start,
    )
    if not found.success:
        raise ValueError(f"no policy for {problem.name} keeps the limit {limit}: {found.message}")
    visits = found.x.reshape(problem.states, ACTIONS).clip(min=0.0)
    total = visits.sum(1, keepdims=True)
    policy = np.where(total > 0.0, visits / np.where(total > 0.0, total, 1.0), 1.0 / ACTIONS)
    return outcome(problem, policy)


def best_deterministic(problem: Problem, limit: Limit = np.inf) -> Outcome:
    """Return the best deterministic policy within the limit, by enumeration of all 9^S."""
    options, rewards, costs = _every_deterministic(problem)
    _, bounds = _limited(problem, limit)
    paid = costs if len(bounds) == problem.kinds else costs.sum(1, keepdims=True)
    kept = (paid <= bounds + SLACK).all(1)
    if not kept.any():
        raise ValueError(f"no deterministic policy for {problem.name} keeps the limit {limit}")
    best = np.where(kept, rewards, -np.inf).argmax()
    return outcome(problem, np.eye(ACTIONS)[options[best]])


def planned(
    problem: Problem, limit: Limit, horizon: int, *, length: float, terminal: np.ndarray | None = None
) -> Outcome:
    """Return the outcome of a perfect planner that knows the tables and plans H steps at every step.

    At each decision, in state s, it chooses among all 9^H sequences of actions the one with

        max E[Σ_{t<H} r_t + V(s_H)]  subject to  E[Σ_{t<H} c_t] ≤ limit · min(H / L, 1)

    and executes its first action. Expectations are over the noise, to which a sequence does not react (open loop), and
    sums end with the episode. Nothing is discounted, L is the mean length of an episode in steps, and V is `terminal`
    [S], by default 0. If no sequence keeps its share of the limit, the cheapest is chosen. Of equally good sequences,
    the cheapest are chosen; if these have different first actions, each of them has the same probability.

    Every decision has the same budget, whatever earlier ones cost. Such a planner may stay below the limit, since it
    cannot save for a risk greater than its budget, and may exceed it, since it can spend the budget of H steps at every
    step. The requirement on a planner is therefore the budget of each decision, not the limit itself.
    """
    table, bounds = _limited(problem, limit)
    value = np.zeros(problem.states) if terminal is None else terminal
    policy = np.zeros((problem.states, ACTIONS))
    for state in range(problem.states):
        reward, costs = zip(
            *(_sequences(problem, table, value, state, a, horizon) for a in range(ACTIONS)), strict=True
        )
        policy[state] = _first_actions(np.stack(reward), np.stack(costs), bounds * min(horizon / length, 1.0))
    return outcome(problem, policy)


def _sequences(
    problem: Problem, table: np.ndarray, terminal: np.ndarray, state: int, first: int, horizon: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return expected reward [9^(H-1)] and costs [9^(H-1), K] of every sequence that starts with `first` in `state`."""
    reward, costs = problem.reward[state, [first]], table[state, [first]]
    there = problem.flow[state, [first]]
    for _ in range(horizon - 1):
        reward = (reward[:, None] + there @ problem.reward).reshape(-1)
        costs = (costs[:, None] + np.tensordot(there, table, 1)).reshape(-1, table.shape[-1])
        there = np.tensordot(there, problem.flow, 1).reshape(-1, problem.states)
    return reward + there @ terminal, costs


def _first_actions(reward: np.ndarray, costs: np.ndarray, budget: np.ndarray) -> np.ndarray:
    """Return the probability [9] of each first action, from the reward [9, M] and costs [9, M, K] of sequences."""
    kept, total = (costs <= budget + SLACK).all(-1), costs.sum(-1)
    if kept.any():
        best = np.where(kept, reward, -np.inf)
        kept &= reward >= best.max() - SLACK
    else:
        kept = np.ones_like(kept)
    cheapest = np.where(kept, total, np.inf)
    chosen = (cheapest <= cheapest.min() + SLACK).any(1)
    return chosen / chosen.sum()


def _limited(problem: Problem, limit: Limit) -> tuple[np.ndarray, np.ndarray]:
    """Return the limited costs [S, 9, k] and their limits [k]: the total cost (k = 1), or each kind (k = K)."""
    if np.ndim(limit) == 0:
        return problem.risk.sum(-1, keepdims=True), np.atleast_1d(np.asarray(limit, dtype=float))
    bounds = np.asarray(limit, dtype=float)
    if bounds.shape != (problem.kinds,):
        raise ValueError(f"{problem.name} has {problem.kinds} kinds of cost, got the limits {limit}")
    return problem.risk, bounds


@cache
def _every_deterministic(problem: Problem) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return every deterministic policy's actions [P, S], return [P] and costs [P, K], P = 9^S."""
    options = np.array(list(itertools.product(range(ACTIONS), repeat=problem.states)), dtype=np.int8)
    states = np.arange(problem.states)
    rewards, costs = [], []
    for some in np.array_split(options, max(1, len(options) // 8192)):
        leaving = np.eye(problem.states) - problem.flow[states, some].swapaxes(1, 2)
        visits = np.linalg.solve(leaving, np.broadcast_to(problem.start[:, None], (*some.shape, 1)))[..., 0]
        rewards.append((visits * problem.reward[states, some]).sum(1))
        costs.append(np.einsum("ps,psk->pk", visits, problem.risk[states, some]))
    return options, np.concatenate(rewards), np.concatenate(costs)
