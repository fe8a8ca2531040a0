"""Environment of tensors: N episodes on one device, from which nothing is copied in a step.

The rules, rewards, costs and frames are those of `RiverVectorEnv` with `autoreset_mode="next_step"`: an environment
whose episode has ended resets in its next step, ignores the action of that step and returns no reward for it. Two
things differ: random numbers are those of `thalweg.env.device.step`, and tensors are reused. What `reset` and `step`
return is valid until the second step after; copy what is needed longer.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from torch import Tensor

from thalweg.core.compute import gpu
from thalweg.core.compute.device import resolve_device
from thalweg.core.compute.launch_graphs import LaunchGraphs
from thalweg.env.config import DEFAULT_CONFIG, REASON_NAMES, ConfigError, DoneReason, EnvConfig, integer_at_least
from thalweg.env.device.memory import bytes_per_env, check_memory, free_bytes
from thalweg.env.device.pushed_step import advance_pushed_all
from thalweg.env.device.step import advance_all, reset_arguments
from thalweg.env.forces.arrays import ForceState, empty_forces, force_numbers, has_forces
from thalweg.env.forces.of_many import PREFIX, write_winds
from thalweg.env.frame_renderer import lights_per_world, relit_worlds
from thalweg.env.initial_poses import random_start
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.snapshot import StateError, env_identity, fingerprints
from thalweg.env.spaces import ActionError, action_space, observation_space, to_unit_actions
from thalweg.env.task.course_arrays import CourseArrays, pack_courses
from thalweg.env.task.critic_info import PROGRESS, critic_space, write_progress
from thalweg.env.task.ideal_eye import FEATURES, see_all
from thalweg.env.task.rules import Outcome, State, empty_outcome, empty_state
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.render.records.breeze import ruffle
from thalweg.world.record import World

LOOKS = 4096
"""Number of looks drawn in advance, from which each episode takes one; see `Randomisation`."""
BUFFERS = 2
"""Number of frame buffers, which are written alternately."""

Info = dict[str, Tensor]


class TensorRiverEnv:
    """N environments over one or several worlds on one device; environment i flies in world i % len(worlds).

    `info` belongs to the action just taken: `cost` [N], `costs` [N, 2] (tight, loose), `done_reason` [N], `progress`
    [N] (share of segments visited) and `pose` [N, 4]; `wind` and `velocity` are as in `RiverVectorEnv`. With
    `EnvConfig.critic_info`, `critic_obs` [N, C] float32 belongs to the state that the observation shows, see
    `thalweg.env.task.critic_info`. Environment i is seeded with seed + i, so that its episodes do not depend on the
    number of environments. Rewards, costs and poses are float64.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.NEXT_STEP, "render_modes": []}  # noqa: RUF012
    done_reasons = REASON_NAMES
    """Name of each code of `info["done_reason"]`."""
    single_critic_space: gymnasium.spaces.Box
    """Space of one row of `info["critic_obs"]`; absent without it."""

    def __init__(
        self,
        worlds: World | Sequence[World],
        num_envs: int = 1,
        config: EnvConfig = DEFAULT_CONFIG,
        *,
        device: str = "auto",
    ) -> None:
        """Create the environments.

        Raises `ConfigError`, also for more environments than the device has memory for, `RenderError` for more worlds
        than that, `DeviceError`, and `UnsafePoseError` for a world without a safe start.
        """
        if isinstance(worlds, RiverList):
            raise ConfigError("environments of tensors do not change river: give worlds, not a list of rivers")
        self.worlds = (worlds,) if isinstance(worlds, World) else tuple(worlds)
        self.num_envs, self.config = integer_at_least("num_envs", num_envs, 1), config
        self.device = torch.device(resolve_device(device))
        courses = pack_courses(self.worlds, config)
        shared = 0
        if self.device.type != "cpu" and config.channels:
            shared = self._renderer.scratch_bytes
        check_memory(self.num_envs, bytes_per_env(courses, config, BUFFERS), shared, free_bytes(self.device))
        for world in range(len(self.worlds)):  # a reset on the device cannot report that there is no safe start
            random_start(courses, world, config, config.limits, np.random.default_rng(world))
        self.world_index = np.arange(self.num_envs, dtype=np.int64) % len(self.worlds)
        """[N] index of the world of each environment."""
        self._lights = lights_per_world(config.randomisation)
        self._look_rows, self._look_lights = (self._tensor(values) for values in self._draw_looks())
        """[LOOKS, P] the looks as the renderer takes them, and [LOOKS] the light of each; one of each without
        randomisation."""
        self._allocate(courses)
        self._buffer, self._started = 0, False
        self._graphs = LaunchGraphs(self.device)
        """CUDA graphs of the launches of a step, whose arguments never change."""

        size = config.camera.height_px, config.camera.width_px
        self.single_action_space = action_space(config.action)
        self.single_observation_space = observation_space(config.observation, *size)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        if config.critic_info:
            self.single_critic_space = critic_space(config.observation)

    def _draw_looks(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the looks [LOOKS, P] of the randomisation and the light [LOOKS] of each; one of each without it."""
        randomisation = self.config.randomisation
        values, lights = look_values(None, 1), np.zeros(1, np.int64)
        if randomisation is not None:
            generator = np.random.default_rng(LOOKS)
            drawn = [randomisation.draw(generator) for _ in range(LOOKS)]
            values, lights = np.array([look for look, _ in drawn]), np.array([light for _, light in drawn])
        return look_rows(values, self.config.camera), lights

    def _allocate(self, courses: CourseArrays) -> None:
        """Create the tensors of all episodes, and the kernels' views of them."""
        state = empty_state(self.world_index, courses)._asdict()
        outcome = empty_outcome(self.num_envs)._asdict()
        counters: dict[str, np.ndarray] = {
            name: np.zeros(self.num_envs, np.int64) for name in ("seed", "episode", "look")
        }
        counters["ended"] = np.ones(self.num_envs, np.uint8)
        pushed = has_forces(self.config)
        force = empty_forces(self.num_envs)._asdict() if pushed else {}
        force = {PREFIX + name: values for name, values in force.items()}
        everything = {**state, **outcome, **counters, **force}
        self._tensors = {name: self._tensor(values) for name, values in everything.items()}
        """Everything that a step reads and changes."""
        self._state_names = (*state, *counters, *force)
        """Names of the tensors that the future depends on."""
        self._segments = self._tensor(courses.segments[self.world_index])
        self._max_steps = self._tensor(courses.max_steps[self.world_index])
        arrays = {name: self._array(tensor) for name, tensor in self._tensors.items()}
        self._courses = CourseArrays(*(self._array(self._tensor(values)) for values in courses))
        reset = reset_arguments(
            self.config, arrays["seed"], arrays["episode"], arrays["look"], len(self._look_rows)
        )  # fmt: skip
        self._forces = (force_numbers(self.config), ForceState(*(arrays[name] for name in force))) if pushed else None
        """Numbers and arrays of wind, current and inertia; None without them."""
        before, after = ((self._forces[0],), (self._forces[1],)) if self._forces else ((), ())
        self._arguments = (
            self._courses,
            self.config.limits,
            *before,
            reset,
            State(**{name: arrays[name] for name in state}),
            *after,
            Outcome(**{name: arrays[name] for name in outcome}),
            arrays["ended"],
        )
        """Arguments of `advance_all`, or with forces of `advance_pushed_all`, after the actions."""

    @property
    def unwrapped(self) -> "TensorRiverEnv":
        return self

    def reset(self, *, seed: int = 0) -> tuple[Any, Info]:
        """Start the first episodes of new seeds in all environments; returns observations and info."""
        first = integer_at_least("seed", seed, 0)
        self._tensors["seed"].copy_(torch.arange(first, first + self.num_envs))
        self._tensors["episode"].zero_()
        self._tensors["ended"].fill_(1)
        self._started = True
        self._advance(torch.zeros(self.num_envs, 4, dtype=torch.float64, device=self.device))
        return self._observations(), self._info()

    def step(self, actions: Tensor) -> tuple[Any, Tensor, Tensor, Tensor, Info]:
        """Take one action [N, 4] per environment; returns observations, rewards [N], terminated [N], truncated [N] and
        info.

        Raises `ActionError` for another shape, type or device, and on the CPU for values out of range. A GPU clips
        those, because checking them would make the host wait. Raises `gymnasium.error.ResetNeeded` before the first
        reset.
        """
        unit_actions = self._unit_actions(actions)
        if not self._started:
            raise gymnasium.error.ResetNeeded("call reset() before step()")
        self._advance(unit_actions)
        reason, reward = self._tensors["reason"], self._tensors["reward"].clone()
        truncated = reason == int(DoneReason.MAX_STEP_REACHED)
        return self._observations(), reward, (reason >= 0) & ~truncated, truncated, self._info()

    def get_state(self) -> dict[str, np.ndarray]:
        """Return everything that the future depends on, as arrays on the host."""
        return {name: self._tensors[name].cpu().numpy().copy() for name in self._state_names} | self._identity

    def set_state(self, state: Mapping[str, np.ndarray]) -> None:
        """Restore a state of `get_state`; raises `StateError` before anything changes if it does not fit."""
        current = self.get_state()
        if set(state) != set(current):
            raise StateError(f"the state has the arrays {sorted(state)}; needed: {sorted(current)}")
        for name, value in current.items():
            given = np.asarray(state[name])
            if given.shape != value.shape or given.dtype != value.dtype:
                raise StateError(
                    f"{name} is {given.dtype} {given.shape}; this environment has {value.dtype} {value.shape}"
                )
            if name in (*self._identity, "world") and not np.array_equal(given, value):
                raise StateError(f"the state belongs to other worlds or another config ({name} differs)")
        for name in self._state_names:
            self._tensors[name].copy_(torch.from_numpy(np.array(state[name])))
        self._started = True

    def observe(self) -> Any:
        """Return the observations of the current state, as `step` does; for use after `set_state`."""
        return self._observations()

    def close(self) -> None:
        """Do nothing: the environment holds no resources that must be released."""

    @cached_property
    def _identity(self) -> dict[str, np.ndarray]:
        return env_identity(fingerprints(self.worlds), self.config)

    @cached_property
    def _frames(self) -> list[Tensor]:
        """Frame buffers [N, H, W, 4] uint8, or [N, H, W, 1] of masks."""
        camera = self.config.camera
        shape = self.num_envs, camera.height_px, camera.width_px, self.config.channels
        return [torch.zeros(shape, dtype=torch.uint8, device=self.device) for _ in range(BUFFERS)]

    @cached_property
    def _actions(self) -> Tensor:
        """Unit actions [N, 4] float64 of a step on a GPU."""
        return torch.zeros(self.num_envs, 4, dtype=torch.float64, device=self.device)

    @cached_property
    def _seen(self) -> Tensor:
        """What the ideal eye sees [N, FEATURES] float32; memory that `_see` fills again and again."""
        return torch.zeros(self.num_envs, len(FEATURES), dtype=torch.float32, device=self.device)

    @cached_property
    def _blowing(self) -> Tensor:
        """The wind [N, 3] float64; memory that `_wind` fills again and again."""
        return torch.zeros(self.num_envs, 3, dtype=torch.float64, device=self.device)

    @cached_property
    def _renderer(self) -> Any:
        """Renderer on this device."""
        from thalweg.render import Renderer

        worlds = relit_worlds(self.worlds, self.config.randomisation)
        return Renderer(worlds, self.config.camera, self.config.quality, device=str(self.device))

    def _advance(self, unit_actions: Tensor) -> None:
        """Step or reset every environment by unit actions [N, 4] float64."""
        if self.device.type == "cpu":
            advance = advance_all if self._forces is None else advance_pushed_all
            advance(self._array(unit_actions), *self._arguments)
            return
        from thalweg.env.device import cuda_step

        self._actions.copy_(unit_actions)
        advance = cuda_step.advance if self._forces is None else cuda_step.advance_pushed
        self._launch("advance", advance, lambda: (self._array(self._actions), *self._arguments))

    def _launch(self, name: str, kernel: Callable[..., None], arguments: Callable[[], tuple[Any, ...]]) -> None:
        """Launch a kernel of `cuda_step`, or replay its launch; it always has the same arguments."""
        from thalweg.env.device.cuda_step import THREADS

        blocks = -(-self.num_envs // THREADS)
        self._graphs.run(name, lambda: gpu.launch(kernel, blocks, THREADS, self.device, *arguments(), fastmath=False))

    def _unit_actions(self, actions: Tensor) -> Tensor:
        """Return actions as unit actions [N, 4] float64; raises `ActionError`."""
        if not isinstance(actions, Tensor):
            raise ActionError(f"actions are a tensor on {self.device}, not {type(actions).__name__}")
        if self.device.type == "cpu" and actions.device.type == "cpu":
            return torch.from_numpy(to_unit_actions(self.config.action, actions.detach().numpy(), self.num_envs))
        if actions.shape != (self.num_envs, 4) or actions.device != self.device:
            raise ActionError(
                f"actions have shape {tuple(actions.shape)} on {actions.device};"
                f" needed: ({self.num_envs}, 4) on {self.device}"
            )
        integers = not (actions.is_floating_point() or actions.is_complex() or actions.dtype == torch.bool)
        if self.config.action == "multidiscrete" and not integers:
            raise ActionError(f"actions have type {actions.dtype}; multidiscrete actions are integers 0, 1 or 2")
        units = actions.detach().double()
        return (1.0 - units if self.config.action == "multidiscrete" else units).clamp(-1.0, 1.0).contiguous()

    def _observations(self) -> Any:
        """Return the observations of the current state, in the buffer whose turn it is."""
        kind = self.config.observation
        if kind == "none":
            return self._tensors["pose"].clone()
        if kind == "privileged":
            return self._see()
        self._buffer = (self._buffer + 1) % BUFFERS
        frames = self._frames[self._buffer]
        tensors, look = self._tensors, self._tensors["look"]
        lit_world = tensors["world"] * self._lights + self._look_lights[look]
        looks = self._look_rows[look]
        if self.config.wind is not None:
            speed, towards, _ = tensors[PREFIX + "mean_wind"].T
            ruffle(looks, speed * towards.cos(), speed * towards.sin())
        views = lit_world, tensors["pose"], tensors["time_s"], looks
        self._renderer.render_tensors(views, frames)
        if kind == "dict":
            return {"rgb": frames[..., :3], "mask": frames[..., 3:]}
        return frames[..., :3] if kind == "rgb" else frames

    def _see(self) -> Tensor:
        """Return what the ideal eye sees [N, FEATURES] float32."""
        if self.device.type == "cpu":
            see_all(*self._arguments_of_see())
        else:
            from thalweg.env.device import cuda_step

            self._launch("see", cuda_step.see, self._arguments_of_see)
        return self._seen.clone()

    def _arguments_of_see(self) -> tuple[Any, ...]:
        """Return the arguments of `see_all`."""
        state = (self._array(self._tensors[name]) for name in ("world", "pose", "segment", "travel"))
        return self._courses, self.config.limits.max_height, *state, self._array(self._seen)

    def _info(self) -> Info:
        tensors = self._tensors
        told = {"critic_obs": self._critic_obs()} if self.config.critic_info else {}
        if self.config.wind is not None:
            told["wind"] = self._wind()
        if self.config.dynamics == "inertial":
            told["velocity"] = tensors[PREFIX + "velocity"].clone()
        return {
            "cost": tensors["costs"].sum(1),
            "costs": tensors["costs"].clone(),
            "done_reason": tensors["reason"].clone(),
            "progress": tensors["visited_count"] / self._segments,
            "pose": tensors["pose"].clone(),
            **told,
        }

    def _wind(self) -> Tensor:
        """Return the wind [N, 3] in m/s that blows in the next step."""
        if self.device.type == "cpu":
            write_winds(*self._arguments_of_wind())
        else:
            from thalweg.env.device import cuda_step

            self._launch("wind", cuda_step.write_winds, self._arguments_of_wind)
        return self._blowing.clone()

    def _arguments_of_wind(self) -> tuple[Any, ...]:
        """Return the arguments of `write_winds`."""
        assert self._forces is not None
        return *self._forces, self._array(self._blowing)

    def _critic_obs(self) -> Tensor:
        """Return what critics may see beside the observations of the current state [N, C] float32."""
        tensors = self._tensors
        told = torch.empty(self.num_envs, *self.single_critic_space.shape, dtype=torch.float32, device=self.device)
        write_progress(
            told,
            (tensors["visited_count"], self._segments),
            (tensors["idle"], self.config.max_idle_steps),
            (tensors["steps"], self._max_steps),
        )
        if told.shape[1] > len(PROGRESS):
            told[:, len(PROGRESS) :] = self._see()
        return told

    def _tensor(self, values: np.ndarray) -> Tensor:
        """Return a copy of an array on the device."""
        return torch.from_numpy(np.array(values)).to(self.device)

    def _array(self, tensor: Tensor) -> Any:
        """Return the kernels' view of a tensor."""
        return tensor.numpy() if self.device.type == "cpu" else gpu.as_kernel_array(tensor)
