"""Vector environment: N episodes in one or many worlds, as a native Gymnasium `VectorEnv`.

One call of the rules and one of the renderer serve all N environments. Returned arrays are never written to again.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from thalweg.env.config import DEFAULT_CONFIG, REASON_NAMES, ConfigError, EnvConfig, integer_at_least
from thalweg.env.episodes.episodes import Episodes
from thalweg.env.episodes.info import final_info_of, info_of
from thalweg.env.episodes.reset_arguments import autoreset_mode_of, first_seed, rows_and_poses, seeds_of
from thalweg.env.forces.of_many import ForcesOfMany
from thalweg.env.frame_renderer import FrameRenderer, Views
from thalweg.env.given import check_config, worlds_of
from thalweg.env.observer import Observer
from thalweg.env.rivers.assignment import DrawnRivers, FixedRivers, Rivers
from thalweg.env.rivers.pool import RiverPool
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.spaces import (
    CHANNELS,
    action_space,
    first_observations,
    from_unit_actions,
    observation_space,
    to_unit_actions,
)
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.critic_info import critic_space
from thalweg.env.task.termination import terminated_and_truncated
from thalweg.render.records.camera import Distortion
from thalweg.render.records.pinhole import CameraMatrices
from thalweg.world.record import World


class RiverVectorEnv(VectorEnv):
    """N environments over one or many worlds.

    Environment i flies in world i % len(worlds). With a `RiverList` in place of worlds it flies each episode in a river
    of the list that its own generator draws, all with the same probability, and the next ones are prepared in the
    background; `info["river"]` [N] is the index of the river in the list. Wind and inertia add `wind` [N, 3] and
    `velocity` [N, 4] to it, see `thalweg.env.forces.of_many`.

    In every autoreset mode, `info` belongs to the action just taken: `cost` [N], `costs` [N, K] by kind
    (`cost_kinds`: tight, loose, that of the task, and shallow for a boat), `done_reason` [N], `progress` [N] (share of
    segments visited; of `Portage` see `thalweg.env.task.progress_share`) and `pose` [N, 4]. `final_obs` and
    `final_info` are as Gymnasium defines them. With `EnvConfig.critic_info`, `critic_obs` [N, C] float32 belongs to the
    state that the observation shows, see `thalweg.env.task.critic_info`, and so do `wind` and `velocity`; after an
    automatic reset in the same step, those of the last state are in `final_info`. Environment i has a random generator
    of its own, seeded with seed + i, so that its episodes do not depend on the number of environments.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": 1.0 / DEFAULT_CONFIG.step_s,
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }
    done_reasons = REASON_NAMES
    """Name of each code of `info["done_reason"]`."""
    single_critic_space: gymnasium.spaces.Box
    """Space of one row of `info["critic_obs"]`; absent without it."""

    def __init__(
        self,
        worlds: World | Sequence[World] | RiverList,
        num_envs: int = 1,
        config: EnvConfig = DEFAULT_CONFIG,
        *,
        renderer: Any = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        render_mode: str | None = None,
        device: str = "cpu",
    ) -> None:
        """Create the environments; raises `ConfigError` for arguments out of range or that contradict one another, and
        for a boat `thalweg.env.vehicle.boat.FitError` for a world that it does not fit. A river of a list raises that
        when it is loaded.

        `renderer` is any object with `.camera` and `.render(poses, world_index, time_s, out)`; None creates a
        `thalweg.render.Renderer` when it is needed. If it has `.render_mask(poses, world_index)`, observations that are
        masks come from there. If it has `.worlds`, they must be those of this environment. A `config.camera` other than
        the default must be that of the renderer.

        `device` is where a renderer that is created draws, see `thalweg.core.compute.device`; the rules are computed on
        the CPU and frames are arrays of the host in any case.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ConfigError(f"unknown render_mode {render_mode!r}; known: {', '.join(self.metadata['render_modes'])}")
        check_config(config)
        self.num_envs = integer_at_least("num_envs", num_envs, 1)
        self.config = config
        self.autoreset_mode = autoreset_mode_of(autoreset_mode)
        frames_per_s = 1.0 / config.step_s if config.step_s > 0 else self.metadata["render_fps"]
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode, "render_fps": frames_per_s}
        self.render_mode = render_mode
        self.worlds: tuple[World, ...] = ()
        """Those of all environments; empty if each episode has another one."""
        self.river_names: list[str] = []
        """Names of the rivers that `info["river"]` counts; empty if they do not change."""
        if isinstance(worlds, RiverList):
            self.river_names = worlds.names
            drawn = config.channels > 0 or render_mode is not None
            self.frames = FrameRenderer((), self.num_envs, config, renderer, changing=drawn, device=device)
            self.rivers: Rivers = DrawnRivers(
                RiverPool(worlds, config, self.num_envs, self.frames.slots), self.num_envs
            )
        else:
            self.worlds = worlds_of(worlds)
            self.frames = FrameRenderer(self.worlds, self.num_envs, config, renderer, device=device)
            self.rivers = FixedRivers(self.worlds, self.num_envs, config)
        self.camera = self.frames.camera
        self.observer = Observer(config, self.frames, self.num_envs, keeps_colours=render_mode is not None)
        self.limits = config.limits
        self.world_index = self.rivers.slot
        """[N] index of the world of each environment in the courses."""
        self.forces = ForcesOfMany(config, self.num_envs)
        self.frames.wind = self.forces.horizontal
        self._pilots: dict[str, Any] = {}
        """Those that were asked, by their names."""
        self.episodes = Episodes(config, self.rivers, self.frames, self.observer, self.forces)
        self.state, self.generators = self.episodes.state, self.episodes.generators
        self.cost_kinds = config.cost_kinds
        """Names of the K kinds of `info["costs"]`."""

        self.single_action_space = action_space(config.action)
        self.single_observation_space = observation_space(
            config.observation, self.camera.height_px, self.camera.width_px, config.task, config.vehicle
        )
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        if config.critic_info:
            self.single_critic_space = critic_space(config.observation, config.task, config.vehicle)

    @property
    def courses(self) -> CourseArrays:
        """Courses of the rivers in memory, as the rules take them."""
        return self.rivers.courses

    @property
    def camera_matrices(self) -> CameraMatrices:
        """Matrices K [N, 3, 3], R [N, 3, 3] and t [N, 3] of the cameras in the current state, in OpenCV's convention;
        see `thalweg.render.records.pinhole`. Raises `gymnasium.error.ResetNeeded` before the first reset."""
        self._check_started("camera_matrices")
        return self.frames.camera_matrices(self.state.pose)

    @property
    def camera_distortion(self) -> Distortion:
        """Distortion of the cameras, coefficients [N, D] in OpenCV's order, with the lens of the episode's look; zeros
        of `plumb_bob` for pinholes. Raises `RenderError` where a look changes the field of view of an equidistant
        lens."""
        return self.frames.distortion

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start new episodes in all environments, or in those of `options["reset_mask"]` [N] bool.

        Returns observations and info. `options["pose"]`, [4] or [N, 4], sets the initial poses; raises
        `UnsafePoseError` if one breaks a limit.
        """
        rows, poses = self.validate_options(options)
        seeds = seeds_of(seed, self.num_envs)
        reseeded = [row for row in rows if seeds[row] is not None or self.generators[row] is None]
        # All generators are created before the first is replaced, so that a bad seed changes nothing.
        for row, generator in [(row, seeding.np_random(seeds[row])[0]) for row in reseeded]:
            self.episodes.reseed(row, generator)
        if (first := first_seed(seed)) is not None:
            self._np_random, self._np_random_seed = seeding.np_random(first)
        return self.start_episodes(rows, poses)

    def start_episodes(self, rows: Sequence[int], poses: np.ndarray | None) -> tuple[Any, dict[str, Any]]:
        """Start new episodes in the environments `rows`, at validated poses [N, 4] or random ones; returns as
        `reset`."""
        self.rivers.settle()  # gives back what a call left that ended with an error
        for row in rows:
            self.episodes.begin(row, None if poses is None else poses[row])
            self.episodes.clear_outcome(row)
        mask = np.zeros(self.num_envs, dtype=bool)
        mask[rows] = True
        results = self.observe(), info_of(self.episodes, mask)
        self.rivers.settle()
        return results

    def step(self, actions: Any) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Take one action [N, 4] per environment; returns observations, rewards [N], terminated [N], truncated [N] and
        info. The step limit truncates in the paper's task and terminates in the others, whose deadline it is.

        Raises `ActionError` before anything changes, and `gymnasium.error.ResetNeeded` if an environment must be reset
        first.
        """
        unit_actions = to_unit_actions(self.config.action, actions, self.num_envs, self.config.fast_ratio)
        self._check_ready()
        self.rivers.settle()  # gives back what a call left that ended with an error
        ended, outcome = self.episodes.ended, self.episodes.outcome
        active = ~ended
        self.observer.step(self.state.pose, unit_actions)
        self.forces.step_all(active, unit_actions, self.courses, self.limits, self.state, outcome)
        self.state.time_s[active] += self.config.step_s
        for row in np.flatnonzero(~active):
            self.episodes.begin(int(row))
        terminated, truncated = terminated_and_truncated(outcome.reason, self.limits)
        info = info_of(self.episodes, np.ones(self.num_envs, dtype=bool))
        ended[:] = terminated | truncated
        if self.autoreset_mode is AutoresetMode.SAME_STEP and ended.any():
            observations = self._restart_ended(info)
        else:
            observations = self.observe()
        self.rivers.settle()
        return observations, outcome.reward.copy(), terminated, truncated, info

    def observe(self) -> Any:
        """Return the observations of the current state, as `reset` and `step` do; for use after `set_state`. Raises
        `gymnasium.error.ResetNeeded` before the first reset, as the other methods do that show a state."""
        self._check_started("observe()")
        return self.observer.observe(self.courses, self.observer.views(self.courses, self.state))

    def ideal_eye(self) -> np.ndarray:
        """Return what the ideal eye sees of the current state [N, F] float32, whatever is observed; its F numbers are
        `thalweg.env.task.priced.eye.features_of` the task."""
        self._check_started("ideal_eye()")
        return self.observer.see(self.courses, self.frames.views(self.state))

    def draw(self, river: np.ndarray, views: Views) -> np.ndarray:
        """Return the frames [M, H, W, C] of any views, such as stored ones, as observations are, with the objects that
        the views hold in place of those of the task, if any.

        `river` [M] are indices in the list of rivers, which take the place of `views.world`; rivers that are not in
        memory are loaded. Raises `ConfigError` for environments that stay in one river, or draw nothing.
        """
        if not isinstance(self.rivers, DrawnRivers):
            raise ConfigError("draw needs rivers that change: give a RiverList in place of worlds")
        if self.config.observation not in CHANNELS:
            known = ", ".join(CHANNELS)
            raise ConfigError(f"draw needs observations that are images, {known}, not {self.config.observation!r}")
        shape = len(river), self.camera.height_px, self.camera.width_px, CHANNELS[self.config.observation]
        drawn = np.empty(shape, np.uint8)
        for rows, slots in self.rivers.loaded(river):
            drawn[rows] = self.observer.observe(self.courses, views.rows(rows)._replace(world=slots))
        self.observer.forget_colours()
        return drawn

    def props(self) -> np.ndarray | None:
        """Return the objects [N, P, 6] of the task about each vehicle, as `thalweg.render.records.props`; None in a
        task without any."""
        self._check_started("props()")
        return self.observer.props_about(self.courses, self.state)

    def render(self) -> tuple[np.ndarray, ...] | None:
        """Return the frames of the current state, N of [H, W, 3] uint8, or None without a render mode."""
        if self.render_mode is None:
            return None
        self._check_started("render()")
        return tuple(frame.copy() for frame in self.observer.colours(self.courses, self.state))

    def pilot_actions(self, pilot: str = "scripted") -> np.ndarray:
        """Return the actions [N, 4] of a pilot that knows the map in the current state: `scripted`, which is fast, or
        `steady`, whose moves can be read off the frames. Raises `ConfigError` for another one, and
        `gymnasium.error.ResetNeeded` before the first reset."""
        chosen, state = self._pilot(pilot)
        return from_unit_actions(self.config.action, chosen.unit_actions(state), self.config.fast_ratio)

    def move_worths(self) -> np.ndarray:
        """Return the worths [N, M] of all `thalweg.env.moves.MOVES` in the current state, as the steady pilot
        judges them; see `SteadyPilot.worths`. Raises `gymnasium.error.ResetNeeded` before the first reset."""
        chosen, state = self._pilot("steady")
        return chosen.worths(state)

    def _pilot(self, name: str) -> tuple[Any, Any]:
        """Return a pilot in the rivers of now, and the state as it takes it."""
        from thalweg.env.pilot.in_rivers import PILOTS, PilotInRivers

        pilots = PILOTS[self.config.vehicle]
        if name not in pilots:
            raise ConfigError(f"unknown pilot {name!r} of the {self.config.vehicle}; known: {', '.join(pilots)}")
        self._check_started("asking a pilot")
        if name not in self._pilots:
            self._pilots[name] = PilotInRivers(pilots[name], self.config)
        return self._pilots[name].pilot(self.rivers, self.state)

    def get_state(self) -> dict[str, np.ndarray]:
        """Return copies of everything that the future depends on, random generators included."""
        return self.episodes.get_state()

    def set_state(self, state: Mapping[str, np.ndarray]) -> None:
        """Restore a state of `get_state`; raises `StateError` before anything changes if it does not fit."""
        self.episodes.set_state(state)

    def close_extras(self, **kwargs: Any) -> None:
        """Stop what runs in the background."""
        self.rivers.close()

    def validate_options(self, options: Mapping[str, Any] | None) -> tuple[list[int], np.ndarray | None]:
        """Return the rows to reset and their poses [N, 4] or None.

        Everything is checked here, before anything changes: raises `ConfigError`, `UnsafePoseError` and
        `gymnasium.error.ResetNeeded`.
        """
        return rows_and_poses(options, self.episodes.started, self.config, self.rivers)

    def _check_started(self, what: str) -> None:
        """Raise `gymnasium.error.ResetNeeded` unless every environment had a reset."""
        if not self.episodes.started.all():
            raise gymnasium.error.ResetNeeded(f"call reset() before {what}")

    def _check_ready(self) -> None:
        """Raise `gymnasium.error.ResetNeeded` unless every environment can step."""
        self._check_started("step()")
        if self.autoreset_mode is AutoresetMode.DISABLED and self.episodes.ended.any():
            ended = np.flatnonzero(self.episodes.ended).tolist()
            raise gymnasium.error.ResetNeeded(f"the episodes of environments {ended} have ended; reset them first")

    def _restart_ended(self, info: dict[str, Any]) -> Any:
        """Start new episodes where one ended, add `final_obs` and `final_info`; returns the new observations."""
        ended = self.episodes.ended.copy()
        rows = np.flatnonzero(ended)
        last_views = self.observer.views(self.courses, self.state, rows)
        for row in rows:
            self.episodes.begin(int(row))
        # One call of the renderer draws the new frames [N] and the last ones of the ended episodes.
        views = self.observer.views(self.courses, self.state).and_views(last_views)
        batch = self.observer.observe(self.courses, views)
        final = final_info_of(info, batch, ended)
        if self.config.critic_info:
            info["critic_obs"] = self.observer.critic_obs(self.courses, self.state)
        info |= self.episodes.forces.info()  # of the new episodes
        info |= final
        return first_observations(batch, self.num_envs)
