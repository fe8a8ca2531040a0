"""Observations of environments of tensors: those of `thalweg.env.observer`, made on a device without copies."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor

from thalweg.env.config import EnvConfig
from thalweg.env.device.launcher import Launcher
from thalweg.env.forces.of_many import PREFIX
from thalweg.env.frame_renderer import lights_per_world, relit_worlds
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.ideal_eye import see_all
from thalweg.env.task.priced.eye import features_of, see_all_in_task
from thalweg.env.task.priced.props import all_props
from thalweg.env.task.proprioception import PROPRIOCEPTION, feel_all
from thalweg.env.vehicle.boat_eye import see_boats
from thalweg.render.records import pinhole
from thalweg.render.records.appearance import HALF_H, HALF_W, PARAMETERS, PITCH, look_rows, look_values
from thalweg.render.records.breeze import ruffle
from thalweg.render.records.camera import Distortion
from thalweg.render.records.pinhole import CameraMatrices
from thalweg.render.records.props import PROP_COLUMNS
from thalweg.world.record import World

LOOKS = 4096
"""Number of looks drawn in advance, from which each episode takes one; see `Randomisation`."""
BUFFERS = 2
"""Number of frame buffers, which are written alternately."""


class TensorObserver:
    """Makes the observations of N environments of tensors."""

    def __init__(self, worlds: Sequence[World], num_envs: int, config: EnvConfig, launcher: Launcher) -> None:
        self.worlds, self.num_envs, self.config, self._launcher = worlds, num_envs, config, launcher
        self._lights = lights_per_world(config.randomisation)
        rows, lights, self._look_fovs_deg = _draw_looks(config)
        self._look_rows, self._look_lights = launcher.tensor(rows), launcher.tensor(lights)
        """[LOOKS, P] the looks as the renderer takes them, and [LOOKS] the light of each; one of each without
        randomisation. `_look_fovs_deg`: [LOOKS] on the host, what each adds to the field of view."""
        self.looks = len(self._look_rows)
        self._buffer = 0

    def attach(self, tensors: Mapping[str, Tensor], courses: CourseArrays) -> None:
        """Set the tensors of the environments' state, whose values are observed, and the courses on the device.

        With proprioception, `last_pose` and `last_action` [N, 4] float64 are among them, see
        `thalweg.env.task.proprioception.LastStep`.
        """
        self._tensors, self._courses = tensors, courses

    def step(self, unit_actions: Tensor) -> Tensor | None:
        """Remember the poses and unit actions [N, 4] of a step that is about to be taken; returns for `start` which
        environments [N] it only resets, or None if nothing is remembered."""
        if "last_pose" not in self._tensors:
            return None
        self._tensors["last_pose"].copy_(self._tensors["pose"])
        self._tensors["last_action"].copy_(unit_actions)
        return self._tensors["ended"].bool()

    def start(self, begun: Tensor | None) -> None:
        """Forget the last step of the environments `begun` [N], whose episodes have begun anew."""
        if begun is not None:
            last = self._tensors["last_pose"]
            last.copy_(torch.where(begun[:, None], self._tensors["pose"], last))
            self._tensors["last_action"].masked_fill_(begun[:, None], 0.0)

    def turn(self) -> None:
        """Draw from now on in the next buffer: the state has changed, and what was drawn of the last one is valid."""
        self._buffer = (self._buffer + 1) % BUFFERS

    def observe(self) -> Any:
        """Return the observations of the current state, drawn in the buffer whose turn it is."""
        kind = self.config.observation
        if kind == "none":
            return self._tensors["pose"].clone()
        if kind == "privileged":
            return self.see()
        drawn = self._drawn() if self.config.channels else {}
        if kind == "rgb+mask":
            return drawn["frames"]
        if kind == "dict":
            kind = ("rgb", "mask")
        if isinstance(kind, str):
            return drawn[kind]
        makers = {"privileged": self.see, "proprioception": self._feel}
        return {part: makers[part]() if part in makers else drawn[part] for part in kind}

    def see(self) -> Tensor:
        """Return what the ideal eye sees [N, F] float32; F is the number of `priced.eye.features_of` the task and the
        vehicle."""
        names, limits = ("world", "pose", "segment", "travel"), self.config.limits
        if self.config.task == "River":
            self._launcher.run(
                "see",
                see_all,
                lambda: (self._courses, limits.max_height, *self._arrays(*names), self._array(self._seen)),
            )
        else:
            names = *names, "steps", "scene", "station"
            self._launcher.run(
                "see_in_task",
                see_all_in_task,
                lambda: (self._courses, limits, *self._arrays(*names), self._array(self._seen)),
            )
        if limits.is_boat:
            self._launcher.run(
                "see_boats",
                see_boats,
                lambda: (self._courses, limits, *self._arrays("world", "pose"), self._array(self._seen)),
            )
        return self._seen.clone()

    def camera_matrices(self) -> CameraMatrices:
        """Return the matrices of the cameras in the current state, each with the lens of its look."""
        camera, lens = self.config.camera, self._look_rows[self._tensors["look"]].double()
        half_width, half_height = lens[:, HALF_W], lens[:, HALF_H]
        matrix = pinhole.intrinsics(torch, half_width, half_height, camera.height_px, camera.width_px)
        matrix = camera.with_lens(matrix)
        return CameraMatrices(matrix, *pinhole.extrinsics(torch, self._tensors["pose"], lens[:, PITCH]))

    def camera_distortion(self) -> Distortion:
        """Return the distortion of the cameras in the current state, each with the lens of its look."""
        added = self._look_fovs_deg[self._tensors["look"].cpu().numpy()]
        model, coefficients = self.config.camera.distortion(added)
        return Distortion(model, torch.as_tensor(coefficients, device=self._launcher.device))

    @cached_property
    def renderer(self) -> Any:
        """Renderer on the device."""
        from thalweg.render import Renderer

        worlds = relit_worlds(self.worlds, self.config.randomisation)
        return Renderer(worlds, self.config.camera, self.config.quality, device=str(self._launcher.device))

    def _feel(self) -> Tensor:
        """Return the proprioception [N, PROPRIOCEPTION] float32."""
        names = "world", "pose", "segment", "last_pose", "last_action"
        self._launcher.run(
            "feel",
            feel_all,
            lambda: (self._courses, float(self.config.step_s), *self._arrays(*names), self._array(self._felt)),
        )
        return self._felt.clone()

    def _drawn(self) -> dict[str, Tensor]:
        """Return the frames of the current state, and the parts of observations that are drawn."""
        frames, layers = self._frames[self._buffer], self._layers[self._buffer] if self.config.draws_layers else ()
        tensors, look = self._tensors, self._tensors["look"]
        lit_world = tensors["world"] * self._lights + self._look_lights[look]
        looks = self._look_rows[look]
        if self.config.wind is not None:
            speed, towards, _ = tensors[PREFIX + "mean_wind"].T
            ruffle(looks, speed * towards.cos(), speed * towards.sin())
        views = lit_world, tensors["pose"], tensors["time_s"], looks
        options = ({"layers": layers} if layers else {}) | self._props_to_draw()
        self.renderer.render_tensors(views, frames, **options)
        parts = {"frames": frames, "rgb": frames[..., :3], "mask": frames[..., -1:]}
        return parts | dict(zip(("depth", "class"), (layer[..., None] for layer in layers), strict=False))

    def _props_to_draw(self) -> dict[str, Tensor]:
        """Return the objects [N, P, 6] of the task about each vehicle for the renderer, if it has any."""
        if self._props is None:
            return {}
        props, names = self._props, ("world", "pose", "steps", "scene", "station")
        self._launcher.run(
            "props",
            all_props,
            lambda: (self._courses, self.config.limits, *self._arrays(*names), self._array(props)),
        )
        return {"props": props}

    @cached_property
    def _props(self) -> Tensor | None:
        """Objects [N, P, 6] float32 of the task, see `thalweg.render.records.props`; None without any."""
        most = self.config.task_record.props
        return self._zeros(most, PROP_COLUMNS, dtype=torch.float32) if most else None

    def _arrays(self, *names: str) -> list[Any]:
        return [self._array(self._tensors[name]) for name in names]

    def _array(self, tensor: Tensor) -> Any:
        return self._launcher.array(tensor)

    def _zeros(self, *shape: int, dtype: torch.dtype) -> Tensor:
        """Return zeros [N, ...] on the device."""
        return torch.zeros(self.num_envs, *shape, dtype=dtype, device=self._launcher.device)

    @cached_property
    def _frames(self) -> list[Tensor]:
        """Frame buffers [N, H, W, 4] uint8, or [N, H, W, 1] of masks."""
        camera = self.config.camera
        shape = camera.height_px, camera.width_px, self.config.channels
        return [self._zeros(*shape, dtype=torch.uint8) for _ in range(BUFFERS)]

    @cached_property
    def _layers(self) -> list[tuple[Tensor, Tensor]]:
        """Buffers of depths [N, H, W] float32 and classes [N, H, W] uint8."""
        shape = self.config.camera.height_px, self.config.camera.width_px
        kinds = torch.float32, torch.uint8
        return [tuple(self._zeros(*shape, dtype=kind) for kind in kinds) for _ in range(BUFFERS)]  # pyright: ignore

    @cached_property
    def _seen(self) -> Tensor:
        """What the ideal eye sees [N, F] float32; memory that `see` fills again and again."""
        return self._zeros(len(features_of(self.config.task, self.config.vehicle)), dtype=torch.float32)

    @cached_property
    def _felt(self) -> Tensor:
        """The proprioception [N, PROPRIOCEPTION] float32; memory that `_feel` fills again and again."""
        return self._zeros(len(PROPRIOCEPTION), dtype=torch.float32)


def _draw_looks(config: EnvConfig) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the looks [LOOKS, P] of the randomisation, the light [LOOKS] of each, and what each adds to the field of
    view [LOOKS] in degrees; one of each without it."""
    values, lights = look_values(None, 1), np.zeros(1, np.int64)
    if config.randomisation is not None:
        generator = np.random.default_rng(LOOKS)
        drawn = [config.randomisation.draw(generator) for _ in range(LOOKS)]
        values, lights = np.array([look for look, _ in drawn]), np.array([light for _, light in drawn])
    return look_rows(values, config.camera), lights, values[:, PARAMETERS.index("fov_deg")]
