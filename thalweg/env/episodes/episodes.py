"""Episodes of N environments: their states, random generators and outcomes, how they begin, and their snapshots."""

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from thalweg.env import snapshot
from thalweg.env.config import EnvConfig
from thalweg.env.forces.of_many import ForcesOfMany, check_forces
from thalweg.env.frame_renderer import FrameRenderer
from thalweg.env.initial_poses import begin_at_pose, project_anywhere, random_clock, random_start
from thalweg.env.observer import Observer
from thalweg.env.rivers.assignment import Rivers
from thalweg.env.task.rules import TASK_STATE, afloat, clear_outcome, empty_outcome, empty_state, pose_of

LARGEST_SCENE = 2**62
"""Seeds of what moves in an episode are below this number."""


class Episodes:
    """The episodes that N environments are in, each with the random generator that its environment draws from."""

    def __init__(
        self, config: EnvConfig, rivers: Rivers, frames: FrameRenderer, observer: Observer, forces: ForcesOfMany
    ) -> None:
        num_envs = len(rivers.slot)
        self.config, self.rivers, self.frames, self.observer, self.forces = config, rivers, frames, observer, forces
        self.limits = config.limits
        visited = np.zeros((num_envs, rivers.most_segments), dtype=np.uint8)
        self.state = empty_state(rivers.slot, rivers.courses)._replace(visited=visited)
        self.generators: list[np.random.Generator | None] = [None] * num_envs
        """None before the first reset."""
        self.started = np.zeros(num_envs, dtype=bool)
        """[N] environments that had a first reset."""
        self.ended = np.zeros(num_envs, dtype=bool)
        """[N] environments whose episode has ended, and no new one has begun."""
        self.outcome = empty_outcome(num_envs, len(config.cost_kinds))
        """Of the last step."""

    def reseed(self, row: int, generator: np.random.Generator) -> None:
        """Give an environment another random generator."""
        self.generators[row] = generator
        self.rivers.forget(row)
        self.frames.draw_look(row, "environment", generator)

    def begin(self, row: int, pose: np.ndarray | None = None) -> None:
        """Begin an episode in one environment, at a validated pose [4] or a random one."""
        generator = self.generators[row]
        assert generator is not None
        self.rivers.enter(row, generator)
        self._place(row, generator, pose)
        self.frames.draw_look(row, "episode", generator)
        self.forces.begin(row, generator)
        self.started[row] = True
        self.ended[row] = False

    def clear_outcome(self, row: int) -> None:
        """Forget the outcome of an environment's last step."""
        clear_outcome(self.outcome, row)

    def _place(self, row: int, generator: np.random.Generator, pose: np.ndarray | None) -> None:
        """Set the state of an environment to that before the first step of an episode."""
        state, courses, limits = self.state, self.rivers.courses, self.limits
        world = int(self.rivers.slot[row])
        if pose is None:
            pose, time_s = random_start(courses, world, self.config, limits, generator, self.rivers.name(row))
        else:
            time_s = random_clock(generator)
        state.pose[row], state.time_s[row] = pose, time_s
        if limits.is_boat:
            projection = project_anywhere(courses, world, *state.pose[row, :2])
            state.pose[row] = afloat(courses, world, limits, projection, pose_of(state.pose, row))
        self.observer.start(row, state.pose[row])
        scene = int(generator.integers(LARGEST_SCENE)) if courses.swimmers[world] else 0
        begin_at_pose(row, courses, limits, state, scene)

    def get_state(self) -> dict[str, np.ndarray]:
        """Return copies of everything that the future depends on, random generators included."""
        arrays = snapshot.copy_state(self.state, self.generators, self.started, self.ended, self._identity)
        del arrays["world"]
        if self.config.task == "River":  # as states were before there were other tasks
            for name in TASK_STATE:
                del arrays[name]
        looks = {"look": self.frames.look.copy(), "sun": self.frames.sun.copy()}
        return {**arrays, **self.rivers.state(), **looks, **self.forces.get_state(), **self.observer.state()}

    def set_state(self, state: Mapping[str, np.ndarray]) -> None:
        """Restore a state of `get_state`; raises `StateError` before anything changes if it does not fit."""
        snapshot.check_arrays(state, self.get_state())
        sun = np.asarray(state["sun"])
        wrong = {
            "sun": (sun < 0) | (sun >= self.frames.lights),
            "generator": snapshot.impossible_generators(state["generator"], state["begun"]),
        }
        self.rivers.settle()  # gives back what a call left that ended with an error
        snapshot.check_values(state, self.rivers.segments_in(state), wrong)
        snapshot.check_looks(state["look"])
        check_forces(state)
        self.rivers.restore(state)
        self.forces.set_state(state)
        kept = {**state, "world": self.rivers.slot}
        snapshot.restore_state(kept, self.state, self.generators, self.started, self.ended)
        self.frames.look[:], self.frames.sun[:] = state["look"], state["sun"]
        self.observer.load_state(state)

    @cached_property
    def _identity(self) -> dict[str, np.ndarray]:
        return snapshot.env_identity(self.rivers.fingerprint(), self.config)
