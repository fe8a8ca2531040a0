"""The toy on which both libraries learn: a climb that pays the better the higher it goes, and from which one may fall.

Four coordinates are pushed by the action and by a wind that lasts. The height h is their mean. Each step pays
PAY h² and ends the episode by a fall, cost 1, with a chance that is nil below SAFE and RISK at the top. So falls are
rare, the limit of a tenth of a fall an episode binds well below the top, and whoever knows no cost goes to the top and
falls in every second episode. It needs NumPy alone and runs under either library's Python.

Whatever is random in an episode is drawn when it begins, from its environment's seed and its number alone: one
environment and a row of many are the same thing, and a state is small.
"""

import numpy as np

SIZE, ACTIONS = 16, 4
"""Numbers in an observation and in an action, the latter each within ±1."""
LENGTH = 100
"""Steps after which an episode is cut off."""
PUSH, BREEZE = 0.15, 0.06
"""How far a full action, and a wind of 1, move a coordinate in a step; coordinates are kept within ±1."""
LASTING, GUST = 0.9, 0.25
"""Share of the wind that the next step keeps, and the deviation of what comes to it."""
CALM = GUST / (1 - LASTING**2) ** 0.5
"""Deviation of the wind in the long run."""
LOWEST, HIGHEST = -0.8, 0.2
"""Coordinates at the start of an episode."""
PAY = 0.1
SAFE, RISK = 0.4, 0.007


def height_of(place: np.ndarray) -> np.ndarray:
    """Heights [N], 0 to 1, of coordinates [N, 4]."""
    return (1.0 + place.mean(1)) / 2.0


def chance_at(height: np.ndarray) -> np.ndarray:
    """Chances of a fall in a step, at heights of any shape."""
    return RISK * (np.maximum(height - SAFE, 0.0) / (1.0 - SAFE)) ** 2


class Toy:
    """N climbs; whoever steps them begins the next episode of those that ended."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.seeds, self.episode = np.zeros(count, np.int64), np.full(count, -1, np.int64)
        self.step_number = np.zeros(count, np.int64)
        self.place, self.wind, self.action = (np.zeros((count, ACTIONS)) for _ in range(3))
        self._gusts, self._lots = np.zeros((count, LENGTH, ACTIONS)), np.zeros((count, LENGTH))
        self._rows = np.arange(count)

    def seed(self, seeds: np.ndarray | list[int]) -> None:
        """Begin to count episodes anew, one seed [N] for each environment."""
        self.seeds[:], self.episode[:] = seeds, -1

    def begin(self, rows: np.ndarray) -> None:
        """The next episode of the environments `rows` [F]."""
        self.episode[rows] += 1
        self.step_number[rows], self.action[rows] = 0, 0.0
        for row in rows:
            start = self._draw(int(row))
            self.place[row] = LOWEST + (HIGHEST - LOWEST) * start.random(ACTIONS)
            self.wind[row] = CALM * start.standard_normal(ACTIONS)

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Reward, cost, terminated and truncated [N] each of actions [N, 4]."""
        now = self.step_number
        self.action = np.clip(np.asarray(actions, np.float64), -1.0, 1.0)
        self.wind = LASTING * self.wind + GUST * self._gusts[self._rows, now]
        self.place = np.clip(self.place + PUSH * self.action + BREEZE * self.wind, -1.0, 1.0)
        height = height_of(self.place)
        fallen = self._lots[self._rows, now] < chance_at(height)
        self.step_number = now + 1
        return PAY * height**2, fallen.astype(np.float64), fallen, (self.step_number >= LENGTH) & ~fallen

    def observations(self) -> np.ndarray:
        """[N, 16] float32: coordinates, wind, the last action; height and its square, the chance of a fall as a share
        of RISK, the share of the episode that is over."""
        height = height_of(self.place)
        scalars = np.stack([height, height**2, chance_at(height) / RISK, self.step_number / LENGTH], 1)
        return np.concatenate([self.place, self.wind, self.action, scalars], 1).astype(np.float32)

    def state(self) -> dict[str, np.ndarray]:
        """All that the future depends on."""
        return {name: getattr(self, name).copy() for name in _STATE}

    def load_state(self, state: dict[str, np.ndarray]) -> None:
        """The inverse of `state`."""
        for name in _STATE:
            setattr(self, name, np.array(state[name]))
        for row in np.flatnonzero(self.episode >= 0):
            self._draw(int(row))

    def _draw(self, row: int) -> np.random.Generator:
        """Draw what will happen in an episode; what the generator still has is for its start."""
        generator = np.random.default_rng([int(self.seeds[row]), int(self.episode[row])])
        self._gusts[row] = generator.standard_normal((LENGTH, ACTIONS))
        self._lots[row] = generator.random(LENGTH)
        return generator


CHANCE = 14
"""Which number of an observation is the chance of a fall, as a share of RISK."""
_STATE = ("seeds", "episode", "step_number", "place", "wind", "action")
