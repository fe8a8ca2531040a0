"""Flights on Easy with small frames."""

from collections.abc import Callable

import pytest

from thalweg.viewer.flight.flight import Flight, env_of
from thalweg.viewer.flight.options import FlightOptions
from thalweg.world import World

Fly = Callable[..., Flight]


@pytest.fixture
def fly(easy_world: World) -> Fly:
    """A function that begins a flight on Easy with some options."""

    def begin(**changes) -> Flight:
        options = FlightOptions(**{"level": "Easy", "size_px": 32, **changes})
        return Flight(env_of(easy_world, options), options)

    return begin
