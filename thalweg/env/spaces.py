"""Action and observation spaces, the validation of actions, and the conversion of frames to observations."""

from typing import Any

import gymnasium
import numpy as np

from thalweg.env.task.ideal_eye import features_of

BRANCHES = ("vertical", "yaw", "longitudinal", "lateral")
"""Branches of an action. Options 0, 1, 2: up, none, down; left, none, right; forward, none, backward; left, none,
right."""
CHANNELS = {"rgb+mask": 4, "rgb": 3, "mask": 1}
"""Channels of the observations that are one image."""


class ActionError(ValueError):
    """An action of the wrong shape or type, or out of range."""


def action_space(kind: str) -> gymnasium.spaces.Space:
    """Return the action space of one environment; `kind` as in `EnvConfig.action`."""
    if kind == "multidiscrete":
        return gymnasium.spaces.MultiDiscrete([3, 3, 3, 3])
    return gymnasium.spaces.Box(-1.0, 1.0, (4,), dtype=np.float32)


def batch_of_one(action: object) -> np.ndarray:
    """Return the action [4] of a single environment as a batch [1, 4]; raises `ActionError` for another shape."""
    try:
        given = np.asarray(action)
    except ValueError:  # nested lists of different lengths
        given = np.empty(0)
    if given.shape != (4,):
        found = repr(action) if given.size <= 8 else f"an array of shape {given.shape}"
        raise ActionError(f"an action is four numbers, one each for {', '.join(BRANCHES)}, not {found}")
    return given[None]


def to_unit_actions(kind: str, actions: object, count: int) -> np.ndarray:
    """Return actions [N, 4] of the space as unit actions [N, 4] float64, see `thalweg.env.task.motion.UnitAction`.

    Raises `ActionError` for a wrong shape or type, or a value out of range.
    """
    given = np.asarray(actions)
    if given.shape != (count, 4):
        raise ActionError(
            f"actions have shape {given.shape}; needed: ({count}, 4), one row of {', '.join(BRANCHES)} each"
        )
    if kind == "multidiscrete":
        if not np.issubdtype(given.dtype, np.integer):
            raise ActionError(f"actions have type {given.dtype}; multidiscrete actions are integers 0, 1 or 2")
        low, high = 0, 2
    else:
        if not (np.issubdtype(given.dtype, np.floating) or np.issubdtype(given.dtype, np.integer)):
            raise ActionError(f"actions have type {given.dtype}; continuous actions are numbers in -1..1")
        low, high = -1, 1
    bad = ~((given >= low) & (given <= high))  # NaN is bad too
    if bad.any():
        row, branch = (int(index) for index in np.argwhere(bad)[0])
        raise ActionError(
            f"action {given[row, branch]} of environment {row} ({BRANCHES[branch]}) is out of range {low}..{high}"
        )
    return 1.0 - given if kind == "multidiscrete" else given.astype(np.float64)


def from_unit_actions(kind: str, unit_actions: np.ndarray) -> np.ndarray:
    """Return unit actions [N, 4], each -1, 0 or 1, as actions [N, 4] of the space."""
    return (1 - unit_actions).astype(np.int64) if kind == "multidiscrete" else unit_actions.astype(np.float32)


def observation_space(kind: str, height_px: int, width_px: int, vehicle: str = "uav") -> gymnasium.spaces.Space:
    """Return the observation space of one environment; `kind` and `vehicle` as in `EnvConfig`."""
    image = lambda channels: gymnasium.spaces.Box(0, 255, (height_px, width_px, channels), np.uint8)  # noqa: E731
    if kind == "dict":
        return gymnasium.spaces.Dict({"rgb": image(3), "mask": image(1)})
    if kind == "privileged":
        return gymnasium.spaces.Box(-np.inf, np.inf, (len(features_of(vehicle)),), np.float32)
    if kind == "none":
        return gymnasium.spaces.Box(-np.inf, np.inf, (4,), np.float64)
    return image(CHANNELS[kind])


def frames_to_observations(kind: str, frames: np.ndarray) -> Any:
    """Return observations [N, ...] that have colours, of frames [N, H, W, 4] uint8 (red, green, blue, mask); copies
    except for `rgb+mask`."""
    if kind == "rgb+mask":
        return frames
    if kind == "dict":
        return {"rgb": frames[..., :3].copy(), "mask": frames[..., 3:].copy()}
    return frames[..., :3].copy()


def observation_at(batch: Any, row: int) -> Any:
    """Return a copy of one environment's observation in a batch."""
    return {key: value[row].copy() for key, value in batch.items()} if isinstance(batch, dict) else batch[row].copy()
