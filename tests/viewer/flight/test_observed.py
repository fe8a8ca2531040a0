"""Tests of recorded flights for data sets: whether, and why, they ended."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from thalweg.datasets.recordings import read_recordings, recording
from thalweg.env import DoneReason
from thalweg.render import Camera
from thalweg.viewer.flight.cockpit import Cockpit
from thalweg.viewer.flight.observed import Observer, options_of
from thalweg.viewer.flight.options import FlightOptions
from thalweg.viewer.flight.recording import Folder
from thalweg.world import World


@pytest.mark.parametrize(
    ("hand", "steps_left", "reason", "terminated"),
    [
        ((0, 0, 0, 1), 400, DoneReason.OUT_OF_VOLUME_HORIZONTAL, True),
        ((0, 0, 0, 0), 2, DoneReason.MAX_STEP_REACHED, False),
    ],
    ids=["left", "limit"],
)
def test_a_flight_that_leaves_the_channel_terminates_and_one_at_the_step_limit_is_cut_off(
    hand: tuple[int, int, int, int],
    steps_left: int,
    reason: DoneReason,
    terminated: bool,
    easy_world: World,
    tmp_path: Path,
):
    cockpit = Cockpit({}, Folder(tmp_path / "flights"), "pilot")
    cockpit.start(easy_world, FlightOptions(level="Easy", size_px=32, seed=3))
    flight = cockpit.flight
    assert flight is not None
    flight.env.state.steps[:] = flight.env.courses.max_steps[0] - steps_left
    cockpit.control("hand")
    cockpit.hand.hold(hand)
    observer = Observer(flight.env, Camera(16, 16), ())
    data = recording(tmp_path / "data", "minari", observer.about())
    with data as writer, writer.flight("River", options_of(flight)) as written:
        steps = observer.record(cockpit, written)
    assert flight.ended and (flight.terminated, flight.reason) == (terminated, reason)
    (found,) = read_recordings(tmp_path / "data")[1]
    assert (found.terminated, found.reason, len(found.rewards)) == (terminated, reason, steps)
    with h5py.File(tmp_path / "data" / "data" / "main_data.hdf5") as file:
        ends = {name: np.array(file[f"episode_0/{name}"]).tolist() for name in ("terminations", "truncations")}
    cut, ended = [False] * steps, [*[False] * (steps - 1), True]
    assert ends == {"terminations": ended if terminated else cut, "truncations": cut if terminated else ended}
