"""Configuration of the environment: every number of the task that a user may change, with its default.

Quantities that follow from a world, such as its length, are in `thalweg.env.task.course_arrays`.
"""

import math
import operator
from collections.abc import Iterable
from dataclasses import asdict, field, fields, replace
from enum import IntEnum
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import BeforeValidator, Field, InstanceOf, model_validator

from thalweg.core.config import FiniteNonNegative, FinitePositive, Hint, PairOf, frozen_config, refuse_unknown
from thalweg.env.errors import ConfigError
from thalweg.env.observation import BESIDE_FRAMES, DRAWN, Observation, parts_of
from thalweg.env.physics.feasible import check_forces, has_forces
from thalweg.env.physics.inertia import Inertia
from thalweg.env.physics.ranges import FromNumber, InOrder
from thalweg.env.physics.wind import Wind
from thalweg.env.tasks import Task, TaskRules, check_task, task_named
from thalweg.env.vehicle.boat import Boat
from thalweg.render.records.camera import Camera
from thalweg.render.records.quality import Quality
from thalweg.render.records.randomisation import Randomisation

ActionSpace = Literal["multidiscrete", "continuous"]
RewardScheme = Literal["paper", "package"]
Vehicle = Literal["uav", "asv"]
Dynamics = Literal["kinematic", "inertial"]
Steps = Annotated[int, Field(ge=1, le=2**31 - 1)]
Current = Annotated[PairOf[FiniteNonNegative], FromNumber, InOrder]
FORCE_FIELDS = ("dynamics", "inertia", "wind", "current_m_per_s", "carried_by_current")
"""Fields that `EnvConfig.as_data` leaves out at their defaults, so that the data of older configs stays the same."""


class UnknownOptionError(ConfigError, TypeError):
    """An unknown option of an environment; a `TypeError` too, as of any function that is given an unknown argument.

    Other libraries look for Python's own words in it, such as TorchRL for "unexpected keyword argument 'frameskip'".
    """


OTHER_NAMES = {"max_episode_steps": "max_steps"}
"""Names that others give to options, whose own are not the most similar."""


def check_options(given: Iterable[str], known: Iterable[str]) -> None:
    """Raise `UnknownOptionError`, which lists the known ones, for an option that is not among them."""
    known = list(known)
    try:
        refuse_unknown("option", given, known, ConfigError)
    except ConfigError as error:
        first = min(set(given) - set(known))
        error = f"the option is called {OTHER_NAMES[first]!r} here" if first in OTHER_NAMES else error
        raise UnknownOptionError(f"unexpected keyword argument {first!r}: {error}") from None


def integer_at_least(name: str, value: object, least: int) -> int:
    """Return a value as an integer of at least `least`; raises `ConfigError` with its name for anything else."""
    try:
        number = operator.index(value)  # pyright: ignore[reportArgumentType]
    except TypeError:
        number = None
    if number is None or isinstance(value, bool | np.bool_) or number < least:
        raise ConfigError(f"{name} must be a whole number of at least {least}, not {value!r}")
    return number


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
    COST_INCURRED = 7
    """The first cost of a task ended the episode, see `EnvConfig.hard`; not in the original package."""

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
    task: TaskRules
    is_boat: int = 0
    """1: the vehicle floats, and has the sizes below, see `thalweg.env.vehicle.boat.Boat`; 0: it flies."""
    half_length: float = 0.0
    half_beam: float = 0.0
    draught: float = 0.0
    keel_margin: float = 1.0
    camera_height: float = 0.0
    shallow_cost: float = 0.0


def _default_ranges(value: Any) -> Any:
    """Return the default ranges for True, None for False, and anything else unchanged."""
    if isinstance(value, bool | np.bool_):
        return Randomisation() if value else None
    return value


Ranges = Annotated[InstanceOf[Randomisation] | None, BeforeValidator(_default_ranges), Hint("True: the default ranges")]


@frozen_config(ConfigError, numpy_scalars=True)
class EnvConfig:
    """The task: motion, limits, observation, reward, cost and termination."""

    task: str = "River"
    """Task: `River`, that of the paper; in `Swimmers`, `Nests`, `RacingLine` and `Portage` each step may have a cost,
    and the greatest return breaks the limit (`thalweg.env.tasks`). Or that of a plug-in."""
    hard: bool = False
    """Whether the first cost of the task ends the episode; `River` has none but those of endings."""
    observation: Observation = "rgb+mask"
    """Observation: `rgb+mask` (4 channels), `rgb`, `mask`, which draws no colours and is several times as fast, `dict`
    (keys rgb and mask). Without frames: `privileged`, what a perfect camera could tell
    (`thalweg.env.task.ideal_eye.FEATURES`), or `none`, the pose x, y, z, yaw. Or a dictionary of any of the parts
    `rgb`, `mask`, `depth`, `class`, `proprioception` (`thalweg.env.task.proprioception.PROPRIOCEPTION`) and
    `privileged`: a tuple of their names, or a text such as "rgb,depth"."""
    action: ActionSpace = "multidiscrete"
    """Action: `multidiscrete` is four branches of 0, 1, 2; `continuous` is four numbers in -1..1, +1 = up, turn left,
    forward, left. In a task with a fast step, the number forward is a share of that, and a negative one is no move."""
    reward_scheme: RewardScheme = "paper"
    """`paper`: the reward is 10 times the share of newly visited segments and the loose cost is 0.2; `package`: the
    reward is 1 for a step that visits any new segment and the loose cost is 0.5."""
    vertical_step_m: FinitePositive = 1.0
    """Climb or descent in one step."""
    forward_step_m: FinitePositive = 1.0
    """Distance forward in one step."""
    lateral_step_m: FinitePositive = 0.5
    """Distance sideways in one step."""
    yaw_step_deg: FinitePositive = 10.0
    """Turn in one step."""
    allow_backward: bool = False
    """Whether the backward action moves the camera; otherwise it has no effect."""
    min_height_m: FiniteNonNegative = 0.5
    """Minimum height above the local water level."""
    max_height_m: FinitePositive = 15.0
    """Maximum height above the local water level."""
    max_yaw_deviation_deg: Annotated[float, Field(gt=0, le=180)] = 90.0
    """Maximum angle between the heading and the direction of travel."""
    max_idle_steps: Steps = 50
    """An episode ends after this many consecutive steps without a new segment."""
    max_steps: Steps | None = None
    """Maximum length of an episode. None: the step limit of the levels, or one proportional to the length of the course
    for any other world."""
    body_m: FinitePositive = 0.5
    """Edge of the axis-aligned cube that collides with bridges."""
    start_heading_deg: Annotated[float, Field(ge=0, le=90)] = 80.0
    """Maximum angle between the heading of a random initial pose and the direction of travel."""
    start_clearance_m: FiniteNonNegative = 0.5
    """Minimum distance of random initial poses from banks, islands and bridges."""
    step_s: FiniteNonNegative = 0.25
    """Time that passes in one step; the ripples of the water depend on it, and wind, current and inertia."""
    dynamics: Dynamics = "kinematic"
    """`kinematic`: an action moves the camera by a step at once; `inertial`: it commands velocities, which follow with
    a lag and limited acceleration, see `inertia`. Continuous actions only."""
    inertia: InstanceOf[Inertia] = field(default_factory=Inertia)
    """Maximum speeds, time constants and accelerations of inertial dynamics, in place of the sizes of the steps."""
    wind: InstanceOf[Wind] | None = None
    """Mean wind and gusts that push the vehicle. None: no wind."""
    current_m_per_s: Current | None = None
    """Speed of the water's surface in mid-channel, its mean along the course; a pair is a range from which each episode
    draws. None: still water."""
    carried_by_current: bool = False
    """Whether the vehicle floats, so that the current carries it and no wind lifts it."""
    camera: InstanceOf[Camera] = field(default_factory=Camera)
    """Resolution and optics of the frames."""
    quality: Quality = "full"
    """`full`, or `fast`: frames without reflected woods, with less filtering, and with interpolated ground. `thalweg
    speed` measures the difference."""
    randomisation: Ranges = None
    """Ranges in which the appearance varies. None: it does not vary. True: the default ranges."""
    critic_info: bool = False
    """Whether `info["critic_obs"]` says what critics may see beside the observation in training, see
    `thalweg.env.task.critic_info`. The task is the same either way, and states fit both."""

    vehicle: Vehicle = "uav"
    """`uav` flies; `asv` is a boat: it stays on the water, must not touch ground, rocks and bridges, and pays for
    shallow water. See `thalweg.env.vehicle`."""
    boat: InstanceOf[Boat] = field(default_factory=Boat)
    """Sizes of the boat; without a meaning for the `uav`."""

    @model_validator(mode="after")
    def _task_is_known(self) -> Self:
        check_task(self.task)
        return self

    @model_validator(mode="after")
    def _maximum_height_is_above_the_minimum(self) -> Self:
        if not self.max_height_m > self.min_height_m:
            raise ValueError(f"max_height_m must be above min_height_m = {self.min_height_m}, got {self.max_height_m}")
        return self

    @model_validator(mode="after")
    def _initial_headings_are_allowed(self) -> Self:
        if self.start_heading_deg > self.max_yaw_deviation_deg:
            raise ValueError(
                f"start_heading_deg must be at most max_yaw_deviation_deg = {self.max_yaw_deviation_deg}, "
                f"got {self.start_heading_deg}"
            )
        return self

    @model_validator(mode="after")
    def _boats_have_the_task_of_the_paper(self) -> Self:
        if self.vehicle == "asv" and self.task != "River":
            raise ValueError(f"task must be River for the vehicle asv, got {self.task!r}")
        return self

    @model_validator(mode="after")
    def _options_fit_the_task(self) -> Self:
        if self.task == "River":
            if self.hard:
                raise ValueError("hard must be False in the task River, whose costs all end the episode; got True")
        elif self.reward_scheme != "paper":
            raise ValueError(f"reward_scheme must be paper in the task {self.task}, got {self.reward_scheme}")
        fast = self.task_record.fast_step_m
        if fast and self.allow_backward:
            raise ValueError(
                f"allow_backward must be False in the task {self.task}, in which that option is a fast step; got True"
            )
        if fast and self.forward_step_m >= fast:
            raise ValueError(
                f"forward_step_m must be below the fast step of the task {self.task}, {fast:g} m; got"
                f" {self.forward_step_m:g}"
            )
        if fast and self.dynamics == "inertial":
            raise ValueError(
                f"dynamics must be kinematic in the task {self.task}, whose fast step is no velocity; got inertial"
            )
        return self

    @model_validator(mode="after")
    def _velocities_have_a_duration(self) -> Self:
        if "proprioception" in self.parts and not self.step_s > 0:
            raise ValueError(f"step_s must be above 0 for proprioception, which has velocities, got {self.step_s}")
        return self

    @model_validator(mode="after")
    def _vehicle_withstands_the_forces(self) -> Self:
        if self.dynamics == "inertial" and self.action != "continuous":
            raise ValueError(f"dynamics='inertial' needs action='continuous', not {self.action!r}")
        inertial = self.inertia if self.dynamics == "inertial" else None
        steps = self.step_s, self.lateral_step_m, self.forward_step_m
        afloat = self.carried_by_current or (self.vehicle == "asv" and self.current_m_per_s is not None)
        check_forces(steps, inertial, self.wind, self.current_m_per_s, afloat)
        return self

    def with_options(self, **options: Any) -> "EnvConfig":
        """Return a copy with some fields changed; raises `ConfigError` for an unknown key and lists the known ones."""
        check_options(options, (entry.name for entry in fields(self)))
        return replace(self, **options)

    def as_data(self) -> dict[str, Any]:
        """Return what defines the task as plain data: all fields but `critic_info`, which nothing in it depends on, and
        those of `FORCE_FIELDS` that have their defaults.

        The paper's task is that of data without `task`, `hard`, `vehicle` and `boat`: earlier versions knew no other.
        """
        left_out = {"critic_info"} | ({"task", "hard"} if self.task == "River" else set())
        left_out |= {"vehicle", "boat"} if self.vehicle == "uav" else set()
        left_out |= {name for name in FORCE_FIELDS if getattr(self, name) == getattr(DEFAULT_CONFIG, name)}
        parts = {} if isinstance(self.observation, str) else {"observation": list(self.observation)}
        data = asdict(self) | {"camera": self.camera.as_data()}
        return {name: value for name, value in data.items() if name not in left_out} | parts

    @property
    def task_record(self) -> Task:
        """What is particular to the task."""
        return task_named(self.task)

    @property
    def has_forces(self) -> bool:
        """Whether the vehicle moves by anything but its own steps."""
        return has_forces(self.dynamics, self.wind, self.current_m_per_s)

    @property
    def fast_ratio(self) -> float:
        """Length of a fast step, in steps forward; 0 in a task without one."""
        return self.task_record.fast_step_m / self.forward_step_m

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts of the observation, see `thalweg.env.observation.PARTS`; empty for the pose alone."""
        return parts_of(self.observation)

    @property
    def channels(self) -> int:
        """Channels that are drawn for an observation: 4 with colours, 1 of a mask, or 0."""
        return 4 if "rgb" in self.parts else int(any(part in DRAWN for part in self.parts))

    @property
    def draws_layers(self) -> bool:
        """Whether depth and class are drawn for an observation."""
        return any(part in BESIDE_FRAMES for part in self.parts)

    def seen_through(self, inputs: str) -> "EnvConfig":
        """Return the config for an encoder of `inputs`, such as "mask": nothing is drawn that it does not see."""
        narrower = inputs == "mask" and self.observation == "rgb+mask"
        return replace(self, observation="mask") if narrower else self

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
            self.task_record.rules(hard=self.hard),
            *self._boat_limits,  # pyright: ignore[reportArgumentType]
        )

    @property
    def _boat_limits(self) -> tuple[float, ...]:
        """The numbers of the boat, in the order of `Limits`; none for the UAV, for which those have their defaults."""
        if self.vehicle == "uav":
            return ()
        boat = self.boat
        sizes = (0.5 * boat.length_m, 0.5 * boat.beam_m, boat.draught_m, boat.keel_margin_m, boat.camera_height_m)
        return (1, *(float(value) for value in (*sizes, boat.shallow_cost)))

    @property
    def cost_kinds(self) -> tuple[str, ...]:
        """Names of the columns of `info["costs"]`."""
        kinds = self.task_record.cost_kinds
        return kinds if self.vehicle == "uav" else (*kinds, "shallow")


DEFAULT_CONFIG = EnvConfig()
"""Configuration of the levels."""
