"""Options of a flight: river, task, vehicle, look and frames, as plain data that pages and files hold."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from thalweg.core.config import frozen_config
from thalweg.core.suggestion import did_you_mean
from thalweg.env import EnvConfig
from thalweg.env.config import ActionSpace, Dynamics, Vehicle
from thalweg.env.physics.wind import Wind
from thalweg.env.tasks import check_task
from thalweg.render import Camera
from thalweg.render.records.quality import Quality
from thalweg.viewer.errors import ViewerError
from thalweg.viewer.flight.looks import LOOKS, USUAL

LARGEST_SEED = 2**53 - 1
"""Greatest whole number that a page can hold exactly."""
Seed = Annotated[int, Field(ge=0, le=LARGEST_SEED)]


@frozen_config(ViewerError)
class FlightOptions:
    """Choices of one flight. Together with the actions they define it to the bit."""

    level: str = "Medium"
    """Name of a level, or of the river that the command was given."""
    world_seed: Seed | None = None
    """Seed of the river. None: the fixed river of the level."""
    seed: Seed = 0
    """Seed of the episode: its start, and what moves in it."""
    task: str = "River"
    """Task, see `thalweg.env.tasks`, or that of a plug-in."""
    hard: bool = False
    """Whether the first cost of the task ends the flight."""
    vehicle: Vehicle = "uav"
    """`uav` flies, `asv` is a boat."""
    action: ActionSpace = "multidiscrete"
    """Kind of actions."""
    dynamics: Dynamics = "kinematic"
    """`inertial` needs continuous actions."""
    wind_m_per_s: Annotated[float, Field(ge=0, le=20)] = 0.0
    """Mean speed of the wind; 0 is no wind."""
    look: str = USUAL
    """Appearance, one of `thalweg.viewer.flight.looks.LOOKS`."""
    quality: Quality = "full"
    """Quality of the frames on the page."""
    size_px: Annotated[int, Field(ge=32, le=768)] = 384
    """Height and width of the frames on the page. What policies see does not depend on it."""

    @model_validator(mode="after")
    def _task_is_known(self) -> Self:
        check_task(self.task)
        return self

    @model_validator(mode="after")
    def _look_is_known(self) -> Self:
        if self.look not in LOOKS:
            raise ValueError(
                f"look must be one of {', '.join(LOOKS)}, got {self.look!r}{did_you_mean(self.look, LOOKS)}"
            )
        return self

    @property
    def rules(self) -> EnvConfig:
        """Config of the environment. It observes only what is measured aboard; frames are drawn when they are shown.

        Raises `ConfigError` for options that do not go together.
        """
        return EnvConfig(
            task=self.task,
            hard=self.hard,
            vehicle=self.vehicle,
            action=self.action,
            dynamics=self.dynamics,
            wind=Wind(speed_m_per_s=self.wind_m_per_s) if self.wind_m_per_s else None,  # pyright: ignore
            randomisation=LOOKS[self.look],
            observation=("proprioception",),
            camera=Camera(height_px=self.size_px, width_px=self.size_px),
            quality=self.quality,
        )
