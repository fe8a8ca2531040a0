"""Action and observation spaces, the validation of actions, and the conversion of frames to observations."""

from typing import Any

import gymnasium
import numpy as np

from thalweg.env.task.motion import ROUNDING
from thalweg.env.task.priced.eye import features_of
from thalweg.env.task.proprioception import PROPRIOCEPTION
from thalweg.render.records.classes import CLASSES

FORWARD = 2
"""Index of the branch forward."""
BRANCHES = ("vertical", "yaw", "longitudinal", "lateral")
"""Branches of an action; `moves_in_words` says what their options do."""
CHANNELS = {"rgb+mask": 4, "rgb": 3, "mask": 1}
"""Channels of the observations that are one image."""
SKY_DEPTH_M = -1.0
"""Depth of the sky, and of all else that a ray never meets."""


class ActionError(ValueError):
    """An action of the wrong shape or type, or out of range."""


def action_space(kind: str) -> gymnasium.spaces.Space:
    """Return the action space of one environment; `kind` as in `EnvConfig.action`."""
    if kind == "multidiscrete":
        return gymnasium.spaces.MultiDiscrete([3, 3, 3, 3])
    return gymnasium.spaces.Box(-1.0, 1.0, (4,), dtype=np.float32)


def moves_in_words(
    kind: str, *, fast_step: bool = False, allow_backward: bool = False, vehicle: str = "uav"
) -> dict[str, tuple[str, str, str]]:
    """Return what the options 0, 1, 2 of each branch do, or of continuous actions +1, 0 and -1.

    fast_step: whether the task has one, see `thalweg.env.tasks.Task.fast_step_m`. The others are as in `EnvConfig`.
    """
    forward, last = "forward", "backward" if allow_backward else "none"
    if fast_step:
        forward, last = ("forward", "fast forward") if kind == "multidiscrete" else ("fast forward", "none")
    up, down = ("none", "none") if vehicle == "asv" else ("up", "down")
    moves = (up, "none", down), ("turn left", "none", "turn right"), (forward, "none", last), ("left", "none", "right")
    return dict(zip(BRANCHES, moves, strict=True))


def batch_of_one(action: object) -> np.ndarray:
    """Return the action [4] of a single environment as a batch [1, 4]; raises `ActionError` for another shape."""
    try:
        given = np.asarray(action)
    except ValueError:  # nested lists of different lengths
        given = np.empty(0)
    except (TypeError, RuntimeError) as error:  # tensors of a type that NumPy lacks, on a GPU, or with a gradient
        raise ActionError(f"the action is no array, {error}; needed: [4]") from None
    if given.shape != (4,):
        found = repr(action) if given.size <= 8 else f"an array of shape {given.shape}"
        raise ActionError(f"an action is four numbers, one each for {', '.join(BRANCHES)}, not {found}")
    return given[None]


def to_unit_actions(kind: str, actions: object, count: int, fast_ratio: float = 0.0) -> np.ndarray:
    """Return actions [N, 4] of the space as unit actions [N, 4] float64, see `thalweg.env.task.motion.UnitAction`.

    fast_ratio: length of a fast step in steps forward, 0 without one; where there is one, +1 forward of a continuous
    action is a fast step, and a negative number is no move.
    Raises `ActionError` for a wrong shape or type, or a value out of range.
    """
    try:
        given = np.asarray(actions)
    except (ValueError, TypeError, RuntimeError) as error:  # as in `batch_of_one`
        raise ActionError(f"actions are no array, {error}; needed: [{count}, 4]") from None
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
    given = np.ascontiguousarray(given)  # kernels would be compiled again for another layout
    if kind == "multidiscrete":
        return 1.0 - given
    unit_actions = given.astype(np.float64)
    if fast_ratio:
        share = unit_actions[:, FORWARD].clip(0.0)
        steps = share * fast_ratio
        unit_actions[:, FORWARD] = np.where(steps <= 1.0 + ROUNDING, np.minimum(steps, 1.0), -share)
    return unit_actions


def from_unit_actions(kind: str, unit_actions: np.ndarray, fast_ratio: float = 0.0) -> np.ndarray:
    """Return unit actions [N, 4], each -1, 0 or 1, as actions [N, 4] of the space; fast_ratio as in
    `to_unit_actions`."""
    if kind == "multidiscrete":
        return (1 - unit_actions).astype(np.int64)
    actions = unit_actions.astype(np.float32)
    if fast_ratio:
        forward = actions[:, FORWARD]
        actions[:, FORWARD] = np.where(forward < 0, -forward, forward / fast_ratio)
    return actions


def observation_space(
    kind: str | tuple[str, ...], height_px: int, width_px: int, task: str = "River", vehicle: str = "uav"
) -> gymnasium.spaces.Space:
    """Return the observation space of one environment; `kind` as in `EnvConfig.observation`, `task` and `vehicle` as
    there."""
    if kind == "none":
        return gymnasium.spaces.Box(-np.inf, np.inf, (4,), np.float64)
    if kind == "rgb+mask":
        return gymnasium.spaces.Box(0, 255, (height_px, width_px, 4), np.uint8)
    parts = part_spaces(height_px, width_px, task, vehicle)
    if kind == "dict":
        kind = ("rgb", "mask")
    return parts[kind] if isinstance(kind, str) else gymnasium.spaces.Dict({part: parts[part] for part in kind})


def part_spaces(
    height_px: int, width_px: int, task: str = "River", vehicle: str = "uav"
) -> dict[str, gymnasium.spaces.Box]:
    """Return the space of each part of an observation, see `thalweg.env.observation.PARTS`.

    * rgb, mask: uint8 [H, W, 3] sRGB and [H, W, 1], 0 or 255 where water is seen.
    * depth: float32 [H, W, 1], metres along the optical axis to what is seen; `SKY_DEPTH_M` for the sky.
    * class: uint8 [H, W, 1], index in `thalweg.render.records.classes.CLASSES`.
    * proprioception, privileged: float32, the numbers of `PROPRIOCEPTION`, and of the ideal eye of the
      vehicle in the task.
    """

    def image(channels: int, low: float = 0, high: float = 255, dtype: Any = np.uint8) -> gymnasium.spaces.Box:
        return gymnasium.spaces.Box(low, high, (height_px, width_px, channels), dtype)

    def numbers(names: tuple[str, ...]) -> gymnasium.spaces.Box:
        return gymnasium.spaces.Box(-np.inf, np.inf, (len(names),), np.float32)

    return {
        "rgb": image(3),
        "mask": image(1),
        "depth": image(1, SKY_DEPTH_M, np.inf, np.float32),
        "class": image(1, 0, len(CLASSES) - 1),
        "proprioception": numbers(PROPRIOCEPTION),
        "privileged": numbers(features_of(task, vehicle)),
    }


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


def first_observations(batch: Any, count: int) -> Any:
    """Return the first `count` observations of a batch, without a copy."""
    return {key: value[:count] for key, value in batch.items()} if isinstance(batch, dict) else batch[:count]
