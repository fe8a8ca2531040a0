"""Films of flights: one that is flown now by a policy or a pilot, or a recorded one, in its look."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from thalweg.bench.pictures import film
from thalweg.bench.pictures.film_format import format_of
from thalweg.env.frame_renderer import FrameRenderer, Views
from thalweg.render import Camera
from thalweg.viewer.errors import ViewerError
from thalweg.viewer.flight.cockpit import Cockpit
from thalweg.viewer.flight.recording import Recording


class FilmedFlight:
    """A flight with what was seen before each of its steps."""

    def __init__(self, cockpit: Cockpit, most_steps: int | None = None, camera: Camera | None = None) -> None:
        """Fly the flight of a cockpit until it ends, its recording is over, or `most_steps` are flown.

        `camera` films it, by default that of the flight's environment.
        Raises `ViewerError` without a flight, and the errors of `format_of` and of who flies.
        """
        if cockpit.flight is None:
            raise ViewerError("there is no flight: start one first")
        self.flight = flight = cockpit.flight
        env = flight.env
        self._shape = format_of(camera or env.config.camera)
        other = camera is not None and camera != env.config.camera
        self._frames = FrameRenderer(env.worlds, 1, replace(env.config, camera=camera)) if other else env.frames
        self._seen: list[tuple[Views, np.ndarray | None]] = []
        goes_on = True
        while goes_on and flight.steps != most_steps:
            seen = flight.views(), flight.env.props()
            goes_on = cockpit.advance(1)
            if flight.steps > len(self._seen):
                self._seen.append(seen)

    def record(self) -> film.Flight:
        """Return the flight as films take it; raises `ViewerError` for one without a step."""
        flight, recording = self.flight, Recording.of(self.flight)
        returns = np.concatenate([[0.0], np.cumsum(flight.rewards)[:-1]])
        poses, times_s = np.array(flight.poses[:-1]), np.array(flight.times_s[:-1])
        return film.Flight(recording.episode(0, flight.world), poses, times_s, returns)

    def draw(self, index: int) -> np.ndarray:
        """Return the frame [H, W, 4] uint8 before a step, in the look of the flight."""
        return self._frames.render(*self._seen[index])[0]

    def write(self, path: Path, title: str, on_frame: Callable[[], Any] | None = None) -> None:
        """Write the film, whose first line is `title`, as `thalweg.bench.pictures.film.write_film` does."""
        record, world = self.record(), self.flight.world
        film.write_film(path, world, record, title, shape=self._shape, draw=self.draw, on_frame=on_frame)
