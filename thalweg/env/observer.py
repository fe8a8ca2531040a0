"""Observations of a vector environment: what N episodes see of their rivers and feel of themselves."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from thalweg.env.config import EnvConfig
from thalweg.env.frame_renderer import FrameRenderer, Views
from thalweg.env.spaces import frames_to_observations
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.critic_info import PROGRESS, critic_features, write_progress
from thalweg.env.task.ideal_eye import see_all
from thalweg.env.task.priced.eye import features_of, see_all_in_task
from thalweg.env.task.priced.props import props_in
from thalweg.env.task.progress_share import progress_of
from thalweg.env.task.proprioception import PROPRIOCEPTION, feel_all, no_last_step
from thalweg.env.task.rules import State
from thalweg.env.vehicle.boat_eye import see_boats

FIELDS = {"rgb": "rgb", "mask": "mask", "depth": "depth_m", "class": "class_id"}
"""Field of a `thalweg.render.Frame` that holds a part of an observation."""
REMEMBERED = {"last_pose": "pose", "last_action": "action"}
"""Field of a `LastStep` by its name in a snapshot."""


class Observer:
    """Makes the observations of N environments, and remembers of their last steps what these depend on.

    What nobody asked for is neither drawn nor remembered.
    """

    def __init__(self, config: EnvConfig, frames: FrameRenderer, num_envs: int, *, keeps_colours: bool = False) -> None:
        """`keeps_colours`: keep the colours that are drawn for observations, for `colours`."""
        self.config, self.frames, self.num_envs = config, frames, num_envs
        self._limits = config.limits
        self.last = no_last_step(num_envs) if "proprioception" in config.parts else None
        """What is remembered of the last steps; None if proprioception is not observed."""
        self._keeps_colours = keeps_colours
        self._colours: np.ndarray | None = None
        """[N, H, W, 3] colours of the current state, if they are known."""

    def start(self, row: int, pose: np.ndarray) -> None:
        """Forget the last step of an environment that begins an episode at a pose [4]."""
        if self.last is not None:
            self.last.pose[row], self.last.action[row] = pose, 0.0

    def step(self, poses: np.ndarray, unit_actions: np.ndarray) -> None:
        """Remember the poses [N, 4] before a step, and its unit actions [N, 4]."""
        if self.last is not None:
            self.last.pose[:], self.last.action[:] = poses, unit_actions

    def state(self) -> dict[str, np.ndarray]:
        """Return copies of what is remembered, as `get_state` has it; empty if nothing is."""
        return {} if self.last is None else {key: getattr(self.last, of).copy() for key, of in REMEMBERED.items()}

    def load_state(self, state: Mapping[str, np.ndarray]) -> None:
        """Restore what a checked state of an environment has of `state`."""
        self._colours = None
        if self.last is not None:
            for key, of in REMEMBERED.items():
                getattr(self.last, of)[:] = state[key]

    def views(self, courses: CourseArrays, state: State, rows: np.ndarray | slice = slice(None)) -> Views:
        """Return copies of what the environments `rows` see and feel in a state; their poses alone where nothing is
        observed."""
        if self.config.observation == "none":
            others: list[Any] = [None] * (len(Views._fields) - 1)
            return Views(state.pose[rows].copy(), *others)
        views = self.frames.views(state, rows)
        if self.last is None:
            return views
        felt = np.empty((len(views.pose), len(PROPRIOCEPTION)), np.float32)
        remembered = self.last.pose[rows], self.last.action[rows]
        feel_all(courses, self.config.step_s, views.world, views.pose, views.segment, *remembered, felt)
        return views._replace(proprioception=felt)

    def observe(self, courses: CourseArrays, views: Views) -> Any:
        """Return the observations [M, ...] of M views, of which the first N are those of the current state."""
        self._colours = None
        kind = self.config.observation
        if kind == "none":
            return views.pose
        if kind == "privileged":
            return self.see(courses, views)
        if kind == "mask":
            return self.frames.render_masks(views, self.props(courses, views))
        if isinstance(kind, str):
            return frames_to_observations(kind, self._frames(courses, views))
        parts = self._drawn_parts(courses, views)
        if "privileged" in kind:
            parts["privileged"] = self.see(courses, views)
        if views.proprioception is not None:
            parts["proprioception"] = views.proprioception
        return {part: parts[part] for part in kind}

    def see(self, courses: CourseArrays, views: Views) -> np.ndarray:
        """Return what the ideal eye sees [M, F] float32; F is the number of `priced.eye.features_of` the task and the
        vehicle."""
        features = len(features_of(self.config.task, self.config.vehicle))
        seen = np.empty((len(views.pose), features), np.float32)
        at, limits = (views.world, views.pose, views.segment, views.travel), self.config.limits
        if self.config.task == "River":
            see_all(courses, limits.max_height, *at, seen)
        else:
            see_all_in_task(courses, limits, *at, views.steps, views.scene, views.station, seen)
        if limits.is_boat:
            see_boats(courses, limits, views.world, views.pose, seen)
        return seen

    def props(self, courses: CourseArrays, views: Views) -> np.ndarray | None:
        """Return the objects [M, P, 6] of each view, those of the task if it holds none; None in a task without any."""
        return self.props_about(courses, views) if views.props is None else views.props

    def props_about(self, courses: CourseArrays, at: Views | State) -> np.ndarray | None:
        """Return the objects [M, P, 6] of the task about each vehicle of views or of a state; None in a task without
        any."""
        return props_in(courses, self.config, self._limits, (at.world, at.pose, at.steps, at.scene, at.station))

    def colours(self, courses: CourseArrays, state: State) -> np.ndarray:
        """Return the colours [N, H, W, 3] uint8 of a state, without drawing them again if the observations had them."""
        if self._colours is None:
            views = self.frames.views(state)
            self._colours = self.frames.render(views, self.props(courses, views))[..., :3].copy()
        return self._colours

    def forget_colours(self) -> None:
        """Draw colours again when they are asked for next: those that were drawn are not of the current state."""
        self._colours = None

    def critic_obs(self, courses: CourseArrays, state: State) -> np.ndarray:
        """Return what critics may see beside the observations of a state [N, C] float32."""
        count = len(critic_features(self.config.observation, self.config.task, self.config.vehicle))
        told = np.empty((self.num_envs, count), np.float32)
        write_progress(
            told,
            (progress_of(self.config, courses, state), 1.0),
            (state.idle, self.config.max_idle_steps),
            (state.steps, courses.max_steps[state.world]),
        )
        if count > len(PROGRESS):
            told[:, len(PROGRESS) :] = self.see(courses, self.frames.views(state))
        return told

    def _drawn_parts(self, courses: CourseArrays, views: Views) -> dict[str, Any]:
        """Return those parts of observations [M, H, W, ...] that are drawn."""
        parts = self.config.parts
        if self.config.draws_layers:
            wanted = {part: field for part, field in FIELDS.items() if part in parts}
            frame: Any = self.frames.render_layers(
                views,
                tuple(wanted.values()),  # pyright: ignore[reportArgumentType]
                self.props(courses, views),
            )
            drawn = {part: getattr(frame, field) for part, field in wanted.items()}
            if "mask" in drawn:
                drawn["mask"] = drawn["mask"] * np.uint8(255)
            self._keep(drawn.get("rgb"))
            return {part: layer if part == "rgb" else layer[..., None] for part, layer in drawn.items()}
        if "rgb" in parts:
            return frames_to_observations("dict", self._frames(courses, views))
        return {"mask": self.frames.render_masks(views, self.props(courses, views))} if "mask" in parts else {}

    def _frames(self, courses: CourseArrays, views: Views) -> np.ndarray:
        """Return frames [M, H, W, 4] of views."""
        frames = self.frames.render(views, self.props(courses, views))
        self._keep(frames)
        return frames

    def _keep(self, frames: np.ndarray | None) -> None:
        """Keep the colours of frames [M, H, W, 3 or 4] whose first N are those of the current state."""
        if frames is not None and self._keeps_colours:
            self._colours = frames[: self.num_envs, ..., :3].copy()
