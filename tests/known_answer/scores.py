"""Scores of trained policies in a problem, as exact as the kind of policy allows.

A policy without memory observes only the state, so that it is a table [S, 9] of action probabilities, whose return and
cost are exact. For action distributions with a known formula the table is computed. For policies with memory, and
planners, it is estimated by counting actions.
"""

from dataclasses import dataclass

import numpy as np
import torch
from scipy.special import ndtr

from tests.known_answer.envs import BOX_EDGE, ProblemEnv, SpaceName, joint
from tests.known_answer.problems import ACTIONS, Problem
from tests.known_answer.solutions import Outcome, outcome
from thalweg.algos import Policy
from thalweg.algos.policy.actions import Actions
from thalweg.algos.policy.distributions import Categoricals, Deterministic, Gaussians, SquashedGaussian
from thalweg.algos.policy.player import Player
from thalweg.algos.policy.policy import AnyPolicy


@dataclass(frozen=True)
class Score:
    """Return and cost of a policy, with standard errors."""

    reward: float
    """Undiscounted return."""
    costs: np.ndarray
    """[K] undiscounted cost of each kind."""
    reward_error: float = 0.0
    """Standard error of the return; 0 if it is exact."""
    cost_error: float = 0.0
    """Standard error of the total cost."""

    @classmethod
    def of(cls, exact: Outcome) -> "Score":
        """Return the score of an exact outcome."""
        return cls(exact.reward, exact.costs)

    @property
    def cost(self) -> float:
        """Total cost of all kinds."""
        return float(self.costs.sum())


def score(policy: AnyPolicy, problem: Problem, space: SpaceName, seed: int = 0) -> Score:
    """Return the score of a policy in a problem with the given action space."""
    table = probabilities(policy, problem, space)
    if table is None:
        return played(policy, problem, space, seed)
    require_drawn(policy, problem, space, table, seed)
    return Score.of(outcome(problem, table))


def probabilities(policy: AnyPolicy, problem: Problem, space: SpaceName) -> np.ndarray | None:
    """Return the action probabilities [S, 9] by formula, or None for a policy with memory or a planner."""
    if not isinstance(policy, Policy) or policy.frames > 1 or policy.shape.memory:
        return None
    with torch.no_grad():
        distribution = policy.distribution(torch.eye(problem.states))
    if policy.greedy or isinstance(distribution, Deterministic):
        return modes(policy, problem, space)
    if isinstance(distribution, Categoricals):
        branches = distribution.log_p.exp().double().numpy()
    elif isinstance(distribution, Gaussians | SquashedGaussian):
        mean, std = distribution.mean.double().numpy(), distribution.log_std.double().exp().numpy()
        branches = gaussian_bins(mean, std, _edges(policy.actions), isinstance(distribution, SquashedGaussian))
    else:
        return None
    if branches.shape[1] == 1:
        return branches[:, 0]
    return (branches[:, 0, :, None] * branches[:, 1, None, :]).reshape(problem.states, ACTIONS)


def gaussian_bins(mean: np.ndarray, std: np.ndarray, edges: np.ndarray, squashed: bool = False) -> np.ndarray:
    """Return the probability [..., K + 1] of each interval between K edges under a Gaussian.

    P(x ≤ e) = Φ((e - μ) / σ). If squashed, the sample is tanh x, and e becomes atanh e, which is infinite beyond ±1.

    Args:
        mean: [...].
        std: [...].
        edges: [K], ascending.
        squashed: Whether tanh is applied to the sample.
    """
    if squashed:
        with np.errstate(divide="ignore"):
            edges = np.arctanh(np.clip(edges, -1.0, 1.0))
    below = ndtr((edges - mean[..., None]) / std[..., None])
    return np.diff(below, prepend=0.0, append=1.0, axis=-1)


def _edges(actions: Actions) -> np.ndarray:
    """Return the numbers [K - 1] at which the option changes: those of rounding, or of the box environment."""
    if not actions.sizes:
        return np.array([-BOX_EDGE, BOX_EDGE])
    last = actions.sizes[0] - 1
    rounded = np.arange(last) + 0.5
    return 2.0 * rounded / last - 1.0 if actions.adapter == "box_scaled" else rounded


def player(policy: AnyPolicy, num_envs: int, seed: int = 0) -> Player:
    """Return the policy as a player whose samples come from the seed."""
    return policy.player(num_envs, generator=torch.Generator().manual_seed(seed))


def modes(policy: AnyPolicy, problem: Problem, space: SpaceName) -> np.ndarray:
    """Return the deterministic actions of a policy without memory as one-hot vectors [S, 9]."""
    play = policy.player(problem.states, deterministic=True)
    actions = play(np.eye(problem.states, dtype=np.float32), np.ones(problem.states, dtype=bool))
    return np.eye(ACTIONS)[joint(actions, space)]


def drawn(policy: AnyPolicy, problem: Problem, space: SpaceName, draws: int, seed: int = 0) -> np.ndarray:
    """Return the share [S, 9] of each action among `draws` samples in each state."""
    states = np.repeat(np.arange(problem.states), draws)
    play = player(policy, len(states), seed=seed)
    actions = play(np.eye(problem.states, dtype=np.float32)[states], np.ones(len(states), dtype=bool))
    return _counts(states, joint(actions, space), problem) / draws


def require_drawn(
    policy: AnyPolicy, problem: Problem, space: SpaceName, table: np.ndarray, seed: int = 0, draws: int = 4000
) -> None:
    """Raise `AssertionError` if the table [S, 9] differs from the policy's samples, for example for an unknown head."""
    apart = np.abs(drawn(policy, problem, space, draws, seed) - table)
    allowed = 6.0 * np.sqrt(table * (1.0 - table) / draws) + 5.0 / draws
    assert (apart <= allowed).all(), f"the policy draws other actions than computed, up to {apart.max():.3f} apart"


def played(
    policy: AnyPolicy, problem: Problem, space: SpaceName, seed: int = 0, *, num_envs: int = 16, steps: int = 250
) -> Score:
    """Return the score of any policy, with memory or planning too, from `steps` steps of each of N environments.

    The actions in each state are counted. A policy without memory that takes each action with these frequencies has the
    same expected return and cost (Altman 1999, chapter 3), so the counts are a table, and random transitions and
    terminations add no noise. The standard error is that of the jackknife over environments.
    """
    env, play = ProblemEnv(problem, num_envs, space), player(policy, num_envs, seed)
    obs, _ = env.reset(seed=seed)
    fresh, counts = np.ones(num_envs, dtype=bool), np.zeros((num_envs, problem.states, ACTIONS))
    for _ in range(steps):
        actions = play(obs, fresh)
        counts[np.arange(num_envs), obs.argmax(1), joint(actions, space)] += 1
        obs, _, fresh, _, _ = env.step(actions)
    total = outcome(problem, _table(counts.sum(0)))
    without = [outcome(problem, _table(counts.sum(0) - one)) for one in counts]
    errors = (_jackknife([getattr(each, name) for each in without]) for name in ("reward", "cost"))
    return Score(total.reward, total.costs, *errors)


def _jackknife(without: list[float]) -> float:
    """Return the standard error of an estimate, from estimates that each leave out one of N independent samples."""
    return float(np.sqrt((len(without) - 1) * np.var(without)))


def _table(counts: np.ndarray) -> np.ndarray:
    """Return shares [S, 9] of counts; states that were never visited get a uniform policy."""
    total = counts.sum(1, keepdims=True)
    return np.where(total > 0, counts / np.maximum(total, 1), 1.0 / ACTIONS)


def _counts(states: np.ndarray, actions: np.ndarray, problem: Problem) -> np.ndarray:
    counts = np.zeros((problem.states, ACTIONS))
    np.add.at(counts, (states, actions), 1)
    return counts
