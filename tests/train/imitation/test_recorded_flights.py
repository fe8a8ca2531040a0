"""Tests of recorded flights as one stream of steps."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from tests.datasets.episodes import ABOUT, flight
from thalweg.core import versions
from thalweg.datasets.episode import RecordedEpisode
from thalweg.render import Camera
from thalweg.train.imitation import recorded_flights
from thalweg.train.imitation.recorded_flights import RecordedFlights


def test_the_digest_tells_frames_of_the_same_flight_apart(monkeypatch: pytest.MonkeyPatch):
    about = replace(ABOUT, camera=asdict(Camera()), versions={"RENDER": versions.RENDER})
    frames = np.zeros((4, 128, 128, 3), np.uint8)
    made = replace(flight(3), rgb=frames)

    def digest(of: RecordedEpisode) -> str:
        monkeypatch.setattr(recorded_flights, "read_recordings", lambda _: (about, iter([of])))
        return RecordedFlights([Path("flights")], "rgb").digest.hexdigest()

    assert digest(made) == digest(replace(made, rgb=frames.copy()))
    assert digest(made) != digest(replace(made, rgb=frames + 1))
