"""Wind, current and inertia of the N environments of a `RiverVectorEnv`."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.config import EnvConfig
from thalweg.env.forces.arrays import ForceState, empty_forces, force_numbers
from thalweg.env.forces.step import step_pushed_all
from thalweg.env.forces.weather import begin_weather, wind_now
from thalweg.env.snapshot import impossible
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.rules import Outcome, State, step_all

PREFIX = "force_"
"""Begin of the names of these arrays in a snapshot."""


class ForcesOfMany:
    """Steps N environments, under the forces of a config if it has any, and holds what these add to the state."""

    def __init__(self, config: EnvConfig, num_envs: int) -> None:
        self.numbers = force_numbers(config) if config.has_forces else None
        """None: nothing pushes, and steps are those of `thalweg.env.task.rules`."""
        self.state: ForceState = empty_forces(num_envs)
        self.horizontal = np.zeros((num_envs, 2))
        """[N, 2] mean wind of each episode in m/s, towards east and north; always the same array."""
        self._windy, self._inertial = config.wind is not None, config.dynamics == "inertial"

    def begin(self, row: int, generator: np.random.Generator) -> None:
        """Draw the weather of a new episode in environment `row`; draws nothing if there are no forces."""
        if self.numbers is not None:
            self.begin_with(row, int(generator.integers(1 << 63)))

    def begin_with(self, row: int, key: int) -> None:
        """Begin the weather of a key, a non-negative int64, in environment `row`; does nothing if there are no
        forces."""
        if self.numbers is not None:
            begin_weather(row, key, self.numbers, self.state)
            self._find_horizontal(row)

    def step_all(
        self, active: np.ndarray, actions: np.ndarray, courses: CourseArrays, limits: Any, state: State, out: Outcome
    ) -> None:
        """Step every active environment; active [N] bool, unit actions [N, 4] float64."""
        if self.numbers is None:
            step_all(active, actions, courses, limits, state, out)
        else:
            step_pushed_all(active, actions, courses, limits, self.numbers, state, self.state, out)

    def info(self) -> dict[str, np.ndarray]:
        """Return what a config with these forces adds to `info`: `wind` [N, 3] in m/s, east, north and up, that blows
        in the next step, and with inertia `velocity` [N, 4], as in `ForceState`."""
        told = {}
        if self._windy:
            told["wind"] = np.empty((len(self.state.key), 3))
            write_winds(self.numbers, self.state, told["wind"])
        if self._inertial:
            told["velocity"] = self.state.velocity.copy()
        return told

    def get_state(self) -> dict[str, np.ndarray]:
        """Return copies of the arrays of the state; none if there are no forces."""
        if self.numbers is None:
            return {}
        return {PREFIX + name: value.copy() for name, value in self.state._asdict().items()}

    def set_state(self, given: Mapping[str, np.ndarray]) -> None:
        """Restore a checked state."""
        if self.numbers is not None:
            for name, value in self.state._asdict().items():
                value[...] = given[PREFIX + name]
            self._find_horizontal(slice(None))

    def _find_horizontal(self, rows: int | slice) -> None:
        """Fill `horizontal` from the means that are drawn for episodes."""
        speed, towards = self.state.mean_wind[rows, 0], self.state.mean_wind[rows, 1]
        self.horizontal[rows] = (speed * np.array([np.cos(towards), np.sin(towards)])).T


def check_forces(given: Mapping[str, np.ndarray]) -> None:
    """Raise `StateError` for arrays of forces in a snapshot with values that no episode could have."""
    for name in given:
        if name.startswith(PREFIX) and not np.isfinite(given[name]).all():
            row = int(np.argwhere(~np.isfinite(given[name]))[0][0])
            raise impossible(name, given[name][row], "finite numbers", row)


@kernel(fastmath=False, allocates=False)
def write_winds(forces, force_state, out):
    """Write the wind of each environment to out [N, 3], see `thalweg.env.forces.weather.wind_now`."""
    for row in range(len(out)):
        out[row, 0], out[row, 1], out[row, 2] = wind_now(row, forces, force_state)
