"""Which constrained decision problems are small enough to be solved exactly? Tables of four; how they are solved stands
in `solutions`, how they are stepped through in `envs`.

In each place one chooses a pace (branch 0) and a way (branch 1). Pace earns what the place is worth and brings risk;
the way decides where one goes. An episode ends by itself with probability `stop` a step, so that the best policy needs
no clock, and nothing is cut off.

Letters: S places, K kinds of cost; an action is pace * 3 + way, 0..8.
"""

import hashlib
from dataclasses import dataclass

import numpy as np

PACES, WAYS = 3, 3
ACTIONS = PACES * WAYS


@dataclass(frozen=True, eq=False)
class Problem:
    """A constrained Markov decision process as tables. Compared by identity, so that answers can be remembered."""

    name: str
    start: np.ndarray
    """[S] probability of each first place."""
    reward: np.ndarray
    """[S, 9]."""
    risk: np.ndarray
    """[S, 9, K] probability that this step costs 1 of each kind."""
    move: np.ndarray
    """[S, 9, S] probability of the next place, if the episode goes on."""
    stop: float
    """Probability that an episode ends by itself at a step."""
    limits: tuple[float, ...]
    """[K] expected cost that an episode may have, of each kind."""
    deadly: bool = False
    """Whether a cost ends the episode: then it is only ever paid at the end."""

    @property
    def places(self) -> int:
        """S."""
        return len(self.start)

    @property
    def kinds(self) -> int:
        """K."""
        return self.risk.shape[-1]

    @property
    def digest(self) -> str:
        """A hash of everything in it but its limits."""
        content = hashlib.sha256(repr((self.stop, self.deadly)).encode())
        for table in (self.start, self.reward, self.risk, self.move):
            content.update(np.ascontiguousarray(table).tobytes())
        return content.hexdigest()[:8]

    @property
    def flow(self) -> np.ndarray:
        """[S, 9, S] probability that the episode goes on, and there."""
        survived = (1.0 - self.risk).prod(-1) if self.deadly else np.ones(self.reward.shape)
        return (1.0 - self.stop) * survived[..., None] * self.move


def _per_action(pace: np.ndarray) -> np.ndarray:
    """[S, 9] from [S, 3]: whatever the way."""
    return np.repeat(pace, WAYS, axis=1)


def _ring(places: int) -> np.ndarray:
    """[S, 9, S]: the way holds the place, drifts (one time in two) or goes one on; one time in five the wind decides.

    The middle way is a mixture of the others and so never needed: what a Gaussian can't aim at without becoming narrow.
    """
    move = np.full((places, ACTIONS, places), 0.2 / places)
    for place in range(places):
        for action in range(ACTIONS):
            on = action % WAYS / (WAYS - 1)
            move[place, action, place] += 0.8 * (1.0 - on)
            move[place, action, (place + 1) % places] += 0.8 * on
    return move


def _start(places: int, *first: int) -> np.ndarray:
    """[S] one of the `first` places, each as probable."""
    return np.isin(np.arange(places), first) / len(first)


def _along(worth: list[float], share: float = 0.2) -> np.ndarray:
    """[S, 9] reward: the standing share of what a place is worth, and the rest with pace."""
    return _per_action(np.outer(worth, share + (1.0 - share) * np.arange(PACES) / (PACES - 1)))


def _danger(full: list[float]) -> np.ndarray:
    """[S, 9] risk, growing with the square of pace up to `full`."""
    return _per_action(np.outer(full, (np.arange(PACES) / (PACES - 1)) ** 2))


def dense() -> Problem:
    """Cost along the way: the further on, the richer and the riskier, so that one had better hold before the last."""
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
    """Cost only at the end, which it brings about: the richest place is to be left, and not in haste."""
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
    """Two places by turns, rapids (0) and pool (1); the best policy within the limit has to draw lots.

    With the right way (0 in the rapids, 2 in the pool; else nothing is earned) rapids pay 0.3, 0.4 or 1 by pace, and
    full pace there costs 1 with probability 0.2; a pool pays 0, 0.25 or 0.5 and costs nothing. An episode goes on with
    probability g = 0.9, so that it visits rapids F = 1 + g² + g⁴ + … = 1 / (1 - 0.81) = 100 / 19 times and pools g F
    times. At full pace in a share x of the rapids, at half pace in the rest, and at full pace in pools:

        cost = 0.2 F x,  return = F (0.4 + 0.6 x + 0.9 · 0.5)

    Unlimited, x = 1: return 145 / 19 ≈ 7.63, cost 20 / 19 ≈ 1.05. At the limit 0.35, x = 0.35 / (0.2 F) = 0.3325:
    return 5.523684. Without lots, x = 0: return 85 / 19 ≈ 4.47.
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
    """Two costs with a limit each: the first grows with pace, the second is paid for being in a place at all.

    Either limit alone lets the other cost grow to several times its limit, and so does a limit on the sum.
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
