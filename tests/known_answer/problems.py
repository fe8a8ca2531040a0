"""Four constrained decision problems, as tables, that are small enough to be solved exactly.

`solutions` solves them, and `envs` makes environments of them.

In each state an action has a pace (branch 0) and a way (branch 1). The pace scales reward and risk of a state, the
way determines the next state. An episode ends with probability `stop` at each step, so that the best policy does not
depend on time, and no episode is truncated.

Letters: S states, K kinds of cost; an action is pace * 3 + way, 0..8.
"""

import hashlib
from dataclasses import dataclass

import numpy as np

PACES, WAYS = 3, 3
ACTIONS = PACES * WAYS


@dataclass(frozen=True, eq=False)
class Problem:
    """A constrained Markov decision process as tables. It is compared by identity, so that solutions can be cached."""

    name: str
    start: np.ndarray
    """[S] probability of each initial state."""
    reward: np.ndarray
    """[S, 9]."""
    risk: np.ndarray
    """[S, 9, K] probability that this step costs 1 of each kind."""
    move: np.ndarray
    """[S, 9, S] probability of the next state, if the episode continues."""
    stop: float
    """Probability that an episode ends at a step, apart from costs."""
    limits: tuple[float, ...]
    """[K] limit on the expected cost of an episode, for each kind."""
    deadly: bool = False
    """Whether a cost ends the episode, so that only last steps have a cost."""

    @property
    def states(self) -> int:
        """S."""
        return len(self.start)

    @property
    def kinds(self) -> int:
        """K."""
        return self.risk.shape[-1]

    @property
    def digest(self) -> str:
        """A hash of all data except the limits."""
        content = hashlib.sha256(repr((self.stop, self.deadly)).encode())
        for table in (self.start, self.reward, self.risk, self.move):
            content.update(np.ascontiguousarray(table).tobytes())
        return content.hexdigest()[:8]

    @property
    def flow(self) -> np.ndarray:
        """[S, 9, S] probability that the episode continues, in each next state."""
        survived = (1.0 - self.risk).prod(-1) if self.deadly else np.ones(self.reward.shape)
        return (1.0 - self.stop) * survived[..., None] * self.move


def _per_action(pace: np.ndarray) -> np.ndarray:
    """Return values [S, 9] that do not depend on the way, from [S, 3]."""
    return np.repeat(pace, WAYS, axis=1)


def _ring(states: int) -> np.ndarray:
    """Return transitions [S, 9, S]: stay, advance with probability 1/2, or advance; with probability 1/5 any state.

    The middle way is a mixture of the others and thus never needed; a Gaussian can only avoid it by being narrow.
    """
    move = np.full((states, ACTIONS, states), 0.2 / states)
    for state in range(states):
        for action in range(ACTIONS):
            on = action % WAYS / (WAYS - 1)
            move[state, action, state] += 0.8 * (1.0 - on)
            move[state, action, (state + 1) % states] += 0.8 * on
    return move


def _start(states: int, *first: int) -> np.ndarray:
    """Return the uniform distribution [S] over the states `first`."""
    return np.isin(np.arange(states), first) / len(first)


def _along(worth: list[float], share: float = 0.2) -> np.ndarray:
    """Return rewards [S, 9]: a constant share of the worth of a state, and the rest in proportion to pace."""
    return _per_action(np.outer(worth, share + (1.0 - share) * np.arange(PACES) / (PACES - 1)))


def _danger(full: list[float]) -> np.ndarray:
    """Return risks [S, 9] that grow with the square of pace up to `full`."""
    return _per_action(np.outer(full, (np.arange(PACES) / (PACES - 1)) ** 2))


def dense() -> Problem:
    """Return the problem in which every step may cost: later states have more reward and more risk."""
    return Problem(
        name="dense",
        start=_start(4, 0),
        reward=_along([0.3, 1.0, 1.6, 2.0], share=0.4),
        risk=_danger([0.0, 0.005, 0.05, 0.15])[..., None],
        move=_ring(4),
        stop=0.1,
        limits=(0.355,),
    )


def end() -> Problem:
    """Return the problem in which a cost ends the episode: the best policy leaves the richest state slowly."""
    return Problem(
        name="end",
        start=_start(4, 0),
        reward=_along([0.3, 1.0, 0.6, 0.4]),
        risk=_danger([0.01, 0.2, 0.05, 0.0])[..., None],
        move=_ring(4),
        stop=0.2,
        limits=(0.1,),
        deadly=True,
    )


def mixture() -> Problem:
    """Return the problem whose best policy within the limit is stochastic: rapids (0) and pool (1) alternate.

    With the right way (0 in the rapids, 2 in the pool; else nothing is earned) rapids pay 0.3, 0.4 or 1 by pace, and
    full pace there costs 1 with probability 0.2; a pool pays 0, 0.25 or 0.5 and costs nothing. An episode goes
    on with probability g = 0.9, so that it visits rapids
    F = 1 + g² + g⁴ + … = 1 / (1 - 0.81) = 100 / 19 times and pools g F
    times. At full pace in a share x of the rapids, at half pace in the rest, and at full pace in pools:

        cost = 0.2 F x,  return = F (0.4 + 0.6 x + 0.9 · 0.5)

    Unlimited, x = 1: return 145 / 19 ≈ 7.63, cost 20 / 19 ≈ 1.05. At the limit 0.35, x = 0.35 / (0.2 F) = 0.3325:
    return 5.523684. Without randomness, x = 0: return 85 / 19 ≈ 4.47.
    """
    reward = np.zeros((2, PACES, WAYS))
    reward[0, :, 0], reward[1, :, 2] = (0.3, 0.4, 1.0), (0.0, 0.25, 0.5)
    risk = np.zeros((2, PACES, WAYS))
    risk[0, 2, :] = 0.2
    move = np.zeros((2, ACTIONS, 2))
    move[0, :, 1] = move[1, :, 0] = 1.0
    return Problem(
        name="mixture",
        start=_start(2, 0),
        reward=reward.reshape(2, ACTIONS),
        risk=risk.reshape(2, ACTIONS, 1),
        move=move,
        stop=0.1,
        limits=(0.35,),
    )


def two() -> Problem:
    """Return the problem of two costs with a limit each: one grows with pace, the other depends on the state alone.

    With either limit alone, or with a limit on the sum, a cost grows to several times its limit.
    """
    being_there = np.repeat([[0.0], [0.0], [0.2], [0.3]], ACTIONS, axis=1)
    return Problem(
        name="two",
        start=_start(4, 0),
        reward=_along([0.3, 1.0, 0.2, 2.4], share=0.4),
        risk=np.stack([_danger([0.1, 0.02, 0.0, 0.2]), being_there], axis=-1),
        move=_ring(4),
        stop=0.1,
        limits=(0.255, 0.955),
    )


PROBLEMS: dict[str, Problem] = {problem.name: problem for problem in (dense(), end(), mixture(), two())}
