"""A constrained decision problem small enough to be solved: six places, nine actions, and a linear programme for
its optimum.

In each place one chooses a pace (branch 0) and a way (branch 1). Pace earns what the place is worth and brings
risk; the way decides where one goes. An episode ends by itself with probability `STOP` a step, so that the best
policy needs no clock.
"""

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from scipy.optimize import linprog

STOP = 0.1
PLACES, PACES, WAYS = 6, 3, 3


@dataclass(frozen=True)
class Problem:
    """Tables over places S = 6 and joint actions 9 (pace * 3 + way)."""

    start: np.ndarray
    """[S] probability of each first place."""
    reward: np.ndarray
    """[S, 9]."""
    risk: np.ndarray
    """[S, 9] probability that this step costs 1."""
    move: np.ndarray
    """[S, 9, S] probability of the next place, if the episode goes on."""
    deadly: bool
    """Whether such a cost ends the episode: then it is only ever paid at the end."""

    @property
    def going_on(self) -> np.ndarray:
        """[S, 9] probability that the episode goes on."""
        return (1.0 - STOP) * (1.0 - self.risk * self.deadly)

    def optimum(self, limit: float) -> tuple[float, float]:
        """Return and cost of the best policy whose expected cost is within the limit.

        The linear programme over visits x(s, a) ≥ 0 (Altman 1999, chapter 3):
        max Σ x r,  Σ_a x(s', a) - Σ_{s,a} x(s, a) p(s' | s, a) = start(s'),  Σ x c ≤ limit
        """
        flow = (self.going_on[..., None] * self.move).reshape(-1, PLACES).T
        leaving = np.kron(np.eye(PLACES), np.ones(PACES * WAYS))
        found = linprog(
            -self.reward.ravel(),
            A_ub=self.risk.ravel()[None] if np.isfinite(limit) else None,
            b_ub=[limit] if np.isfinite(limit) else None,
            A_eq=leaving - flow,
            b_eq=self.start,
        )
        assert found.success, found.message
        return -float(found.fun), float(found.x @ self.risk.ravel())

    def value(self, policy: np.ndarray) -> tuple[float, float]:
        """Exact return and cost of a policy [S, 9] of probabilities."""
        flow = np.einsum("sa,sa,sak->sk", policy, self.going_on, self.move)
        visits = np.linalg.solve(np.eye(PLACES) - flow.T, self.start)
        total, cost = (float(visits @ (policy * table).sum(1)) for table in (self.reward, self.risk))
        return total, cost


def problem(deadly: bool) -> Problem:
    """Rich places are risky, and the way to them leads through poor ones."""
    worth = np.array([0.2, 0.4, 0.6, 0.8, 1.0, 0.5])
    danger = np.array([0.01, 0.02, 0.15, 0.05, 0.3, 0.02]) * (0.5 if deadly else 0.3)
    pace = np.arange(PACES) / (PACES - 1)
    reward = np.repeat(worth[:, None] * (0.2 + 0.8 * pace), WAYS, axis=1)
    risk = np.repeat(danger[:, None] * pace**2, WAYS, axis=1)
    move = np.zeros((PLACES, PACES * WAYS, PLACES))
    for place in range(PLACES):
        for action in range(PACES * WAYS):
            aim = (place + (-1, 0, 1)[action % WAYS]) % PLACES
            move[place, action] = 0.2 / PLACES
            move[place, action, aim] += 0.8
    start = np.array([0.5, 0.5, 0.0, 0.0, 0.0, 0.0])
    return Problem(start, reward, risk, move, deadly)


class ProblemEnv(VectorEnv):
    """N copies of a problem; the observation is the place, as one number of six that is 1."""

    def __init__(self, problem: Problem, num_envs: int = 16, space: gym.Space | None = None) -> None:
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}
        self.problem, self.num_envs = problem, num_envs
        self.single_observation_space = gym.spaces.Box(0.0, 1.0, (PLACES,), np.float32)
        self.single_action_space = space or gym.spaces.MultiDiscrete([PACES, WAYS])
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._eye = np.eye(PLACES, dtype=np.float32)
        self._next = problem.move.cumsum(-1)
        self._random, self._place = np.random.default_rng(), np.zeros(num_envs, dtype=np.int64)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        if seed is not None:
            self._random = np.random.default_rng(seed)
        self._place = self._first(self.num_envs)
        return self._eye[self._place], {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        place, action = self._place, self._joint(np.asarray(actions))
        draw = self._random.random((3, self.num_envs))
        cost = (draw[0] < self.problem.risk[place, action]).astype(np.float64)
        ended = (draw[1] < STOP) | ((cost > 0) & self.problem.deadly)
        moved = (draw[2][:, None] >= self._next[place, action]).sum(-1).clip(max=PLACES - 1)
        self._place = np.where(ended, self._first(self.num_envs), moved)
        info: dict[str, Any] = {"cost": cost}
        if ended.any():
            info["final_obs"] = np.full(self.num_envs, None, dtype=object)
            for env in np.flatnonzero(ended):
                info["final_obs"][env] = self._eye[moved[env]]
        return self._eye[self._place], self.problem.reward[place, action], ended, np.zeros_like(ended), info

    def get_state(self) -> dict[str, Any]:
        return {"place": self._place.copy(), "random": self._random.bit_generator.state}

    def set_state(self, state: dict[str, Any]) -> None:
        self._place = np.array(state["place"])
        self._random.bit_generator.state = state["random"]

    def _first(self, count: int) -> np.ndarray:
        return self._random.choice(PLACES, size=count, p=self.problem.start)

    @staticmethod
    def _joint(actions: np.ndarray) -> np.ndarray:
        return actions[:, 0] * WAYS + actions[:, 1] if actions.ndim == 2 else actions
