"""How do many episodes run at once? The native Gymnasium vector environment: it only wires the answers of its
neighbours.

One call of the rules and one of the renderer serve all N environments, whatever worlds they fly in. Arrays that are
returned are never written to again.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cached_property
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from thalweg.core import fork
from thalweg.env import snapshot as state_arrays
from thalweg.env.actions import action_space, from_units, units
from thalweg.env.config import DEFAULT_CONFIG, REASON_NAMES, ConfigError, DoneReason, EnvConfig, refuse_unknown, whole
from thalweg.env.initial_poses import check_pose, heading_way, located, random_clock, random_start
from thalweg.env.observation import observation_space, observed, one_of
from thalweg.env.task.course_arrays import config_fingerprint, fingerprint, pack
from thalweg.env.task.rules import empty_outcome, empty_state, step_all
from thalweg.env.views import View, lit
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.world.record import World

OPTIONS = ("pose", "reset_mask")


class RiverVectorEnv(VectorEnv):
    """N environments over one or several worlds; environment i flies in world i % len(worlds).

    `info` belongs to the action just taken in every autoreset mode: `cost` [N], `costs` [N, 2] (tight, loose),
    `done_reason` [N], `progress` [N] (share of segments visited), `pose` [N, 4]; beside them `final_obs` and
    `final_info` as Gymnasium defines them. Environment i draws from a generator of its own, seeded with seed + i, so
    that its episodes do not depend on how many others there are.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": 1.0 / DEFAULT_CONFIG.step_s,
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }
    done_reasons = REASON_NAMES
    """What the codes of `info["done_reason"]` are called."""

    def __init__(
        self,
        worlds: World | Sequence[World],
        num_envs: int = 1,
        config: EnvConfig = DEFAULT_CONFIG,
        *,
        renderer: Any = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        render_mode: str | None = None,
    ) -> None:
        """`renderer`: any object with `.camera` and `.render(poses, world_index, time_s, out)`; None: ours, made when
        needed. One that has `.worlds` must have ours, and a `config.camera` of one's own must be the renderer's."""
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ConfigError(f"unknown render_mode {render_mode!r}; known: {', '.join(self.metadata['render_modes'])}")
        self.worlds = (worlds,) if isinstance(worlds, World) else tuple(worlds)
        self.num_envs = whole("num_envs", num_envs, 1)
        self.config = config
        self.autoreset_mode = _mode(autoreset_mode)
        frames_per_s = 1.0 / config.step_s if config.step_s > 0 else self.metadata["render_fps"]
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode, "render_fps": frames_per_s}
        self.render_mode = render_mode
        if renderer is not None:
            if config.randomisation is not None:
                raise ConfigError("randomisation needs a renderer of its own: give either that or a renderer")
            _check_renderer(renderer, self.worlds, config)
        self.camera = config.camera if renderer is None else renderer.camera
        if config.randomisation is not None:
            look_rows(config.randomisation.ends, self.camera)  # refuses angles that no camera has
        self._renderer = renderer

        self.courses = pack(self.worlds, config)
        self.limits = config.limits
        self.world_index = np.arange(self.num_envs, dtype=np.int64) % len(self.worlds)
        self.state = empty_state(self.world_index, self.courses)
        self.generators: list[np.random.Generator | None] = [None] * self.num_envs
        self._begun = np.zeros(self.num_envs, dtype=bool)
        self._ended = np.zeros(self.num_envs, dtype=bool)
        self._outcome = empty_outcome(self.num_envs)
        self._shown: np.ndarray | None = None
        self._look = look_values(None, self.num_envs)
        self._sun = np.zeros(self.num_envs, dtype=np.int64)

        self.single_action_space = action_space(config.action)
        self.single_observation_space = observation_space(
            config.observation, self.camera.height_px, self.camera.width_px
        )
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin new episodes in all environments, or those of `options["reset_mask"]` [N] bool; returns observations
        and info.

        `options["pose"]`, [4] or [N, 4], begins them there; raises `UnsafePoseError` when a pose breaks a limit.
        """
        rows, poses = self.checked_options(options)
        seeds = self._seeds(seed)
        renewed = [row for row in rows if seeds[row] is not None or self.generators[row] is None]
        for row, generator in [(row, seeding.np_random(seeds[row])[0]) for row in renewed]:
            self.generators[row] = generator
            self.draw_look(row, "environment")
        if isinstance(seed, int | np.integer):
            self._np_random_seed = int(seed)
        return self.begin(rows, poses)

    def begin(self, rows: Sequence[int], poses: np.ndarray | None) -> tuple[Any, dict[str, Any]]:
        """Begin new episodes in the environments `rows`, at checked poses [N, 4] or random ones; returns as
        `reset`."""
        for row in rows:
            self._begin(row, None if poses is None else poses[row])
        _clear(self._outcome, rows)
        chosen = np.zeros(self.num_envs, dtype=bool)
        chosen[rows] = True
        return self._observe(self._view()), self._info(chosen)

    def step(self, actions: Any) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One action [N, 4] in each environment: observations, rewards [N], terminated [N], truncated [N], info.

        Raises `ActionError` before anything changes, and `gymnasium.error.ResetNeeded` where an episode has to begin
        first.
        """
        shares = units(self.config.action, actions, self.num_envs)
        if not self._begun.all():
            raise gymnasium.error.ResetNeeded("call reset() before step()")
        mode = self.autoreset_mode
        if mode is AutoresetMode.DISABLED and self._ended.any():
            ended = np.flatnonzero(self._ended).tolist()
            raise gymnasium.error.ResetNeeded(f"the episodes of environments {ended} have ended; reset them first")

        active = ~self._ended
        step_all(active, shares, self.courses, self.limits, self.state, self._outcome)
        self.state.time_s[active] += self.config.step_s
        for row in np.flatnonzero(~active):
            self._begin(int(row))
        reason = self._outcome.reason
        truncated = reason == DoneReason.MAX_STEP_REACHED
        terminated = (reason >= 0) & ~truncated
        info = self._info(np.ones(self.num_envs, dtype=bool))
        self._ended[:] = reason >= 0
        if mode is AutoresetMode.SAME_STEP and self._ended.any():
            observations = self._begin_ended(info)
        else:
            observations = self._observe(self._view())
        return observations, self._outcome.reward.copy(), terminated, truncated, info

    def observe(self) -> Any:
        """The observations of the present state, as `reset` and `step` return them; for use after `set_state`."""
        return self._observe(self._view())

    def render(self) -> tuple[np.ndarray, ...] | None:
        """The frames now seen, N of [H, W, 3] uint8; None without a render mode."""
        if self.render_mode is None:
            return None
        if self._shown is None:
            self._shown = self._frames(self._view())[..., :3].copy()
        return tuple(frame.copy() for frame in self._shown)

    def pilot_actions(self) -> np.ndarray:
        """Actions [N, 4] of the scripted pilot, which knows the map, for the present state."""
        from thalweg.env.pilot.scripted import Pilot

        if not self._begun.all():
            raise gymnasium.error.ResetNeeded("call reset() before pilot_actions()")
        if not hasattr(self, "_pilot"):
            self._pilot = Pilot(self.courses, self.config)
        return from_units(self.config.action, self._pilot.shares(self.state))

    def get_state(self) -> dict[str, np.ndarray]:
        """Everything that the future depends on, generators included, as arrays of its own."""
        state = state_arrays.gathered(self.state, self.generators, self._begun, self._ended, self._fixed)
        return {**state, "look": self._look.copy(), "sun": self._sun.copy()}

    @cached_property
    def _fixed(self) -> dict[str, np.ndarray]:
        """What a state must have in common with this environment to be its own."""
        return {
            "fingerprint": np.array([fingerprint(world) for world in self.worlds], dtype=np.uint64),
            "config": np.array([config_fingerprint(self.config)], dtype=np.uint64),
        }

    def set_state(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from a state of `get_state`; raises `StateError` before anything changes when it does not fit."""
        state_arrays.check(state, self.get_state(), self.courses.segments[self.world_index], self._suns)
        state_arrays.scatter(state, self.state, self.generators, self._begun, self._ended)
        self._look[:], self._sun[:] = state["look"], state["sun"]
        self._shown = None

    def checked_options(self, options: Mapping[str, Any] | None) -> tuple[list[int], np.ndarray | None]:
        """Rows to reset and their poses [N, 4] or None; everything is checked here, before anything changes."""
        options = options or {}
        refuse_unknown("reset option", options, OPTIONS)
        mask = options.get("reset_mask")
        if mask is None:
            mask = np.ones(self.num_envs, dtype=bool)
        mask = np.asarray(mask)
        if mask.dtype != bool or mask.shape != (self.num_envs,) or not mask.any():
            raise ConfigError(f"reset_mask must be [{self.num_envs}] bool with at least one True")
        if not (self._begun | mask).all():
            raise gymnasium.error.ResetNeeded("the first reset must begin every environment")
        rows = np.flatnonzero(mask).tolist()
        poses = options.get("pose")
        if poses is not None:
            poses = np.asarray(poses, dtype=np.float64)
            if poses.shape not in ((4,), (self.num_envs, 4)):
                raise ConfigError(f"pose has shape {poses.shape}; needed: (4,) or ({self.num_envs}, 4)")
            poses = np.broadcast_to(poses, (self.num_envs, 4))
            for row in rows:
                check_pose(self.courses, int(self.world_index[row]), self.config, poses[row])
        return rows, poses

    def _seeds(self, seed: int | Sequence[int | None] | None) -> Sequence[int | None]:
        """One seed or None per environment; raises `ConfigError` for anything else."""
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, str) or not hasattr(seed, "__len__"):
            first = whole("seed", seed, 0)
            return [first + row for row in range(self.num_envs)]
        assert not isinstance(seed, int)
        if len(seed) != self.num_envs:
            raise ConfigError(f"{len(seed)} seeds for {self.num_envs} environments")
        return [None if one is None else whole("each seed", one, 0) for one in seed]

    def _begin(self, row: int, pose: np.ndarray | None = None) -> None:
        """Begin an episode in one environment, at a pose [4] or a random one."""
        state, world = self.state, int(self.world_index[row])
        generator = self.generators[row]
        assert generator is not None
        if pose is None:
            pose, time_s = random_start(self.courses, world, self.config, self.limits, generator)
        else:
            time_s = random_clock(generator)
        state.pose[row] = pose
        x, y, _, yaw = state.pose[row]
        segment, fraction, _ = located(self.courses, world, x, y)
        state.segment[row] = segment
        state.travel[row] = heading_way(self.courses, world, segment, fraction, yaw)
        state.visited[row] = 0
        state.visited_count[row] = state.steps[row] = state.idle[row] = 0
        state.time_s[row] = time_s
        self.draw_look(row, "episode")
        self._begun[row] = True
        self._ended[row] = False

    def _begin_ended(self, info: dict[str, Any]) -> Any:
        """Begin anew where an episode ended, add `final_obs` and `final_info`; the observations of the new poses."""
        rows = np.flatnonzero(self._ended)
        last = self._view(rows)
        ended = self._ended.copy()
        for row in rows:
            self._begin(int(row))
        batch = self._observe(View(*(np.concatenate(pair) for pair in zip(self._view(), last, strict=True))))
        final_obs = np.full(self.num_envs, None, dtype=object)
        for place, row in enumerate(rows):
            final_obs[row] = one_of(batch, self.num_envs + place)
        final_info = {key: np.zeros_like(value) for key, value in info.items()}
        for key, value in info.items():
            final_info[key][rows] = value[rows]
        info |= {"final_obs": final_obs, "_final_obs": ended, "final_info": final_info, "_final_info": ended.copy()}
        if isinstance(batch, dict):
            return {key: value[: self.num_envs] for key, value in batch.items()}
        return batch[: self.num_envs]

    def _info(self, chosen: np.ndarray) -> dict[str, Any]:
        """The info of the last action; chosen [N] bool marks the environments that it is about."""
        state, outcome = self.state, self._outcome
        info = {
            "cost": outcome.costs.sum(axis=1),
            "costs": outcome.costs.copy(),
            "done_reason": outcome.reason.copy(),
            "progress": state.visited_count / self.courses.segments[self.world_index],
            "pose": state.pose.copy(),
        }
        return info | {f"_{key}": chosen.copy() for key in info}

    @property
    def _suns(self) -> int:
        """Lights in which each world is drawn."""
        return max(self.config.randomisation.suns, 1) if self.config.randomisation else 1

    def draw_look(self, row: int, period: str) -> None:
        """Draw the look of one environment, if it changes with this period."""
        randomisation, generator = self.config.randomisation, self.generators[row]
        if randomisation is not None and randomisation.per == period:
            assert generator is not None
            self._look[row], self._sun[row] = randomisation.draw(generator)

    def _view(self, rows: np.ndarray | slice = slice(None)) -> View:
        """What the environments `rows` see now, as arrays of its own."""
        state = self.state
        return View(
            *(a[rows].copy() for a in (state.pose, self.world_index, state.time_s, self._look, self._sun))
        )  # fmt: skip

    def _observe(self, view: View) -> Any:
        """Observations [M, ...] of M views; the first N are those now seen."""
        self._shown = None
        if self.config.observation == "none":
            return view.pose
        frames = self._frames(view)
        if self.render_mode is not None:
            self._shown = frames[: self.num_envs, ..., :3].copy()
        return observed(self.config.observation, frames)

    def _frames(self, view: View) -> np.ndarray:
        """Frames [M, H, W, 4] uint8 in memory of their own."""
        fork.raise_if_forked()
        if self._renderer is None:
            from thalweg.render import Renderer

            self._renderer = Renderer(lit(self.worlds, self.config.randomisation), self.camera, self.config.quality)
        out = np.empty((len(view.pose), self.camera.height_px, self.camera.width_px, 4), dtype=np.uint8)
        if self.config.randomisation is None:
            return self._renderer.render(view.pose, view.world, view.time_s, out)
        drawn = view.world * self._suns + view.sun
        return self._renderer.render(view.pose, drawn, view.time_s, out, look=view.look)


def _check_renderer(renderer: Any, worlds: Sequence[World], config: EnvConfig) -> None:
    """Raises `ConfigError` for a renderer that says that it draws other worlds, or through another camera than the
    config asks for."""
    drawn = getattr(renderer, "worlds", None)
    if drawn is not None and not (
        len(drawn) == len(worlds)
        and all(a is b or fingerprint(a) == fingerprint(b) for a, b in zip(drawn, worlds, strict=True))
    ):
        raise ConfigError("the renderer draws other worlds than those of this environment")
    asked = asdict(config.camera)
    other = [name for name, value in asked.items() if getattr(renderer.camera, name, value) != value]
    if other and config.camera != DEFAULT_CONFIG.camera:
        raise ConfigError(f"config.camera is not the renderer's: {', '.join(other)} of {config.camera}")
    quality = getattr(renderer, "quality", config.quality)
    if config.quality not in (quality, DEFAULT_CONFIG.quality):
        raise ConfigError(f"config.quality = {config.quality!r} is not the renderer's, {quality!r}")


def _mode(given: AutoresetMode | str) -> AutoresetMode:
    """An autoreset mode from itself or its name."""
    for mode in AutoresetMode:
        if given is mode or (isinstance(given, str) and given.lower() in (mode.value.lower(), mode.name.lower())):
            return mode
    raise ConfigError(f"unknown autoreset_mode {given!r}; known: {', '.join(mode.name for mode in AutoresetMode)}")


def _clear(outcome: Any, rows: Sequence[int]) -> None:
    """Forget the last step of some environments."""
    outcome.reward[rows] = 0.0
    outcome.costs[rows] = 0.0
    outcome.reason[rows] = DoneReason.RUNNING
