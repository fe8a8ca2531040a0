"""Recording of flights for data sets: images through a camera, moves, rewards, costs and poses."""

from collections.abc import Callable, Collection
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from thalweg.bench.evaluate.episodes import ALL_REASONS
from thalweg.core import versions
from thalweg.datasets.episode import LAYERS, About, Layer, RecordedEpisode
from thalweg.env import RiverVectorEnv
from thalweg.env.frame_renderer import FrameRenderer
from thalweg.env.spaces import to_unit_actions
from thalweg.env.task.proprioception import PROPRIOCEPTION
from thalweg.render import Camera
from thalweg.render.records.classes import CLASSES
from thalweg.viewer.errors import ViewerError
from thalweg.viewer.flight.cockpit import Cockpit
from thalweg.viewer.flight.flight import Flight

FIELDS = {"rgb": "rgb", "mask": "mask", "depth": "depth_m", "class": "class_id"}
"""Field of `thalweg.render.Frame` for each layer."""
VERSIONS = ("WORLD", "RENDER", "PROPS", "RULES", "FORCES", "TASKS", "VEHICLES", "PROPRIOCEPTION")
"""Names in `thalweg.core.versions` of what a recording depends on."""


class Observer:
    """Records the flights of an environment through a camera of its own, apart from those of page and policy."""

    def __init__(self, env: RiverVectorEnv, camera: Camera, layers: Collection[Layer] = LAYERS) -> None:
        self.env, self.camera = env, camera
        self.layers: tuple[Layer, ...] = tuple(layer for layer in LAYERS if layer in layers)
        self._frames = FrameRenderer(env.worlds, 1, replace(env.config, camera=camera))

    def about(self) -> About:
        """Return what all flights of the environment have in common."""
        camera = {**asdict(self.camera), "intrinsics": self.camera.intrinsics().tolist()}
        return About(
            fps=round(1.0 / self.env.config.step_s),
            camera=camera,
            proprioception=PROPRIOCEPTION,
            cost_kinds=tuple(self.env.cost_kinds),
            reasons=ALL_REASONS,
            classes=CLASSES,
            versions={name: getattr(versions, name) for name in VERSIONS},
            layers=self.layers,
        )

    def see(self, flight: Flight) -> dict[str, np.ndarray]:
        """Return colours [H, W, 3] and layers [H, W] of the current state by name, types as in `RecordedEpisode`."""
        names: Any = ["rgb", *(FIELDS[layer] for layer in self.layers)]
        frame: Any = self._frames.render_layers(flight.views(), names, flight.env.props())
        seen = {layer: getattr(frame, FIELDS[layer])[0] for layer in ("rgb", *self.layers)}
        if "mask" in seen:
            seen["mask"] = seen["mask"].astype(np.uint8) * 255
        return seen

    def record(
        self, cockpit: Cockpit, most_steps: int | None = None, on_step: Callable[[], Any] | None = None
    ) -> RecordedEpisode:
        """Fly the flight of a cockpit until it ends, its saved actions are used up, or `most_steps` are flown.

        `on_step` is called after each step. Raises `ViewerError` if there is no flight or no step, and the errors of
        the policy or pilot.
        """
        flight = cockpit.flight
        if flight is None:
            raise ViewerError("there is no flight: start one first")
        seen, felt = [self.see(flight)], [flight.env.observe()["proprioception"][0].copy()]
        goes_on = True
        while goes_on and flight.steps != most_steps:
            goes_on = cockpit.advance(1)
            if flight.steps >= len(seen):
                seen.append(self.see(flight))
                felt.append(flight.env.observe()["proprioception"][0].copy())
                if on_step is not None:
                    on_step()
        if not flight.steps:
            raise ViewerError("nothing has been flown: there is nothing to record")
        layers = {name: np.stack([each.pop(name) for each in seen]) for name in tuple(seen[0])}  # frees each in turn
        return _episode(flight, layers, np.stack(felt))


def _episode(flight: Flight, layers: dict[str, np.ndarray], felt: np.ndarray) -> RecordedEpisode:
    """Return the record of a flight, with layers [T + 1, H, W, ...] by name and proprioception `felt` [T + 1, P]."""
    config, actions = flight.env.config, np.stack(flight.actions)
    units = to_unit_actions(config.action, actions, len(actions), config.fast_ratio)
    return RecordedEpisode(
        rgb=layers["rgb"],
        mask=layers.get("mask"),
        depth_m=layers.get("depth"),
        class_id=layers.get("class"),
        proprioception=felt,
        poses=np.stack(flight.poses),
        times_s=np.array(flight.times_s),
        moves=units.astype(np.float32),
        options=actions.astype(np.int64) if config.action == "multidiscrete" else None,
        rewards=np.array(flight.rewards),
        costs=np.stack(flight.costs),
        terminated=flight.terminated,
        reason=flight.reason,
        pilots=tuple(flight.pilots),
        task=flight.options.task,
        options_of_flight={**asdict(flight.options), "world_seed": flight.world.seed},
    )
