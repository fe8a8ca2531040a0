"""Recording of flights for data sets: images through a camera, moves, rewards, costs and poses."""

from collections.abc import Collection, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from thalweg.bench.evaluate.episodes import ALL_REASONS
from thalweg.core import versions
from thalweg.datasets.episode import FIELD_OF_LAYER, LAYERS, About, Layer
from thalweg.datasets.steps import FlightWriter, Sight, Step
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.frame_renderer import FrameRenderer
from thalweg.env.spaces import BRANCHES, FORWARD, to_unit_actions
from thalweg.env.task.proprioception import PROPRIOCEPTION
from thalweg.render import Camera
from thalweg.render.records.appearance import PARAMETERS
from thalweg.render.records.classes import CLASSES
from thalweg.viewer.errors import ViewerError
from thalweg.viewer.flight.cockpit import Cockpit
from thalweg.viewer.flight.flight import Flight

FIELDS = {"rgb": "rgb", **FIELD_OF_LAYER}
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
        camera = {**self.camera.as_data(), "intrinsics": self.camera.intrinsics().tolist()}
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

    def options_of(self, flight: Flight) -> dict[str, Any]:
        """Return the options of a flight as plain data, with the seed of its river and the optics of its frames.

        Those are under `camera`, since looks that are drawn change them: `pitch_deg`, `fov_deg`, `intrinsics` [3][3] in
        OpenCV's convention, and through a lens the coefficients of `distortion`.
        """
        look = dict(zip(PARAMETERS, flight.views().look[0].tolist(), strict=True))
        pitch_deg, fov_deg = look["pitch_deg"], look["fov_deg"]
        optics = {
            "pitch_deg": self.camera.pitch_deg + pitch_deg,
            "fov_deg": self.camera.fov_deg + fov_deg,
            "intrinsics": self.camera.camera_matrices(np.zeros((1, 4)), pitch_deg, fov_deg).K[0].tolist(),
        }
        if self.camera.lens is not None:
            optics["distortion"] = self.camera.distortion(fov_deg).coefficients.tolist()
        return {**asdict(flight.options), "world_seed": flight.world.seed, "camera": optics}

    def see(self, flight: Flight) -> Sight:
        """Return the colours, the layers and what is measured in the current state."""
        names: Any = ["rgb", *(FIELDS[layer] for layer in self.layers)]
        frame: Any = self._frames.render_layers(flight.views(), names, flight.env.props())
        images = {layer: getattr(frame, FIELDS[layer])[0] for layer in ("rgb", *self.layers)}
        if "mask" in images:
            images["mask"] = images["mask"].astype(np.uint8) * 255
        felt = flight.env.observe()["proprioception"][0].copy()
        return Sight(images, felt, flight.poses[-1], flight.times_s[-1])

    def record(
        self,
        cockpit: Cockpit,
        writer: FlightWriter,
        most_steps: int | None = None,
        pilots: Sequence[str] | None = None,
    ) -> int:
        """Fly the flight of a cockpit, write each step, and return the number of steps.

        The flight goes on until it ends, its saved actions are used up, or `most_steps` are flown. `pilots`: who flew
        each step; by default who flies. Raises `ViewerError` if there is no flight or no step, and the errors of the
        policy or pilot and of the writer.
        """
        flight = cockpit.flight
        if flight is None:
            raise ViewerError("there is no flight: start one first")
        writer.see(self.see(flight))
        goes_on, written = True, 0
        while goes_on and flight.steps != most_steps:
            goes_on = cockpit.advance(1)
            if flight.steps > written:
                writer.step(_last_step(flight, pilots), self.see(flight))
                written += 1
        if not flight.steps:
            raise ViewerError("nothing has been flown: there is nothing to record")
        writer.end(flight.terminated, flight.reason)
        return flight.steps


def move_of(config: EnvConfig, action: np.ndarray) -> np.ndarray:
    """Return the move [4] float32 of an action [4] of the space of `config`, in plain steps: up, turn left, forward,
    left, see `thalweg.datasets.episode.ACTION_NAMES`. A branch or an option that does nothing is 0."""
    move = to_unit_actions(config.action, action[None], 1, config.fast_ratio)[0]
    if config.fast_ratio:
        move[FORWARD] = max(move[FORWARD], -move[FORWARD] * config.fast_ratio)
    elif not config.allow_backward:
        move[FORWARD] = max(move[FORWARD], 0.0)
    if config.vehicle == "asv":
        move[BRANCHES.index("vertical")] = 0.0
    return move.astype(np.float32)


def _last_step(flight: Flight, pilots: Sequence[str] | None) -> Step:
    """Return the last step of a flight; `pilots` as in `Observer.record`."""
    config, action = flight.env.config, flight.actions[-1]
    move = move_of(config, action)
    option = action.astype(np.int64) if config.action == "multidiscrete" else None
    pilot = flight.pilots[-1] if pilots is None else pilots[flight.steps - 1]
    return Step(move, option, flight.rewards[-1], flight.costs[-1], pilot)
