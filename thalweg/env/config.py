"""Configuration of the environment: every number of the task that a user may change, with its default.

Quantities that follow from a world, such as its length, are in `thalweg.env.task.course_arrays`.
"""

import math
import operator
from collections.abc import Iterable
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from numbers import Real
from typing import Any, NamedTuple

import numpy as np

from thalweg.render.records.camera import Camera
from thalweg.render.records.quality import QUALITIES, Quality
from thalweg.render.records.randomisation import Randomisation

OBSERVATIONS = ("rgb+mask", "rgb", "mask", "dict", "none")
ACTIONS = ("multidiscrete", "continuous")
REWARD_SCHEMES = ("paper", "package")


class ConfigError(ValueError):
    """An unknown key of a config, or a value that is unknown or out of range."""


def whole(name: str, value: object, least: int) -> int:
    """Return a value as an integer of at least `least`; raises `ConfigError` with its name for anything else."""
    try:
        number = operator.index(value)  # pyright: ignore[reportArgumentType]
    except TypeError:
        number = None
    if number is None or isinstance(value, bool | np.bool_) or number < least:
        raise ConfigError(f"{name} must be a whole number of at least {least}, not {value!r}")
    return number


def refuse_unknown(kind: str, given: Iterable[str], known: Iterable[str]) -> None:
    """Raise `ConfigError` for names that are not known; the message lists the known ones."""
    known = list(known)
    unknown = sorted(set(given) - set(known))
    if unknown:
        raise ConfigError(f"unknown {kind} {', '.join(map(repr, unknown))}; known: {', '.join(known)}")


class DoneReason(IntEnum):
    """Why an episode ended. If several reasons hold in one step, the lowest code is reported.

    The codes are those of the original package.
    """

    RUNNING = -1
    COLLISION = 0
    OUT_OF_VOLUME_HORIZONTAL = 1
    OUT_OF_VOLUME_VERTICAL = 2
    YAW_OVER_DEVIATION = 3
    IDLE = 4
    MAX_STEP_REACHED = 5
    SUCCESS = 6

    @property
    def label(self) -> str:
        """Name of the reason as the paper writes it, such as `OutOfVolumeHorizontal`."""
        return self.name.title().replace("_", "")


REASON_NAMES = {int(reason): reason.label for reason in DoneReason}
"""Label of each reason by its code."""


class Limits(NamedTuple):
    """Numbers of an `EnvConfig` as the kernels take them: metres and radians, flags as 0 or 1."""

    vertical_step: float
    forward_step: float
    lateral_step: float
    yaw_step: float
    allow_backward: int
    min_height: float
    max_height: float
    max_yaw_deviation: float
    max_idle_steps: int
    pays_share: int
    """1: the reward is proportional to the share of segments a step visits; 0: it is 1 for any new segment."""
    tight_cost: float
    loose_cost: float


@dataclass(frozen=True)
class EnvConfig:
    """The task: motion, limits, observation, reward, cost and termination."""

    observation: str = "rgb+mask"
    """Observation: `rgb+mask` (4 channels), `rgb`, `mask`, `dict` (keys rgb and mask), or `none`, which renders nothing
    and returns the pose x, y, z, yaw."""
    action: str = "multidiscrete"
    """Action: `multidiscrete` is four branches of 0, 1, 2; `continuous` is four numbers in -1..1, +1 = up, turn left,
    forward, left."""
    reward_scheme: str = "paper"
    """`paper`: the reward is 10 times the share of newly visited segments and the loose cost is 0.2; `package`: the
    reward is 1 for a step that visits any new segment and the loose cost is 0.5."""
    vertical_step_m: float = 1.0
    """Climb or descent in one step."""
    forward_step_m: float = 1.0
    """Distance forward in one step."""
    lateral_step_m: float = 0.5
    """Distance sideways in one step."""
    yaw_step_deg: float = 10.0
    """Turn in one step."""
    allow_backward: bool = False
    """Whether the backward action moves the camera; otherwise it has no effect."""
    min_height_m: float = 0.5
    """Minimum height above the local water level."""
    max_height_m: float = 15.0
    """Maximum height above the local water level."""
    max_yaw_deviation_deg: float = 90.0
    """Maximum angle between the heading and the direction of travel."""
    max_idle_steps: int = 50
    """An episode ends after this many consecutive steps without a new segment."""
    max_steps: int | None = None
    """Maximum length of an episode. None: the step limit of the levels, or one proportional to the length of the course
    for any other world."""
    body_m: float = 0.5
    """Edge of the axis-aligned cube that collides with bridges."""
    start_heading_deg: float = 80.0
    """Maximum angle between the heading of a random initial pose and the direction of travel."""
    start_clearance_m: float = 0.5
    """Minimum distance of random initial poses from banks, islands and bridges."""
    step_s: float = 0.25
    """Time that passes in one step; only the ripples of the water depend on it."""
    camera: Camera = field(default_factory=Camera)
    """Resolution and optics of the frames."""
    quality: Quality = "full"
    """`full`, or `fast`: frames without reflections, with less filtering, and with one ray for four pixels. `thalweg
    speed` measures the difference."""
    randomisation: Randomisation | None = None
    """Ranges in which the appearance varies. None: it does not vary. True: the default ranges."""

    def __post_init__(self) -> None:
        known = {"observation": OBSERVATIONS, "action": ACTIONS, "reward_scheme": REWARD_SCHEMES, "quality": QUALITIES}
        for name, values in known.items():
            value = getattr(self, name)
            if not isinstance(value, str) or value not in values:
                raise ConfigError(f"unknown {name} {value!r}; known: {', '.join(values)}")
        if not isinstance(self.allow_backward, bool | np.bool_):
            raise ConfigError(f"allow_backward must be True or False, not {self.allow_backward!r}")
        if not isinstance(self.camera, Camera):
            raise ConfigError(f"camera must be a Camera, not {self.camera!r}")
        if isinstance(self.randomisation, bool):
            object.__setattr__(self, "randomisation", Randomisation() if self.randomisation else None)
        if not isinstance(self.randomisation, Randomisation | None):
            raise ConfigError(f"randomisation must be a Randomisation, True or None, not {self.randomisation!r}")
        whole("max_idle_steps", self.max_idle_steps, 1)
        if self.max_steps is not None:
            whole("max_steps", self.max_steps, 1)
        self._check_numbers()

    def _check_numbers(self) -> None:
        """Raise `ConfigError` for a quantity that is not a finite number, or is out of range."""
        for entry in fields(self):
            value = getattr(self, entry.name)
            if entry.name.endswith(("_m", "_deg", "_s")) and not (
                isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
            ):
                raise ConfigError(f"{entry.name} must be a finite number, not {value!r}")
        for name in ("vertical_step_m", "forward_step_m", "lateral_step_m", "yaw_step_deg", "body_m"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"{name} must be above zero, not {getattr(self, name)}")
        for name in ("min_height_m", "start_clearance_m", "step_s"):
            if not getattr(self, name) >= 0:
                raise ConfigError(f"{name} must not be negative, not {getattr(self, name)}")
        if not self.max_height_m > self.min_height_m:
            raise ConfigError(f"max_height_m = {self.max_height_m} must be above min_height_m = {self.min_height_m}")
        if not 0 < self.max_yaw_deviation_deg <= 180:
            raise ConfigError(f"max_yaw_deviation_deg must be in 0..180, not {self.max_yaw_deviation_deg}")
        if not 0 <= self.start_heading_deg <= min(self.max_yaw_deviation_deg, 90.0):
            raise ConfigError(
                f"start_heading_deg = {self.start_heading_deg} must be in 0..90 and no more than max_yaw_deviation_deg"
                f" = {self.max_yaw_deviation_deg}"
            )

    def with_options(self, **options: Any) -> "EnvConfig":
        """Return a copy with some fields changed; raises `ConfigError` for an unknown key and lists the known ones."""
        refuse_unknown("option", options, (entry.name for entry in fields(self)))
        return replace(self, **options)

    @property
    def loose_cost(self) -> float:
        """Cost of YawOverDeviation, Idle and MaxStepReached under the reward scheme."""
        return 0.2 if self.reward_scheme == "paper" else 0.5

    @property
    def tight_cost(self) -> float:
        """Cost of Collision, OutOfVolumeHorizontal and OutOfVolumeVertical."""
        return 1.0

    @property
    def limits(self) -> Limits:
        """Numbers of this config as the kernels take them."""
        return Limits(
            float(self.vertical_step_m),
            float(self.forward_step_m),
            float(self.lateral_step_m),
            math.radians(self.yaw_step_deg),
            int(self.allow_backward),
            float(self.min_height_m),
            float(self.max_height_m),
            math.radians(self.max_yaw_deviation_deg),
            int(self.max_idle_steps),
            int(self.reward_scheme == "paper"),
            self.tight_cost,
            self.loose_cost,
        )


DEFAULT_CONFIG = EnvConfig()
"""Configuration of the levels."""
