"""Which limits, steps and payments does a task have? Every number of the task that a user may change, with its default.

What follows from a world, such as its length, is not here but in `thalweg.env.courses`.
"""

import math
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from typing import Any, NamedTuple

from thalweg.render.camera import Camera

OBSERVATIONS = ("rgb+mask", "rgb", "mask", "dict", "none")
ACTIONS = ("multidiscrete", "continuous")
REWARD_SCHEMES = ("paper", "package")


class ConfigError(ValueError):
    """A key or value of a config that is not among the known ones, or is out of range."""


class DoneReason(IntEnum):
    """Why an episode ended; of several reasons in one step the lowest code is reported (codes of the original
    package)."""

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
        """The name as the paper writes it, such as `OutOfVolumeHorizontal`."""
        return self.name.title().replace("_", "")


class Limits(NamedTuple):
    """The numbers of an `EnvConfig` as the kernels take them: metres and radians, flags as 0 or 1."""

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
    """1 when a step is paid by the share of segments it visits, 0 when it is paid 1 for any new segment."""
    tight_cost: float
    loose_cost: float


@dataclass(frozen=True)
class EnvConfig:
    """The task: how the camera moves, where it may be, what is seen, paid and charged, and when an episode ends."""

    observation: str = "rgb+mask"
    """What is seen: `rgb+mask` (4 channels), `rgb`, `mask`, `dict` (keys rgb and mask), or `none`: nothing is drawn
    and the observation is the pose x, y, z, yaw."""
    action: str = "multidiscrete"
    """`multidiscrete`: four branches of 0, 1, 2; `continuous`: four numbers in -1..1, +1 = up, turn left, forward,
    left."""
    reward_scheme: str = "paper"
    """`paper`: 10 times the share of segments newly visited, loose cost 0.2; `package`: 1 for a step that visits any
    new segment, loose cost 0.5."""
    vertical_step_m: float = 1.0
    """Climb or descent of one step."""
    forward_step_m: float = 1.0
    """Way forward of one step."""
    lateral_step_m: float = 0.5
    """Way to the side of one step."""
    yaw_step_deg: float = 10.0
    """Turn of one step."""
    allow_backward: bool = False
    """Whether the backward action moves; otherwise it has no effect."""
    min_height_m: float = 0.5
    """Lowest height above the local water level."""
    max_height_m: float = 15.0
    """Greatest height above the local water level."""
    max_yaw_deviation_deg: float = 90.0
    """Largest angle between heading and direction of travel."""
    max_idle_steps: int = 50
    """An episode ends after this many steps in a row without a new segment."""
    max_steps: int | None = None
    """Longest episode; None: the step limit of the levels, or in proportion to the course's length for any other
    world."""
    body_m: float = 0.5
    """Edge of the cube, parallel to the axes, that collides with bridges."""
    start_heading_deg: float = 80.0
    """Largest angle between the heading of a random start and the direction of travel."""
    start_clearance_m: float = 0.5
    """Distance of random starts from banks, islands and bridges."""
    step_s: float = 0.25
    """Time that passes in one step; only the water's ripples depend on it."""
    camera: Camera = field(default_factory=Camera)
    """Resolution and optics of the frames."""

    def __post_init__(self) -> None:
        known = {"observation": OBSERVATIONS, "action": ACTIONS, "reward_scheme": REWARD_SCHEMES}
        for name, values in known.items():
            if getattr(self, name) not in values:
                raise ConfigError(f"unknown {name} {getattr(self, name)!r}; known: {', '.join(values)}")
        positive = ("vertical_step_m", "forward_step_m", "lateral_step_m", "yaw_step_deg", "max_idle_steps", "body_m")
        for name in (*positive, "max_steps"):
            value = getattr(self, name)
            if value is not None and not (value > 0 and math.isfinite(value)):
                raise ConfigError(f"{name} must be above zero, not {value}")
        for name in ("min_height_m", "start_clearance_m", "step_s"):
            value = getattr(self, name)
            if not (value >= 0 and math.isfinite(value)):
                raise ConfigError(f"{name} must not be negative, not {value}")
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
        """A copy with some fields changed; raises `ConfigError` for an unknown key, naming the known ones."""
        known = [entry.name for entry in fields(self)]
        unknown = sorted(set(options) - set(known))
        if unknown:
            raise ConfigError(f"unknown option {', '.join(map(repr, unknown))}; known: {', '.join(known)}")
        return replace(self, **options)

    @property
    def loose_cost(self) -> float:
        """Cost of YawOverDeviation, Idle and MaxStepReached under the reward scheme."""
        return 0.2 if self.reward_scheme == "paper" else 0.5

    @property
    def tight_cost(self) -> float:
        """Cost of Collision and of leaving the volume."""
        return 1.0

    @property
    def limits(self) -> Limits:
        """The same numbers as the kernels take them."""
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
"""The task as the levels have it."""
