"""What does a trained policy reach in a problem? As exactly as its kind allows.

Here a policy sees nothing but the place, so that all it does is a table [S, 9] of probabilities, and a table's return
and cost are exact. Of heads whose formula is known the table is computed; of a policy with a memory or a plan it is
counted in play.
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
from thalweg.algos.policy.policy import AnyPolicy, Player


@dataclass(frozen=True)
class Score:
    """What a policy reaches, and how sure that is."""

    reward: float
    """Undiscounted return."""
    costs: np.ndarray
    """[K] undiscounted cost of each kind."""
    reward_error: float = 0.0
    """Standard error of the return; 0 where it is exact."""
    cost_error: float = 0.0
    """Of the total cost."""

    @classmethod
    def of(cls, exact: Outcome) -> "Score":
        """What is known without error."""
        return cls(exact.reward, exact.costs)

    @property
    def cost(self) -> float:
        """Of all kinds together."""
        return float(self.costs.sum())


def score(policy: AnyPolicy, problem: Problem, space: SpaceName, seed: int = 0) -> Score:
    """The policy's score in a problem that is played in the given action space."""
    table = probabilities(policy, problem, space)
    if table is None:
        return played(policy, problem, space, seed)
    require_drawn(policy, problem, space, table, seed)
    return Score.of(outcome(problem, table))


def probabilities(policy: AnyPolicy, problem: Problem, space: SpaceName) -> np.ndarray | None:
    """[S, 9] of the actions that the policy draws, by formula; None for one that remembers or plans."""
    if not isinstance(policy, Policy) or policy.frames > 1 or policy.shape.memory:
        return None
    with torch.no_grad():
        distribution = policy.distribution(torch.eye(problem.places))
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
    return (branches[:, 0, :, None] * branches[:, 1, None, :]).reshape(problem.places, ACTIONS)


def gaussian_bins(mean: np.ndarray, std: np.ndarray, edges: np.ndarray, squashed: bool = False) -> np.ndarray:
    """[..., K + 1] probability that a Gaussian sample falls below the first of K edges, between two, above the last.

    P(x ≤ e) = Φ((e - μ) / σ); squashed, the sample is tanh x, and e becomes atanh e, which lies at infinity where tanh
    never gets to.

    Args:
        mean: [...].
        std: [...].
        edges: [K], rising.
        squashed: Whether tanh comes before the edges.
    """
    if squashed:
        with np.errstate(divide="ignore"):
            edges = np.arctanh(np.clip(edges, -1.0, 1.0))
    below = ndtr((edges - mean[..., None]) / std[..., None])
    return np.diff(below, prepend=0.0, append=1.0, axis=-1)


def _edges(actions: Actions) -> np.ndarray:
    """[K - 1] numbers at which the choice changes: where an adapter rounds, or the environment's own for a box."""
    if not actions.sizes:
        return np.array([-BOX_EDGE, BOX_EDGE])
    last = actions.sizes[0] - 1
    rounded = np.arange(last) + 0.5
    return 2.0 * rounded / last - 1.0 if actions.adapter == "box_scaled" else rounded


def player(policy: AnyPolicy, num_envs: int, seed: int = 0) -> Player:
    """The policy at play; its draws come from the seed."""
    return policy.player(num_envs, generator=torch.Generator().manual_seed(seed))


def modes(policy: AnyPolicy, problem: Problem, space: SpaceName) -> np.ndarray:
    """[S, 9], 1 for what a policy without memory does where it draws no lots."""
    play = policy.player(problem.places, deterministic=True)
    actions = play(np.eye(problem.places, dtype=np.float32), np.ones(problem.places, dtype=bool))
    return np.eye(ACTIONS)[joint(actions, space)]


def drawn(policy: AnyPolicy, problem: Problem, space: SpaceName, draws: int, seed: int = 0) -> np.ndarray:
    """[S, 9] share of each action among so many draws in each place."""
    places = np.repeat(np.arange(problem.places), draws)
    play = player(policy, len(places), seed=seed)
    actions = play(np.eye(problem.places, dtype=np.float32)[places], np.ones(len(places), dtype=bool))
    return _counts(places, joint(actions, space), problem) / draws


def require_drawn(
    policy: AnyPolicy, problem: Problem, space: SpaceName, table: np.ndarray, seed: int = 0, draws: int = 4000
) -> None:
    """Raises `AssertionError` for a table [S, 9] that is not what the policy draws: its head is another than was
    thought."""
    apart = np.abs(drawn(policy, problem, space, draws, seed) - table)
    allowed = 6.0 * np.sqrt(table * (1.0 - table) / draws) + 5.0 / draws
    assert (apart <= allowed).all(), f"the policy draws other actions than computed, up to {apart.max():.3f} apart"


def played(
    policy: AnyPolicy, problem: Problem, space: SpaceName, seed: int = 0, *, num_envs: int = 16, steps: int = 250
) -> Score:
    """The score of any policy, whatever it remembers or plans, from `steps` steps of each of N environments.

    What is counted is how often it does what in each place. Whoever does the same as often, without memory, has the
    same expected return and cost (Altman 1999, chapter 3); so the counts are a table, and the luck of moves and
    endings does not count. The standard error is the jackknife's, over environments.
    """
    env, play = ProblemEnv(problem, num_envs, space), player(policy, num_envs, seed)
    obs, _ = env.reset(seed=seed)
    fresh, counts = np.ones(num_envs, dtype=bool), np.zeros((num_envs, problem.places, ACTIONS))
    for _ in range(steps):
        actions = play(obs, fresh)
        counts[np.arange(num_envs), obs.argmax(1), joint(actions, space)] += 1
        obs, _, fresh, _, _ = env.step(actions)
    whole = outcome(problem, _table(counts.sum(0)))
    without = [outcome(problem, _table(counts.sum(0) - one)) for one in counts]
    errors = (_jackknife([getattr(each, name) for each in without]) for name in ("reward", "cost"))
    return Score(whole.reward, whole.costs, *errors)


def _jackknife(without: list[float]) -> float:
    """Standard error of an estimate, from those that leave out one of N independent parts."""
    return float(np.sqrt((len(without) - 1) * np.var(without)))


def _table(counts: np.ndarray) -> np.ndarray:
    """[S, 9] shares; where it never was, the policy is taken to do anything."""
    total = counts.sum(1, keepdims=True)
    return np.where(total > 0, counts / np.maximum(total, 1), 1.0 / ACTIONS)


def _counts(places: np.ndarray, actions: np.ndarray, problem: Problem) -> np.ndarray:
    counts = np.zeros((problem.places, ACTIONS))
    np.add.at(counts, (places, actions), 1)
    return counts
