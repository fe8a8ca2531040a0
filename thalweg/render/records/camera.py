"""Through what eye is the world seen? One pinhole camera, pitched down by a fixed angle, without roll."""

import math
from dataclasses import dataclass

from thalweg.render.errors import RenderError


@dataclass(frozen=True)
class Camera:
    """A pinhole camera; its pose (x, y, z, yaw) comes with each frame."""

    height_px: int = 128
    """Rows of the image."""
    width_px: int = 128
    """Columns of the image."""
    fov_deg: float = 60.0
    """Vertical field of view; the horizontal one follows from square pixels."""
    pitch_deg: float = 20.0
    """How far the optical axis points below the horizon."""
    near_m: float = 0.3
    """Nothing nearer than this along the optical axis is drawn."""

    def __post_init__(self) -> None:
        for name in ("height_px", "width_px"):
            size = getattr(self, name)
            if size != int(size) or not 16 <= size <= 2048:
                raise RenderError(f"{name} = {size}: an image has 16 to 2048 whole pixels a side")
        if not 5.0 <= self.fov_deg <= 150.0:
            raise RenderError(f"fov_deg = {self.fov_deg}: choose a field of view from 5 to 150 degrees")
        if not -89.0 <= self.pitch_deg <= 89.0:
            raise RenderError(f"pitch_deg = {self.pitch_deg}: choose a pitch from -89 (up) to 89 (down) degrees")
        if not 0.01 <= self.near_m <= 10.0:
            raise RenderError(f"near_m = {self.near_m}: choose a near plane from 0.01 to 10 m")

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
