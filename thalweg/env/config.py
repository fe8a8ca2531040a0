"""Which limits, steps and payments does a task have? Every number of the task that a user may change, with its default.

What follows from a world, such as its length, is not here but in `thalweg.env.task.course_arrays`.
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
    """A key or value of a config that is not among the known ones, or is out of range."""


def whole(name: str, value: object, least: int) -> int:
    """A whole number that is not below the least; raises `ConfigError` by name for anything else."""
    try:
        number = operator.index(value)  # pyright: ignore[reportArgumentType]
    except TypeError:
        number = None
    if number is None or isinstance(value, bool | np.bool_) or number < least:
        raise ConfigError(f"{name} must be a whole number of at least {least}, not {value!r}")
    return number


def refuse_unknown(kind: str, given: Iterable[str], known: Iterable[str]) -> None:
    """Raises `ConfigError` for names that are not among the known ones, which it lists."""
    known = list(known)
    unknown = sorted(set(given) - set(known))
    if unknown:
        raise ConfigError(f"unknown {kind} {', '.join(map(repr, unknown))}; known: {', '.join(known)}")


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


REASON_NAMES = {int(reason): reason.label for reason in DoneReason}
"""Labels by code."""


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
    quality: Quality = "full"
    """`full`, or `fast`: frames without reflections, filtered less, marched once for four pixels; `thalweg speed` says
    how much faster."""
    randomisation: Randomisation | None = None
    """From where to where the look varies; None: not at all. True stands for the default ranges."""

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
        """Raises `ConfigError` for a quantity that is no finite number, or out of range."""
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
        """A copy with some fields changed; raises `ConfigError` for an unknown key, naming the known ones."""
        refuse_unknown("option", options, (entry.name for entry in fields(self)))
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
