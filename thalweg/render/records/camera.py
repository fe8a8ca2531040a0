"""`Camera`: a pinhole camera, pitched down by a fixed angle, without roll."""

import math
from typing import Annotated

from pydantic import Field

from thalweg.core.config import Hint, WholeNumber, frozen_config
from thalweg.render.errors import RenderError

Pixels = Annotated[WholeNumber, Field(ge=16, le=2048)]


@frozen_config(RenderError, numpy_scalars=True)
class Camera:
    """A pinhole camera; its pose (x, y, z, yaw) comes with each frame."""

    height_px: Pixels = 128
    """Rows of the image."""
    width_px: Pixels = 128
    """Columns of the image."""
    fov_deg: Annotated[float, Field(ge=5, le=150)] = 60.0
    """Vertical field of view; the horizontal one follows from square pixels."""
    pitch_deg: Annotated[float, Field(ge=-89, le=89), Hint("negative looks up, positive down")] = 20.0
    """How far the optical axis points below the horizon."""
    near_m: Annotated[float, Field(ge=0.01, le=10)] = 0.3
    """Nothing nearer than this along the optical axis is drawn."""

    @property
    def half_height(self) -> float:
        """Half the height of the image plane at distance one."""
        return math.tan(math.radians(self.fov_deg) / 2)

    @property
    def half_width(self) -> float:
        """Half the width of the image plane at distance one."""
        return self.half_height * self.width_px / self.height_px

    @property
    def pixel(self) -> float:
        """Side of a pixel on the image plane at distance one."""
        return 2 * self.half_height / self.height_px
