"""Tests of recorded flights for data sets: whether, and why, they ended."""

import math
from pathlib import Path

import h5py
import numpy as np
import pytest

from thalweg.datasets.recordings import read_recordings, recording
from thalweg.env import DoneReason, EnvConfig
from thalweg.render import Camera
from thalweg.render.records.appearance import PARAMETERS
from thalweg.viewer.flight.cockpit import Cockpit
from thalweg.viewer.flight.observed import Observer, move_of
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
    with data as writer, writer.flight("River", observer.options_of(flight)) as written:
        steps = observer.record(cockpit, written)
    assert flight.ended and (flight.terminated, flight.reason) == (terminated, reason)
    (found,) = read_recordings(tmp_path / "data")[1]
    assert (found.terminated, found.reason, len(found.rewards)) == (terminated, reason, steps)
    with h5py.File(tmp_path / "data" / "data" / "main_data.hdf5") as file:
        ends = {name: np.array(file[f"episode_0/{name}"]).tolist() for name in ("terminations", "truncations")}
    cut, ended = [False] * steps, [*[False] * (steps - 1), True]
    assert ends == {"terminations": ended if terminated else cut, "truncations": cut if terminated else ended}


@pytest.mark.parametrize(
    ("options", "action", "move"),
    [
        ({}, [0, 2, 0, 1], [1, -1, 1, 0]),
        ({}, [1, 1, 2, 2], [0, 0, 0, -1]),  # the third option forward does nothing
        ({"allow_backward": True}, [1, 1, 2, 1], [0, 0, -1, 0]),
        ({"task": "Swimmers"}, [1, 1, 2, 1], [0, 0, 2, 0]),  # a fast step, of 2 m
        ({"action": "continuous"}, [0.5, -0.25, -1, 0], [0.5, -0.25, 0, 0]),
        *(({"task": "Swimmers", "action": "continuous"}, [0, 0, a, 0], [0, 0, m, 0])
          for a, m in ((1, 2), (0.8, 1.6), (0.5, 1), (0.25, 0.5), (-1, 0))),
        ({"vehicle": "asv"}, [0, 1, 0, 1], [0, 0, 1, 0]),  # a boat does not climb
    ],
)  # fmt: skip
def test_the_move_of_an_action_is_what_it_does_in_plain_steps(options: dict, action: list, move: list):
    config = EnvConfig(observation="none", **options)
    given = np.array(action, np.int64 if config.action == "multidiscrete" else np.float32)
    assert move_of(config, given) == pytest.approx(move)


def test_a_flight_under_a_random_look_tells_the_optics_that_its_frames_were_drawn_with(easy_world: World):
    cockpit = Cockpit({}, Folder(Path("flights")))
    angles = []
    for seed in (3, 4):
        cockpit.start(easy_world, FlightOptions(level="Easy", size_px=32, seed=seed, look="random"))
        flight = cockpit.flight
        assert flight is not None
        observer = Observer(flight.env, Camera(16, 16), ("depth",))
        optics = observer.options_of(flight)["camera"]
        seen = Observer(
            flight.env, Camera(16, 16, fov_deg=optics["fov_deg"], pitch_deg=optics["pitch_deg"]), ("depth",)
        )
        views = flight.views()
        plain = views._replace(look=np.where([name.endswith("_deg") for name in PARAMETERS], 0.0, views.look))
        drawn = seen._frames.render_layers(plain, ["depth_m"], flight.env.props()).depth_m[0]
        np.testing.assert_allclose(observer.see(flight).images["depth"], drawn, rtol=1e-3)
        focal_px = 8 / math.tan(math.radians(optics["fov_deg"]) / 2)
        assert optics["intrinsics"][1] == pytest.approx([0, focal_px, 7.5])
        angles.append(optics["pitch_deg"])
    assert angles[0] != angles[1]
