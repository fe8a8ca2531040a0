"""Settings of the frames that an encoder is trained on: the camera, the quality, and whether looks vary."""

from dataclasses import dataclass
from typing import Any

from thalweg.env.config import DEFAULT_CONFIG
from thalweg.render import Camera
from thalweg.render.records.quality import Quality
from thalweg.render.records.randomisation import Randomisation


@dataclass(frozen=True)
class Drawing:
    """Frames of a camera; by default as those of the levels."""

    camera: Camera = DEFAULT_CONFIG.camera
    quality: Quality = "full"
    randomise: bool = False
    """Whether light, water, plants, camera angles, noise and clouds vary from frame to frame."""

    @property
    def randomisation(self) -> Randomisation | None:
        """Ranges of the looks; None if they do not vary."""
        return Randomisation() if self.randomise else None

    def as_data(self) -> dict[str, Any]:
        """Return plain data of what differs from the defaults; empty if nothing does."""
        usual = Drawing()
        data: dict[str, Any] = camera_as_data(self.camera)
        data |= {"quality": self.quality} if self.quality != usual.quality else {}
        return data | ({"randomise": True} if self.randomise else {})


def camera_as_data(camera: Camera) -> dict[str, Any]:
    """Return what the record of a training says of its camera: nothing of the usual one."""
    return {} if camera == DEFAULT_CONFIG.camera else {"camera": camera.as_data()}


def size_of(camera: Camera) -> tuple[int, int]:
    """Return height and width of a camera's frames, which the config of an encoder takes as its `size_px`."""
    return camera.height_px, camera.width_px
