"""Tests of films of flights."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.viewer.flight.conftest import Fly
from thalweg.env.frame_renderer import FrameRenderer
from thalweg.render import Camera
from thalweg.viewer.errors import ViewerError
from thalweg.viewer.flight.cockpit import Cockpit
from thalweg.viewer.flight.filming import FilmedFlight
from thalweg.viewer.flight.flight import Flight, env_of
from thalweg.viewer.flight.options import FlightOptions
from thalweg.viewer.flight.recording import Folder, Recording
from thalweg.world import World

OPTIONS = FlightOptions(level="Easy", size_px=32, seed=3, look="mist", task="Swimmers")


@pytest.fixture
def cockpit(tmp_path: Path, easy_world: World) -> Cockpit:
    cockpit = Cockpit({}, Folder(tmp_path), "pilot")
    cockpit.start(easy_world, OPTIONS)
    return cockpit


def test_a_film_has_the_state_and_the_frame_before_each_step(cockpit: Cockpit, fly: Fly):
    filmed = FilmedFlight(cockpit, 3)
    again = fly(seed=3, look="mist", task="Swimmers")
    for index in range(3):
        drawn = again.env.frames.render(again.views(), again.env.props())[0]
        assert np.array_equal(filmed.draw(index), drawn)
        again.step(filmed.flight.actions[index], "pilot")
    record = filmed.record()
    assert np.array_equal(record.poses, again.poses[:3])
    assert record.returns.tolist() == pytest.approx([0.0, *np.cumsum(again.rewards)[:2]])
    assert record.episode.reason == ""


def test_a_film_is_drawn_by_a_camera_of_its_own(cockpit: Cockpit):
    camera = Camera(48, 64, 85.0, 40.0)
    filmed = FilmedFlight(cockpit, 1, camera)
    config = replace(filmed.flight.env.config, camera=camera)
    start = Flight(env_of(filmed.flight.world, OPTIONS), OPTIONS)
    drawn = FrameRenderer(start.env.worlds, 1, config).render(start.views(), start.env.props())[0]
    assert drawn.shape == (48, 64, 4) and np.array_equal(filmed.draw(0), drawn)


def test_a_film_of_a_flight_to_its_end_names_the_reason(cockpit: Cockpit):
    cockpit.control("hand")
    cockpit.hand.hold((1, 0, 0, 0))
    filmed = FilmedFlight(cockpit)
    assert filmed.record().episode.reason == "OutOfVolumeVertical"
    assert len(filmed.record().poses) == filmed.flight.steps


def test_a_film_of_a_recorded_flight_ends_with_it(cockpit: Cockpit, easy_world: World):
    recording = Recording.of(FilmedFlight(cockpit, 4).flight)
    cockpit.repeat(easy_world, recording)
    filmed = FilmedFlight(cockpit)
    assert np.array_equal(filmed.record().poses, recording.poses[:-1])
    assert filmed.draw(3).shape == (32, 32, 4)


def test_there_must_be_a_flight(tmp_path: Path):
    with pytest.raises(ViewerError, match="there is no flight"):
        FilmedFlight(Cockpit({}, Folder(tmp_path)))
