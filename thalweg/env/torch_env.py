"""Environment of tensors: N episodes on one device, from which nothing is copied in a step.

The rules, rewards, costs and frames are those of `RiverVectorEnv` with `autoreset_mode="next_step"`: an environment
whose episode has ended resets in its next step, ignores the action of that step and returns no reward for it. Two
things differ: random numbers are those of `thalweg.env.device.step`, and tensors are reused. What `reset` and `step`
return is valid until the second step after; copy what is needed longer.
"""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from torch import Tensor

from thalweg.core.compute.device import resolve_device
from thalweg.core.seeds import MAX_SEED
from thalweg.env import snapshot
from thalweg.env.config import DEFAULT_CONFIG, REASON_NAMES, ConfigError, EnvConfig, integer_at_least
from thalweg.env.device.launcher import Launcher
from thalweg.env.device.memory import bytes_per_env, check_memory, free_bytes
from thalweg.env.device.observer import BUFFERS, TensorObserver
from thalweg.env.device.pushed_step import advance_pushed_all
from thalweg.env.device.step import advance_all, reset_arguments
from thalweg.env.device.unit_actions import tensor_unit_actions
from thalweg.env.forces.arrays import ForceState, empty_forces, force_numbers
from thalweg.env.forces.of_many import PREFIX, check_forces, write_winds
from thalweg.env.given import check_config, worlds_of
from thalweg.env.initial_poses import random_start
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.spaces import ActionError, action_space, observation_space, to_unit_actions
from thalweg.env.task.course_arrays import CourseArrays, pack_courses
from thalweg.env.task.critic_info import PROGRESS, critic_space, write_progress
from thalweg.env.task.priced.station import greatest_ways
from thalweg.env.task.progress_share import nearness
from thalweg.env.task.proprioception import no_last_step
from thalweg.env.task.rules import TASK_STATE, Outcome, State, empty_outcome, empty_state
from thalweg.env.task.termination import terminated_and_truncated
from thalweg.render.records.camera import Distortion
from thalweg.render.records.pinhole import CameraMatrices
from thalweg.world.record import World

Info = dict[str, Tensor]
ALLOCATED = (
    "_launcher", "_observer", "_segments", "_greatest_way", "_max_steps", "_courses", "_forces", "_arguments",
    "_actions", "_blowing",
)  # fmt: skip
"""Attributes that are, or view, the memory of one environment: a copy has its own."""
NUMPY_FLOATS = (torch.float16, torch.float32, torch.float64)
"""Types of floating-point tensors that NumPy has too."""


class TensorRiverEnv:
    """N environments over one or several worlds on one device; environment i flies in world i % len(worlds).

    `info` belongs to the action just taken: `cost` [N], `costs` [N, K] by kind (`cost_kinds`), `done_reason` [N],
    `progress` [N] (share of segments visited; of `Portage` see `thalweg.env.task.progress_share`) and `pose` [N, 4];
    `wind` and `velocity` are as in `RiverVectorEnv`. With `EnvConfig.critic_info`, `critic_obs` [N, C] float32 belongs
    to the state that the observation shows, see
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
        than that, `DeviceError`, `UnsafePoseError` for a world without a safe start, and for a boat
        `thalweg.env.vehicle.boat.FitError` for a world that it does not fit.
        """
        if isinstance(worlds, RiverList):
            raise ConfigError("environments of tensors do not change river: give worlds, not a list of rivers")
        check_config(config)
        self.worlds = worlds_of(worlds)
        self.num_envs, self.config = integer_at_least("num_envs", num_envs, 1), config
        self.limits = config.limits
        self.cost_kinds = config.cost_kinds
        """Names of the K kinds of `info["costs"]`."""
        self.device = torch.device(resolve_device(device))
        courses = pack_courses(self.worlds, config)
        self._connect(courses)
        for index, world in enumerate(self.worlds):  # a reset on the device cannot report that there is no safe start
            river = world.label
            random_start(courses, index, config, self.limits, np.random.default_rng(index), river)
        self.world_index = np.arange(self.num_envs, dtype=np.int64) % len(self.worlds)
        """[N] index of the world of each environment."""
        self._allocate(courses)
        self._started = False
        size = config.camera.height_px, config.camera.width_px
        self.single_action_space = action_space(config.action)
        self.single_observation_space = observation_space(config.observation, *size, config.task, config.vehicle)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        if config.critic_info:
            self.single_critic_space = critic_space(config.observation, config.task, config.vehicle)

    def _connect(self, courses: CourseArrays) -> None:
        """Create what launches and observes on the device; raises `ConfigError` if its memory does not suffice."""
        self._launcher = Launcher(self.device, self.num_envs)
        self._observer = TensorObserver(self.worlds, self.num_envs, self.config, self._launcher)
        shared = 0
        if self.device.type != "cpu" and self.config.channels:
            shared = self._observer.renderer.scratch_bytes
        check_memory(self.num_envs, bytes_per_env(courses, self.config, BUFFERS), shared, free_bytes(self.device))

    def _allocate(self, courses: CourseArrays) -> None:
        """Create the tensors of all episodes, and the kernels' views of them."""
        state = empty_state(self.world_index, courses)._asdict()
        outcome = empty_outcome(self.num_envs, len(self.cost_kinds))._asdict()
        counters: dict[str, np.ndarray] = {
            name: np.zeros(self.num_envs, np.int64) for name in ("seed", "episode", "look")
        }
        counters["ended"] = np.ones(self.num_envs, np.uint8)
        if "proprioception" in self.config.parts:
            counters["last_pose"], counters["last_action"] = no_last_step(self.num_envs)
        pushed = self.config.has_forces
        force = empty_forces(self.num_envs)._asdict() if pushed else {}
        force = {PREFIX + name: values for name, values in force.items()}
        tensor, array = self._launcher.tensor, self._launcher.array
        everything = {**state, **outcome, **counters, **force}
        self._tensors = {name: tensor(values) for name, values in everything.items()}
        """Everything that a step reads and changes."""
        kept = [name for name in state if self.config.task != "River" or name not in TASK_STATE]
        self._state_names = (*kept, *counters, *force)
        """Names of the tensors that the future depends on."""
        self._segments = tensor(courses.segments[self.world_index])
        self._greatest_way = tensor(greatest_ways(courses, self.world_index))
        self._max_steps = tensor(courses.max_steps[self.world_index])
        arrays = {name: array(values) for name, values in self._tensors.items()}
        self._courses = CourseArrays(*(array(tensor(values)) for values in courses))
        self._observer.attach(self._tensors, self._courses)
        looks = self._observer.looks
        reset = reset_arguments(self.config, arrays["seed"], arrays["episode"], arrays["look"], looks)
        self._forces = (force_numbers(self.config), ForceState(*(arrays[name] for name in force))) if pushed else None
        """Numbers and arrays of wind, current and inertia; None without them."""
        before, after = ((self._forces[0],), (self._forces[1],)) if self._forces else ((), ())
        self._arguments = (
            self._courses,
            self.limits,
            *before,
            reset,
            State(**{name: arrays[name] for name in state}),
            *after,
            Outcome(**{name: arrays[name] for name in outcome}),
            arrays["ended"],
        )
        """Arguments of `advance_all`, or with forces of `advance_pushed_all`, after the actions."""

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes for copies and pickles: without those of `ALLOCATED`, but with the tensors' values as
        arrays on the host."""
        kept = {name: value for name, value in self.__dict__.items() if name not in ALLOCATED}
        return kept | {"_tensors": {name: tensor.cpu().numpy().copy() for name, tensor in self._tensors.items()}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the attributes of `__getstate__`, and allocate the others anew on the same device."""
        self.__dict__.update(state)
        values, courses = state["_tensors"], pack_courses(self.worlds, self.config)
        self._connect(courses)
        self._allocate(courses)
        for name, tensor in self._tensors.items():
            tensor.copy_(torch.from_numpy(values[name]))

    @property
    def camera_matrices(self) -> CameraMatrices:
        """Matrices K [N, 3, 3], R [N, 3, 3] and t [N, 3] of the cameras in the current state, float64 tensors on the
        device, in OpenCV's convention; see `thalweg.render.records.pinhole`. Raises `gymnasium.error.ResetNeeded`
        before the first reset."""
        self._check_started("camera_matrices")
        return self._observer.camera_matrices()

    @property
    def camera_distortion(self) -> Distortion:
        """Distortion of the cameras in the current state, coefficients a tensor [N, D] float64 on the device; see
        `RiverVectorEnv.camera_distortion`."""
        return self._observer.camera_distortion()

    @property
    def unwrapped(self) -> "TensorRiverEnv":
        return self

    def reset(self, *, seed: int = 0) -> tuple[Any, Info]:
        """Start the first episodes of new seeds in all environments; returns observations and info."""
        first = integer_at_least("seed", seed, 0)
        if first + self.num_envs > MAX_SEED:
            raise ConfigError(
                f"seed must be at most {MAX_SEED - self.num_envs} for {self.num_envs} environments, not {first}"
            )
        self._tensors["seed"].copy_(torch.arange(first, first + self.num_envs))
        self._tensors["episode"].zero_()
        self._tensors["ended"].fill_(1)
        self._started = True
        self._advance(torch.zeros(self.num_envs, 4, dtype=torch.float64, device=self.device))
        return self.observe(), self._info()

    def step(self, actions: Tensor) -> tuple[Any, Tensor, Tensor, Tensor, Info]:
        """Take one action [N, 4] per environment; returns observations, rewards [N], terminated [N], truncated [N] and
        info, with the ends of `RiverVectorEnv.step`.

        Raises `ActionError` for another shape, type or device, and on the CPU for values out of range. A GPU clips
        those, and takes NaN as no move, because checking them would make the host wait. Raises
        `gymnasium.error.ResetNeeded` before the first reset.
        """
        unit_actions = self._unit_actions(actions)
        if not self._started:
            raise gymnasium.error.ResetNeeded("call reset() before step()")
        self._advance(unit_actions)
        reward = self._tensors["reward"].clone()
        terminated, truncated = terminated_and_truncated(self._tensors["reason"], self.limits)
        return self.observe(), reward, terminated, truncated, self._info()

    def get_state(self) -> dict[str, np.ndarray]:
        """Return everything that the future depends on, as arrays on the host."""
        return {name: self._tensors[name].cpu().numpy().copy() for name in self._state_names} | self._identity

    def set_state(self, state: Mapping[str, np.ndarray]) -> None:
        """Restore a state of `get_state`; raises `StateError` before anything changes if it does not fit. After a state
        from before the first reset, a reset is needed."""
        snapshot.check_arrays(state, self.get_state())
        snapshot.check_values(state, self._segments.cpu().numpy(), self._wrong(state))
        check_forces(state)
        for name in self._state_names:
            self._tensors[name].copy_(torch.from_numpy(np.array(state[name])))
        self._observer.turn()
        self._started = bool((np.asarray(state["episode"]) > 0).all())

    def observe(self) -> Any:
        """Return the observations of the current state, as `step` does; for use after `set_state`.

        Without it they are drawn again where `reset` or `step` has drawn them. Raises `gymnasium.error.ResetNeeded`
        before the first reset.
        """
        self._check_started("observe()")
        return self._observer.observe()

    def _check_started(self, what: str) -> None:
        """Raise `gymnasium.error.ResetNeeded` before the first reset."""
        if not self._started:
            raise gymnasium.error.ResetNeeded(f"call reset() before {what}")

    def close(self) -> None:
        """Do nothing: the environment holds no resources that must be released."""

    @cached_property
    def _identity(self) -> dict[str, np.ndarray]:
        return snapshot.env_identity(snapshot.fingerprints(self.worlds), self.config)

    @cached_property
    def _actions(self) -> Tensor:
        """Unit actions [N, 4] float64 of a step on a GPU."""
        return torch.zeros(self.num_envs, 4, dtype=torch.float64, device=self.device)

    @cached_property
    def _blowing(self) -> Tensor:
        """The wind [N, 3] float64; memory that `_wind` fills again and again."""
        return torch.zeros(self.num_envs, 3, dtype=torch.float64, device=self.device)

    def _wrong(self, state: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return, by name of the arrays that only environments of tensors have, which rows [N] bool have an impossible
        value."""
        seed, episode, look, ended = (np.asarray(state[name]) for name in ("seed", "episode", "look", "ended"))
        return {
            "seed": seed < 0,
            "episode": episode < (ended == 0),  # the first episode that runs is number 1
            "look": (look < 0) | (look >= self._observer.looks),
            "ended": ended > 1,
        }

    def _advance(self, unit_actions: Tensor) -> None:
        """Step or reset every environment by unit actions [N, 4] float64."""
        begun = self._observer.step(unit_actions)
        if self.device.type != "cpu":
            # Launches that are replayed read the same memory again.
            self._actions.copy_(unit_actions)
            unit_actions = self._actions
        array = self._launcher.array
        name, advance = ("advance", advance_all) if self._forces is None else ("advance_pushed", advance_pushed_all)
        name += "_boats" * bool(self.config.limits.is_boat)
        self._launcher.run(name, advance, lambda: (array(unit_actions), *self._arguments))
        self._observer.start(begun)
        self._observer.turn()

    def _unit_actions(self, actions: Tensor) -> Tensor:
        """Return actions as unit actions [N, 4] float64; raises `ActionError`."""
        if not isinstance(actions, Tensor):
            raise ActionError(f"actions are a tensor on {self.device}, not {type(actions).__name__}")
        if self.device.type == "cpu" and actions.device.type == "cpu":
            given = actions.detach()
            if given.is_floating_point() and given.dtype not in NUMPY_FLOATS:
                given = given.float()
            units = to_unit_actions(self.config.action, given, self.num_envs, self.config.fast_ratio)
            return torch.from_numpy(units)
        if actions.device != self.device:
            raise ActionError(f"actions are on {actions.device}; needed: {self.device}")
        return tensor_unit_actions(self.config.action, actions.detach(), self.num_envs, self.config.fast_ratio)

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
            "progress": self._progress(),
            "pose": tensors["pose"].clone(),
            **told,
        }

    def _wind(self) -> Tensor:
        """Return the wind [N, 3] in m/s that blows in the next step."""
        forces = self._forces
        assert forces is not None
        self._launcher.run("write_winds", write_winds, lambda: (*forces, self._launcher.array(self._blowing)))
        return self._blowing.clone()

    def _progress(self) -> Tensor:
        """Return the progress [N] float64, as `thalweg.env.task.progress_share.progress_of` does."""
        if self.config.task_record.portage:
            return nearness(self._tensors["way"], self._greatest_way)
        return self._tensors["visited_count"].double() / self._segments

    def _critic_obs(self) -> Tensor:
        """Return what critics may see beside the observations of the current state [N, C] float32."""
        tensors = self._tensors
        told = torch.empty(self.num_envs, *self.single_critic_space.shape, dtype=torch.float32, device=self.device)
        write_progress(
            told,
            (self._progress(), 1.0),
            (tensors["idle"].double(), self.config.max_idle_steps),
            (tensors["steps"].double(), self._max_steps),
        )
        if told.shape[1] > len(PROGRESS):
            told[:, len(PROGRESS) :] = self._observer.see()
        return told
