"""The eye of a flight: frames by another camera than the page's, such as the one that a policy was trained with."""

from dataclasses import replace

import numpy as np

from thalweg.env.frame_renderer import FrameRenderer
from thalweg.render import Camera
from thalweg.viewer.flight.flight import Flight


class Eye:
    """Draws frames of a flight's river and look in full quality, whatever the page shows."""

    def __init__(self, flight: Flight, camera: Camera) -> None:
        self.camera = camera
        self.env = flight.env
        config = replace(flight.env.config, camera=camera, quality="full")
        self._frames = FrameRenderer(flight.env.worlds, 1, config)

    def serves(self, flight: Flight, camera: Camera) -> bool:
        """Return whether this is the eye of a flight in the same environment, by the same camera."""
        return self.env is flight.env and self.camera == camera

    def see(self, flight: Flight, channels: int) -> np.ndarray:
        """Return the frame [1, H, W, C] uint8 of the current state: the mask alone for one channel."""
        views, props = flight.views(), flight.env.props()
        if channels == 1:
            return self._frames.render_masks(views, props)
        return self._frames.render(views, props)[..., :channels]
