"""A problem as a vector environment, in each of the action spaces in which algorithms must solve it."""

from typing import Any, Literal

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from tests.known_answer.problems import ACTIONS, PACES, WAYS, Problem

SpaceName = Literal["multidiscrete", "discrete", "box"]
SPACES: dict[SpaceName, gym.Space] = {
    "multidiscrete": gym.spaces.MultiDiscrete([PACES, WAYS]),
    "discrete": gym.spaces.Discrete(ACTIONS),
    "box": gym.spaces.Box(-1.0, 1.0, (2,), np.float32),
}
BOX_EDGE = 0.5
"""Where the nearest of -1, 0 and 1 changes."""


def joint(actions: np.ndarray, space: SpaceName) -> np.ndarray:
    """Actions 0..8 [N] from the environment's [N] or [N, 2]; a number of a box stands for the nearest of -1, 0, 1."""
    actions = np.asarray(actions)
    if space == "discrete":
        return actions.astype(np.int64)
    if space == "box":
        actions = (actions > -BOX_EDGE).astype(np.int64) + (actions > BOX_EDGE)
    return actions[:, 0] * WAYS + actions[:, 1]


class ProblemEnv(VectorEnv):
    """N copies of a problem; the observation is the state as a one-hot vector."""

    def __init__(self, problem: Problem, num_envs: int = 16, space: SpaceName = "multidiscrete") -> None:
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}
        self.problem, self.num_envs = problem, num_envs
        self.space: SpaceName = space
        self.single_observation_space = gym.spaces.Box(0.0, 1.0, (problem.states,), np.float32)
        self.single_action_space = SPACES[space]
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._eye = np.eye(problem.states, dtype=np.float32)
        self._next, self._first = problem.move.cumsum(-1), problem.start.cumsum()
        self._random, self._states = np.random.default_rng(), np.zeros(num_envs, dtype=np.int64)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        if seed is not None:
            self._random = np.random.default_rng(seed)
        self._states = self._drawn(self._first, self._random.random(self.num_envs))
        return self._eye[self._states], {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        problem, states, action = self.problem, self._states, joint(actions, self.space)
        draw = self._random.random((3 + problem.kinds, self.num_envs))
        costs = (problem.risk[states, action] > draw[3:].T).astype(np.float64)
        ended = draw[0] < problem.stop
        if problem.deadly:
            ended |= costs.any(1)
        moved = self._drawn(self._next[states, action], draw[1])
        self._states = np.where(ended, self._drawn(self._first, draw[2]), moved)
        info: dict[str, Any] = {"cost": costs.sum(1), "final_obs": self._eye[moved]}
        if problem.kinds == 2:
            info["costs"] = costs
        return self._eye[self._states], problem.reward[states, action], ended, np.zeros_like(ended), info

    def get_state(self) -> dict[str, Any]:
        return {"place": self._states.copy(), "random": self._random.bit_generator.state}

    def set_state(self, state: dict[str, Any]) -> None:
        self._states = np.array(state["place"])
        self._random.bit_generator.state = state["random"]

    @staticmethod
    def _drawn(cumulative: np.ndarray, uniform: np.ndarray) -> np.ndarray:
        """The state [N] that each uniform number [N] falls on, from cumulative probabilities [S] or [N, S]."""
        return (uniform[:, None] >= cumulative).sum(-1).clip(max=cumulative.shape[-1] - 1)
