"""How do thousands of episodes run on one device? An environment of tensors: nothing leaves the device in a step.

It has the rules, rewards, costs and frames of `RiverVectorEnv` with `autoreset_mode="next_step"`: an environment whose
episode has ended begins another in its next step, ignores that step's action and pays nothing for it. What differs is
where random numbers come from (`thalweg.env.device.episode`), and that tensors are used again: what `reset` and `step`
return is valid until the second step after. Whoever keeps it longer makes a copy.
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

from thalweg.core import gpu
from thalweg.core.device import resolve_device
from thalweg.env.actions import ActionError, action_space, units
from thalweg.env.config import DEFAULT_CONFIG, REASON_NAMES, DoneReason, EnvConfig, whole
from thalweg.env.device.episode import advance_rows, begins_of
from thalweg.env.device.memory import bytes_each, check_room, free_bytes
from thalweg.env.initial_poses import random_start
from thalweg.env.observation import observation_space
from thalweg.env.snapshot import StateError
from thalweg.env.task.course_arrays import Courses, config_fingerprint, fingerprint, pack
from thalweg.env.task.rules import Outcome, State, empty_outcome, empty_state
from thalweg.env.views import lit
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.world.record import World

LOOKS = 4096
"""Looks that are drawn beforehand, of which each episode has one: see `Randomisation`."""
TURNS = 2
"""Sets of tensors that are written by turns."""

Info = dict[str, Tensor]


class TensorRiverEnv:
    """N environments over one or several worlds on one device; environment i flies in world i % len(worlds).

    `info` belongs to the action just taken: `cost` [N], `costs` [N, 2] (tight, loose), `done_reason` [N], `progress`
    [N] (share of segments visited), `pose` [N, 4]. Environment i is seeded with seed + i, so that its episodes do not
    depend on how many others there are. Rewards, costs and poses are float64.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.NEXT_STEP, "render_modes": []}  # noqa: RUF012
    done_reasons = REASON_NAMES
    """What the codes of `info["done_reason"]` are called."""

    def __init__(
        self,
        worlds: World | Sequence[World],
        num_envs: int = 1,
        config: EnvConfig = DEFAULT_CONFIG,
        *,
        device: str = "auto",
    ) -> None:
        """Raises `ConfigError`, also for more environments than the device has memory for, `RenderError` for more
        worlds than that, `DeviceError`, and `UnsafePoseError` for a world without a safe start."""
        self.worlds = (worlds,) if isinstance(worlds, World) else tuple(worlds)
        self.num_envs, self.config = whole("num_envs", num_envs, 1), config
        self.device = torch.device(resolve_device(device))
        courses = pack(self.worlds, config)
        beside = 0
        if self.device.type != "cpu" and config.observation != "none":
            beside = self._renderer.scratch_bytes
        check_room(self.num_envs, bytes_each(courses, config, TURNS), beside, free_bytes(self.device))
        for world in range(len(self.worlds)):
            random_start(courses, world, config, config.limits, np.random.default_rng(world))
        randomisation = config.randomisation
        self._suns = max(randomisation.suns, 1) if randomisation else 1
        values, suns = look_values(None, 1), np.zeros(1, np.int64)
        if randomisation is not None:
            generator = np.random.default_rng(LOOKS)
            drawn = [randomisation.draw(generator) for _ in range(LOOKS)]
            values, suns = np.array([look for look, _ in drawn]), np.array([sun for _, sun in drawn])
        rows = look_rows(values, config.camera)

        self.world_index = place = np.arange(self.num_envs, dtype=np.int64) % len(self.worlds)
        """[N] the world of each environment."""
        state, outcome = empty_state(place, courses)._asdict(), empty_outcome(self.num_envs)._asdict()
        own: dict[str, np.ndarray] = {name: np.zeros(self.num_envs, np.int64) for name in ("seed", "episode", "look")}
        own["ended"] = np.ones(self.num_envs, np.uint8)
        self._held = {name: self._tensor(values) for name, values in {**state, **outcome, **own}.items()}
        """All that a step reads and changes."""
        self._kept = (*state, *own)
        """Names of what the future depends on."""
        self._rows, self._sun_of, self._segments = (self._tensor(v) for v in (rows, suns, courses.segments[place]))
        seen = {name: self._array(tensor) for name, tensor in self._held.items()}
        self._courses = Courses(*(self._array(self._tensor(values)) for values in courses))
        begins = begins_of(config, seen["seed"], seen["episode"], seen["look"], len(rows))
        self._arguments = (
            self._courses,
            config.limits,
            begins,
            State(**{name: seen[name] for name in state}),
            Outcome(**{name: seen[name] for name in outcome}),
            seen["ended"],
        )
        """Of the rules, after the actions."""
        self._turn, self._begun = 0, False

        size = config.camera.height_px, config.camera.width_px
        self.single_action_space = action_space(config.action)
        self.single_observation_space = observation_space(config.observation, *size)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    @property
    def unwrapped(self) -> "TensorRiverEnv":
        return self

    def reset(self, *, seed: int = 0) -> tuple[Any, Info]:
        """Begin new episodes in all environments, the first of their seeds; returns observations and info."""
        first = whole("seed", seed, 0)
        self._held["seed"].copy_(torch.arange(first, first + self.num_envs))
        self._held["episode"].zero_()
        self._held["ended"].fill_(1)
        self._begun = True
        self._advance(torch.zeros(self.num_envs, 4, dtype=torch.float64, device=self.device))
        return self._observed(), self._info()

    def step(self, actions: Tensor) -> tuple[Any, Tensor, Tensor, Tensor, Info]:
        """One action [N, 4] in each environment: observations, rewards [N], terminated [N], truncated [N], info.

        Raises `ActionError` for another shape, type or device, and on the CPU for values out of range, which a GPU
        clips instead, for it would have to wait; `gymnasium.error.ResetNeeded` before the first reset.
        """
        shares = self._shares(actions)
        if not self._begun:
            raise gymnasium.error.ResetNeeded("call reset() before step()")
        self._advance(shares)
        reason = self._held["reason"]
        truncated = reason == int(DoneReason.MAX_STEP_REACHED)
        return self._observed(), self._held["reward"].clone(), (reason >= 0) & ~truncated, truncated, self._info()

    def get_state(self) -> dict[str, np.ndarray]:
        """Everything that the future depends on, as arrays of the host."""
        return {name: self._held[name].cpu().numpy().copy() for name in self._kept} | self._fixed

    def set_state(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from a state of `get_state`; raises `StateError` before anything changes when it does not fit."""
        own = self.get_state()
        if set(state) != set(own):
            raise StateError(f"the state has the arrays {sorted(state)}; needed: {sorted(own)}")
        for name, value in own.items():
            given = np.asarray(state[name])
            if given.shape != value.shape or given.dtype != value.dtype:
                raise StateError(
                    f"{name} is {given.dtype} {given.shape}; this environment has {value.dtype} {value.shape}"
                )
            if name in (*self._fixed, "world") and not np.array_equal(given, value):
                raise StateError(f"the state belongs to other worlds or another config ({name} differs)")
        for name in self._kept:
            self._held[name].copy_(torch.from_numpy(np.array(state[name])))
        self._begun = True

    def observe(self) -> Any:
        """The observations of the present state, as `step` returns them; for use after `set_state`."""
        return self._observed()

    def close(self) -> None:
        """Nothing is open."""

    @cached_property
    def _fixed(self) -> dict[str, np.ndarray]:
        """What a state must have in common with this environment to be its own."""
        return {
            "fingerprint": np.array([fingerprint(world) for world in self.worlds], dtype=np.uint64),
            "config": np.array([config_fingerprint(self.config)], dtype=np.uint64),
        }

    @cached_property
    def _frames(self) -> list[Tensor]:
        """[N, H, W, 4] uint8 for each turn."""
        camera = self.config.camera
        shape = self.num_envs, camera.height_px, camera.width_px, 4
        return [torch.zeros(shape, dtype=torch.uint8, device=self.device) for _ in range(TURNS)]

    @cached_property
    def _renderer(self) -> Any:
        """Draws on this device."""
        from thalweg.render import Renderer

        worlds = lit(self.worlds, self.config.randomisation)
        return Renderer(worlds, self.config.camera, self.config.quality, device=str(self.device))

    def _advance(self, shares: Tensor) -> None:
        """A step of all, or a begin, from shares of a step [N, 4] float64."""
        arguments = self._array(shares), *self._arguments
        if self.device.type == "cpu":
            advance_rows(*arguments)
            return
        from thalweg.env.device import gpu_step as rules

        gpu.launch(rules.advance, -(-self.num_envs // rules.THREADS), rules.THREADS, self.device, *arguments,
                   fastmath=False)  # fmt: skip

    def _shares(self, actions: Tensor) -> Tensor:
        """Actions as shares of a step [N, 4] float64 in -1..1."""
        if not isinstance(actions, Tensor):
            raise ActionError(f"actions are a tensor on {self.device}, not {type(actions).__name__}")
        if self.device.type == "cpu" and actions.device.type == "cpu":
            return torch.from_numpy(units(self.config.action, actions.detach().numpy(), self.num_envs))
        if actions.shape != (self.num_envs, 4) or actions.device != self.device:
            raise ActionError(
                f"actions have shape {tuple(actions.shape)} on {actions.device};"
                f" needed: ({self.num_envs}, 4) on {self.device}"
            )
        whole_numbers = not (actions.is_floating_point() or actions.is_complex() or actions.dtype == torch.bool)
        if self.config.action == "multidiscrete" and not whole_numbers:
            raise ActionError(f"actions have type {actions.dtype}; multidiscrete actions are integers 0, 1 or 2")
        shares = actions.detach().double()
        return (1.0 - shares if self.config.action == "multidiscrete" else shares).clamp(-1.0, 1.0).contiguous()

    def _observed(self) -> Any:
        """What is seen now, in the tensors whose turn it is."""
        kind = self.config.observation
        if kind == "none":
            return self._held["pose"].clone()
        self._turn = (self._turn + 1) % TURNS
        frames = self._frames[self._turn]
        held, look = self._held, self._held["look"]
        views = held["world"] * self._suns + self._sun_of[look], held["pose"], held["time_s"], self._rows[look]
        self._renderer.render_tensors(views, frames)
        parts = {"rgb": frames[..., :3], "mask": frames[..., 3:]}
        return frames if kind == "rgb+mask" else parts if kind == "dict" else parts[kind]

    def _info(self) -> Info:
        held = self._held
        return {
            "cost": held["costs"].sum(1),
            "costs": held["costs"].clone(),
            "done_reason": held["reason"].clone(),
            "progress": held["visited_count"] / self._segments,
            "pose": held["pose"].clone(),
        }

    def _tensor(self, values: np.ndarray) -> Tensor:
        """A copy of an array on the device."""
        return torch.from_numpy(np.array(values)).to(self.device)

    def _array(self, tensor: Tensor) -> Any:
        """What kernels see of a tensor."""
        return tensor.numpy() if self.device.type == "cpu" else gpu.as_kernel_array(tensor)
