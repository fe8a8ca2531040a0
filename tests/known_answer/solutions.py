"""What is the best that a policy can reach, and what does a given policy reach? Exact, by linear programmes and by
enumeration.

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
"""By how much rounding may break a limit, and how near two values are the same."""


@dataclass(frozen=True)
class Outcome:
    """What a policy has in store, in expectation over episodes."""

    policy: np.ndarray
    """[S, 9] of probabilities."""
    reward: float
    """Undiscounted return."""
    costs: np.ndarray
    """[K] undiscounted cost of each kind."""
    length: float
    """Steps of an episode."""

    @property
    def cost(self) -> float:
        """Of all kinds together."""
        return float(self.costs.sum())


def outcome(problem: Problem, policy: np.ndarray) -> Outcome:
    """The outcome of a policy [S, 9]: from its visits x = start + Fᵀ x, F the policy's transitions."""
    flow = np.einsum("sa,sak->sk", policy, problem.flow)
    visits = np.linalg.solve(np.eye(problem.places) - flow.T, problem.start)
    taken = visits[:, None] * policy
    costs = np.einsum("sa,sak->k", taken, problem.risk)
    return Outcome(policy, float((taken * problem.reward).sum()), costs, float(visits.sum()))


def optimum(problem: Problem, limit: Limit = np.inf) -> Outcome:
    """The best policy whose expected cost is within the limit.

    The linear programme over visits x(s, a) ≥ 0 (Altman 1999, chapter 3):
    max Σ x r,  Σ_a x(s', a) - Σ_{s,a} x(s, a) p(s' | s, a) = start(s'),  Σ x c_k ≤ limit_k
    """
    table, bounds = _limited(problem, limit)
    finite = np.isfinite(bounds)
    leaving = np.kron(np.eye(problem.places), np.ones(ACTIONS))
    found = linprog(
        -problem.reward.ravel(),
        A_ub=table.reshape(-1, len(bounds)).T[finite] if finite.any() else None,
        b_ub=bounds[finite] if finite.any() else None,
        A_eq=leaving - problem.flow.reshape(-1, problem.places).T,
        b_eq=problem.start,
    )
    if not found.success:
        raise ValueError(f"no policy for {problem.name} keeps the limit {limit}: {found.message}")
    visits = found.x.reshape(problem.places, ACTIONS).clip(min=0.0)
    total = visits.sum(1, keepdims=True)
    policy = np.where(total > 0.0, visits / np.where(total > 0.0, total, 1.0), 1.0 / ACTIONS)
    return outcome(problem, policy)


def best_deterministic(problem: Problem, limit: Limit = np.inf) -> Outcome:
    """The best policy within the limit of those that do the same thing whenever they are in a place: all 9^S are
    tried."""
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
    """What a perfect planner reaches that knows the tables, sees H steps, and plans anew at every step.

    At each decision, in place s, of all 9^H sequences of actions it takes the one with

        max E[Σ_{t<H} r_t + V(s_H)]  subject to  E[Σ_{t<H} c_t] ≤ limit · min(H / L, 1)

    and executes its first action. Expectations are over the noise, of which the sequence takes no notice (open loop),
    and sums end with the episode; nothing is discounted, L is the mean length of an episode in steps, V is `terminal`
    [S], by default 0. Where no sequence keeps its share of the limit, the cheapest is taken. If sequences are equally
    good, the cheaper ones count; if those begin with different actions, each of these is as probable.

    The budget is given anew at every decision, whatever was spent before: such a planner may stay below the limit,
    since it can't save up for a risk greater than its budget, and may break it, since it can spend at every step what
    was planned for H. Only the second line of this definition is ever asked of it, not the limit itself.
    """
    table, bounds = _limited(problem, limit)
    value = np.zeros(problem.places) if terminal is None else terminal
    policy = np.zeros((problem.places, ACTIONS))
    for place in range(problem.places):
        reward, costs = zip(
            *(_sequences(problem, table, value, place, a, horizon) for a in range(ACTIONS)), strict=True
        )
        policy[place] = _first_actions(np.stack(reward), np.stack(costs), bounds * min(horizon / length, 1.0))
    return outcome(problem, policy)


def _sequences(
    problem: Problem, table: np.ndarray, terminal: np.ndarray, place: int, first: int, horizon: int
) -> tuple[np.ndarray, np.ndarray]:
    """Expected reward [9^(H-1)] and costs [9^(H-1), K] of every sequence that begins with `first` in `place`."""
    reward, costs = problem.reward[place, [first]], table[place, [first]]
    there = problem.flow[place, [first]]
    for _ in range(horizon - 1):
        reward = (reward[:, None] + there @ problem.reward).reshape(-1)
        costs = (costs[:, None] + np.tensordot(there, table, 1)).reshape(-1, table.shape[-1])
        there = np.tensordot(there, problem.flow, 1).reshape(-1, problem.places)
    return reward + there @ terminal, costs


def _first_actions(reward: np.ndarray, costs: np.ndarray, budget: np.ndarray) -> np.ndarray:
    """[9] probability of each first action, from the reward [9, M] and costs [9, M, K] of sequences."""
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
    """What is limited [S, 9, k], and by how much [k]: the total cost (k = 1), or each kind (k = K)."""
    if np.ndim(limit) == 0:
        return problem.risk.sum(-1, keepdims=True), np.atleast_1d(np.asarray(limit, dtype=float))
    bounds = np.asarray(limit, dtype=float)
    if bounds.shape != (problem.kinds,):
        raise ValueError(f"{problem.name} has {problem.kinds} kinds of cost, got the limits {limit}")
    return problem.risk, bounds


@cache
def _every_deterministic(problem: Problem) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Every deterministic policy's actions [P, S], return [P] and costs [P, K], P = 9^S."""
    options = np.array(list(itertools.product(range(ACTIONS), repeat=problem.places)), dtype=np.int8)
    places = np.arange(problem.places)
    rewards, costs = [], []
    for some in np.array_split(options, max(1, len(options) // 8192)):
        leaving = np.eye(problem.places) - problem.flow[places, some].swapaxes(1, 2)
        visits = np.linalg.solve(leaving, np.broadcast_to(problem.start[:, None], (*some.shape, 1)))[..., 0]
        rewards.append((visits * problem.reward[places, some]).sum(1))
        costs.append(np.einsum("ps,psk->pk", visits, problem.risk[places, some]))
    return options, np.concatenate(rewards), np.concatenate(costs)
