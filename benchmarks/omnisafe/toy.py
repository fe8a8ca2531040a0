"""Toy problem of the comparison: a climb whose reward and risk of a fall grow with the height.

The action and a persistent wind move four coordinates, whose mean is the height h. The reward of a step is PAY h². A
step may also end the episode by a fall with cost 1; its probability is 0 below SAFE and rises to RISK at the top. Falls
are rare: the limit of 0.1 falls per episode binds well below the top, while a policy without a limit goes to the top
and falls in every second episode. The toy needs only NumPy and runs under the Python of either library.

All random numbers of an episode are drawn at its start from the seed of its environment and its own number, so each of
many environments behaves as if it were alone, and a state is small.
"""

import numpy as np

SIZE, ACTIONS = 16, 4
"""Sizes of an observation and of an action, whose components are within ±1."""
LENGTH = 100
"""Steps after which an episode is truncated."""
PUSH, BREEZE = 0.15, 0.06
"""Change of a coordinate in a step by a full action, and by a wind of 1; coordinates are clipped to ±1."""
LASTING, GUST = 0.9, 0.25
"""Share of the wind that remains in the next step, and the standard deviation of what is added."""
CALM = GUST / (1 - LASTING**2) ** 0.5
"""Stationary standard deviation of the wind."""
LOWEST, HIGHEST = -0.8, 0.2
"""Range of the coordinates at the start of an episode."""
PAY = 0.1
SAFE, RISK = 0.4, 0.007


def height_of(position: np.ndarray) -> np.ndarray:
    """Return the heights [N], 0 to 1, of coordinates [N, 4]."""
    return (1.0 + position.mean(1)) / 2.0


def chance_at(height: np.ndarray) -> np.ndarray:
    """Return the probabilities of a fall in a step, at heights of any shape."""
    return RISK * (np.maximum(height - SAFE, 0.0) / (1.0 - SAFE)) ** 2


class Toy:
    """N environments without autoreset: the caller starts the next episodes with `begin`."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.seeds, self.episode = np.zeros(count, np.int64), np.full(count, -1, np.int64)
        self.step_number = np.zeros(count, np.int64)
        self.position, self.wind, self.action = (np.zeros((count, ACTIONS)) for _ in range(3))
        self._gusts, self._lots = np.zeros((count, LENGTH, ACTIONS)), np.zeros((count, LENGTH))
        self._rows = np.arange(count)

    def seed(self, seeds: np.ndarray | list[int]) -> None:
        """Seed the environments, one seed [N] each, and restart the count of their episodes."""
        self.seeds[:], self.episode[:] = seeds, -1

    def begin(self, rows: np.ndarray) -> None:
        """Start the next episode of the environments `rows` [F]."""
        self.episode[rows] += 1
        self.step_number[rows], self.action[rows] = 0, 0.0
        for row in rows:
            start = self._draw(int(row))
            self.position[row] = LOWEST + (HIGHEST - LOWEST) * start.random(ACTIONS)
            self.wind[row] = CALM * start.standard_normal(ACTIONS)

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Apply actions [N, 4]; returns reward, cost, terminated and truncated, [N] each."""
        now = self.step_number
        self.action = np.clip(np.asarray(actions, np.float64), -1.0, 1.0)
        self.wind = LASTING * self.wind + GUST * self._gusts[self._rows, now]
        self.position = np.clip(self.position + PUSH * self.action + BREEZE * self.wind, -1.0, 1.0)
        height = height_of(self.position)
        fallen = self._lots[self._rows, now] < chance_at(height)
        self.step_number = now + 1
        return PAY * height**2, fallen.astype(np.float64), fallen, (self.step_number >= LENGTH) & ~fallen

    def observations(self) -> np.ndarray:
        """Return [N, 16] float32: coordinates, wind and last action, 4 each; then height, its square, the probability
        of a fall as a share of RISK, and the share of the episode that has passed."""
        height = height_of(self.position)
        scalars = np.stack([height, height**2, chance_at(height) / RISK, self.step_number / LENGTH], 1)
        return np.concatenate([self.position, self.wind, self.action, scalars], 1).astype(np.float32)

    def state(self) -> dict[str, np.ndarray]:
        """Return everything that the future depends on."""
        return {name: getattr(self, name).copy() for name in _STATE}

    def load_state(self, state: dict[str, np.ndarray]) -> None:
        """Restore a state of `state`."""
        for name in _STATE:
            setattr(self, name, np.array(state[name]))
        for row in np.flatnonzero(self.episode >= 0):
            self._draw(int(row))

    def _draw(self, row: int) -> np.random.Generator:
        """Draw the random numbers of an episode's steps; returns the generator, which then draws its start."""
        generator = np.random.default_rng([int(self.seeds[row]), int(self.episode[row])])
        self._gusts[row] = generator.standard_normal((LENGTH, ACTIONS))
        self._lots[row] = generator.random(LENGTH)
        return generator


CHANCE = 14
"""Index within an observation of the probability of a fall, as a share of RISK."""
_STATE = ("seeds", "episode", "step_number", "position", "wind", "action")
